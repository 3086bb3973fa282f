"""Depth and volume of hands in a box: closed forms, brute force over voxels, trimesh."""

import math
from typing import Any

import numpy as np
import pytest
import trimesh
from field_hands import HALF, RADIUS, box, hands_at, joints_at, skin_hand, sphere_hand
from hypothesis import given
from hypothesis import strategies as st

from hhsim.errors import InputError
from hhsim.metrics.field.depth import depths
from hhsim.metrics.field.field_table import field_rows
from hhsim.metrics.field.hands import NEAR, FieldHands, FieldPair
from hhsim.metrics.field.volume import closed_skin, volumes

outside_is_negative: Any = trimesh.proximity.signed_distance
"""Signed distances of points from a mesh, by trimesh."""
HEIGHTS = [0.02, 0.006, 0.0, -0.004]


@pytest.mark.parametrize("height", HEIGHTS)
def test_a_sphere_in_a_box_has_the_depth_and_the_volume_of_its_cap(height: float) -> None:
    hands = sphere_hand(height)
    depth = max(RADIUS - height, 0.0)
    assert depths(hands.cone_distance) == pytest.approx([depth], abs=1e-12)
    assert hands.finger_distance[0, 1] == pytest.approx(min(height - RADIUS, NEAR), abs=1e-12)
    assert depths(hands.joint_distance) == pytest.approx([max(-height, 0.0)], abs=1e-12)
    cap = math.pi * depth**2 * (3.0 * RADIUS - depth) / 3.0
    # The polyhedron of a sphere is inscribed.
    assert 0.93 * cap <= volumes(hands)[0] <= cap


@given(st.floats(-0.03, 0.01), st.floats(0.011, 0.03), st.booleans())
def test_an_open_skin_is_closed_and_its_volume_is_exact(low: float, high: float, inward: bool) -> None:
    bottom = HALF + low
    hands = skin_hand([low, 0.0, bottom], [high, 0.02, HALF + 0.04], inward)
    assert volumes(hands)[0] == pytest.approx((high - low) * 0.02 * max(HALF - bottom, 0.0), rel=1e-9, abs=1e-15)


def test_every_border_of_a_skin_gets_a_fan() -> None:
    tube = trimesh.creation.cylinder(0.01, 0.03, sections=12)
    side = np.abs(tube.face_normals[:, 2]) < 0.5
    faces = np.array(tube.faces[side])
    vertices, closed = closed_skin(np.array(tube.vertices)[None], faces)
    solid = trimesh.Trimesh(vertices[0], closed)
    assert len(closed) == len(faces) + 24
    assert solid.is_watertight
    assert solid.volume == pytest.approx(tube.volume, rel=1e-12)
    again = closed_skin(vertices, closed)
    assert again[0].shape == vertices.shape
    assert (again[1] == closed).all()


def test_skin_depth_is_trimeshs() -> None:
    vertices = np.random.default_rng(2).uniform(-0.07, 0.07, (1, 200, 3))
    hands = FieldHands(np.zeros(1), joints_at(0.1, 1), box(), skin=vertices, faces=np.zeros((1, 3), dtype=np.int64))
    made = trimesh.creation.box(extents=[2.0 * HALF] * 3)
    signed = outside_is_negative(made, vertices[0])
    assert hands.skin_distance is not None
    assert hands.skin_distance[0] == pytest.approx(-signed, abs=1e-12)
    assert depths(hands.skin_distance) == pytest.approx([signed.max()], abs=1e-12)


def test_a_branching_skin_has_no_volume_and_missing_frames_have_no_figure() -> None:
    vertices, _ = closed_skin(*[part if k else part[None] for k, part in enumerate(skin_of_box())])
    twice = np.concatenate([skin_of_box()[1]] * 2)
    broken = FieldHands(np.zeros(1), joints_at(0.1, 1), box(), skin=vertices, faces=twice)
    assert np.isnan(volumes(broken)).all()
    joints = joints_at([[-0.003], [0.0]], 2)
    joints[1, 4] = np.nan
    hands = FieldHands(np.arange(2.0), joints, box())
    rows = {row.name: row for row in field_rows(FieldPair(hands, hands))}
    assert rows["depth_joints_max"].before == rows["depth_joints_mean"].before == pytest.approx(0.003, abs=1e-12)
    assert "depth_skin_max" not in rows
    assert "volume_exact_mean" not in rows


def skin_of_box() -> tuple[np.ndarray, np.ndarray]:
    hands = skin_hand([0.0, 0.0, 0.0], [0.01, 0.01, 0.01])
    assert hands.skin is not None and hands.faces is not None
    return hands.skin[0], hands.faces


def test_arrays_of_other_shapes_are_refused() -> None:
    with pytest.raises(InputError, match=r"joints of the judged hand has shape \(2, 20, 3\); expected \(2, 21, 3\)"):
        FieldHands(np.arange(2.0), np.zeros((2, 20, 3)), box())
    with pytest.raises(InputError, match="shape and placed together"):
        hands_at(0.1, skin=np.zeros((1, 4, 3)))
    with pytest.raises(InputError, match="1 recorded frames and 2 repaired ones"):
        FieldPair(hands_at(0.1), hands_at(0.1, 2))
    with pytest.raises(InputError, match="different meshes"):
        FieldPair(hands_at(0.1), FieldHands(np.zeros(1), joints_at(0.1, 1), box(0.04)))
    with pytest.raises(InputError, match=r"forces of shape \(1, 4\)"):
        FieldPair(hands_at(0.1), hands_at(0.1), np.zeros((1, 4)))
