"""Figures of hands in a box by closed forms, counting and trimesh; the table and verdict of the field."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from field_hands import HALF, RADIUS, box, hands_at, joints_at, skin_hand, sphere_hand
from hypothesis import given
from hypothesis import strategies as st

from hhsim.kernels.mesh.bvh import mesh_signed_distance
from hhsim.mesh.features import mesh_features
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.field.field_table import (
    EMPTY,
    MISSED,
    OK,
    FieldRow,
    field_metrics,
    field_rows,
    field_table,
    field_verdict,
    to_json,
)
from hhsim.metrics.field.figures import METRICS, depths, derivative_norm, joint_shift, was_inside
from hhsim.metrics.field.hands import NEAR, TIPS, FieldHands, FieldPair, object_bvh
from hhsim.metrics.field.volume import closed_skin, volumes
from hhsim.table.table import UNITS

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


UNDEFINED = FieldRow(METRICS[0], math.nan, math.nan, "")
HEIGHT = st.floats(-0.02, 0.02).filter(lambda height: min(abs(height - at) for at in (0.002, 0.005)) > 1e-9)


def rows_of(pair: FieldPair) -> dict[str, FieldRow]:
    return {row.name: row for row in field_rows(pair)}


def test_acceleration_and_jerk_of_a_sinusoid() -> None:
    rate, omega, amplitude = 60.0, 2.0 * math.pi * 3.0, 0.01
    time = np.arange(60) / rate
    world = np.zeros((60, 21, 3))
    world[..., 1] = amplitude * np.sin(omega * time)[:, None]
    hands = FieldHands(time, joints_at(0.1, 60), box(), world=world)
    # A central difference of order n turns sin(ωt) into (2 sin(ωΔ/2) / Δ)ⁿ times a sine or a cosine.
    factor = 2.0 * math.sin(0.5 * omega / rate) * rate
    expected = amplitude * factor**2 * np.abs(np.sin(omega * time[1:-1])).mean()
    doubled = FieldHands(time, joints_at(0.1, 60), box(), world=2.0 * world)
    rows = rows_of(FieldPair(hands, doubled))
    assert rows["acceleration"].before == pytest.approx(expected, rel=1e-9)
    middles = 0.5 * (time[1:-2] + time[2:-1])
    expected = amplitude * factor**3 * np.abs(np.cos(omega * middles)).mean()
    assert rows["jerk"].before == pytest.approx(expected, rel=1e-9)
    assert rows["acceleration_ratio"].after == pytest.approx(2.0, rel=1e-12)
    assert "acceleration_ratio" not in rows_of(FieldPair(hands_at(0.1, 5), hands_at(0.1, 5)))
    assert rows["acceleration"].parameters == "60 Hz"


@given(st.lists(st.floats(0.005, 0.1), min_size=3, max_size=12), st.floats(-50.0, 50.0), st.floats(-50.0, 50.0))
def test_differences_at_uneven_stamps_are_exact_for_polynomials(steps: list[float], a: float, b: float) -> None:
    time = np.concatenate([[0.0], np.cumsum(steps)])
    points = np.zeros((len(time), 2, 3))
    points[:, 0, 0] = a * time**2
    points[:, 1, 2] = b * time**3
    assert derivative_norm(time, points[:, :1], 2) == pytest.approx(2.0 * abs(a), rel=1e-5, abs=1e-6)
    assert derivative_norm(time, points[:, 1:], 3) == pytest.approx(6.0 * abs(b), rel=1e-4, abs=1e-4)


def test_missing_frames_and_equal_stamps_are_left_out() -> None:
    time = np.arange(9.0)
    points = np.zeros((9, 1, 3))
    points[:, 0, 0] = time**2
    points[4] = np.nan
    assert derivative_norm(time, points, 2) == pytest.approx(2.0, abs=1e-12)
    assert math.isnan(derivative_norm(time[:2], points[:2], 2))
    time[6] = time[7]
    assert derivative_norm(time[5:8], points[5:8], 1) == pytest.approx(11.0 / 2.0)


@given(st.lists(st.tuples(HEIGHT, HEIGHT), min_size=5, max_size=20))
def test_contacts_are_those_of_counting(heights: list[tuple[float, float]]) -> None:
    frames = len(heights) // 5
    tips = np.array(heights[: 5 * frames]).reshape(frames, 5, 2)
    both = np.full((2, frames, 21), 0.05)
    both[:, :, TIPS] = tips.transpose(2, 0, 1)
    rows = rows_of(FieldPair(hands_at(both[0], frames), hands_at(both[1], frames)))
    for threshold in (0.005, 0.002):
        touched = [(frame, f) for frame in range(frames) for f in range(5) if tips[frame, f, 0] <= threshold]
        kept = [(frame, f) for frame, f in touched if tips[frame, f, 1] <= threshold]
        share = 100.0 * len(kept) / len(touched) if touched else math.nan
        size = f"{1e3 * threshold:g}mm"
        assert rows.get(f"contacts_kept_{size}", UNDEFINED).after == pytest.approx(share, nan_ok=True)
        assert rows[f"fingertips_in_contact_{size}"].before == pytest.approx(20.0 * len(touched) / frames)
        seen = len({frame for frame, _ in touched})
        assert rows[f"frames_in_contact_{size}"].before == pytest.approx(100.0 * seen / frames)


def test_a_missing_frame_is_no_contact_that_is_lost() -> None:
    before, after = joints_at(-0.001, 2), joints_at(-0.001, 2)
    after[1] = np.nan
    recorded, repaired = (FieldHands(np.arange(2.0), joints, box()) for joints in (before, after))
    rows = rows_of(FieldPair(recorded, repaired))
    assert rows["contacts_kept_5mm"].after == rows["frames_in_contact_5mm"].after == 100.0


def test_fingertips_of_a_skin_are_the_vertices_nearest_to_their_phalanges() -> None:
    joints = joints_at(0.03, 1)
    joints[0, :, 0] = 0.0
    joints[0, :, 1] = 0.02 * np.arange(21) - 0.2
    # One vertex beside each joint, lower by the joint's place.
    skin = joints - [0.0, 0.0, 0.03] + np.array([0.0, 0.0, 0.001])[None, None] * np.arange(21)[None, :, None]
    skin[..., 1] -= 0.004
    inside = np.abs(skin[0, :, 1]) <= HALF
    hands = FieldHands(np.zeros(1), joints, box(), skin=skin, faces=np.zeros((1, 3), dtype=np.int64))
    for finger, tip in enumerate(TIPS):
        if inside[tip]:
            assert hands.finger_distance[0, finger] == pytest.approx(0.001 * tip, abs=1e-12)


def test_corrections_by_hand() -> None:
    before = np.array([[-0.004], [0.01], [-0.002], [0.02]])
    after = before + [[0.006], [0.0], [0.003], [0.001]]
    pair = FieldPair(hands_at(before, 4), hands_at(after, 4))
    assert was_inside(pair).tolist() == [True, False, True, False]
    assert joint_shift(pair) == pytest.approx(np.repeat([[0.006], [0.0], [0.003], [0.001]], 21, axis=1))
    rows = rows_of(pair)
    found = {name: rows[name].after for name in ("mpjpe", "correction_inside", "correction_outside", "correction_max")}
    expected = {"mpjpe": 0.0025, "correction_inside": 0.0045, "correction_outside": 0.0005, "correction_max": 0.006}
    assert found == pytest.approx(expected)
    assert math.isnan(rows["mpjpe"].before)
    assert "mpvpe" not in rows
    low, high = (skin_hand([0.0, 0.0, 0.06], [0.01, 0.01, top]) for top in (0.07, 0.076))
    # Four of the eight vertices moved by 6 mm.
    assert rows_of(FieldPair(low, high))["mpvpe"].after == pytest.approx(0.003)


def test_forces_are_means_over_the_frames_that_press() -> None:
    force = np.array([[0.0, 1.0, 0.0, 0.0, 0.5], [0.0, 3.0, np.nan, 0.0, 0.0]])
    rows = rows_of(FieldPair(hands_at(0.1, 2), hands_at(0.1, 2), force))
    found = {name: row.after for name, row in rows.items() if name.startswith("force_")}
    assert found == {"force_index": 2.0, "force_little": 0.5, "force_max": 3.0}


BALL, APART = 0.03, 0.035


def test_points_are_inside_where_one_of_two_crossing_balls_holds_them() -> None:
    balls = [trimesh.creation.icosphere(4, BALL) for _ in range(2)]
    balls[1].apply_translation([APART, 0.0, 0.0])
    vertices = np.concatenate([np.asarray(ball.vertices, np.float64) for ball in balls])
    faces = np.concatenate([ball.faces + i * len(balls[0].vertices) for i, ball in enumerate(balls)])
    mesh = Mesh(vertices, np.asarray(faces, np.int64))
    assert len(mesh_features(mesh.vertices, mesh.faces, closed=True)[0].pseudonormal) == 0
    points = np.random.default_rng(0).uniform([-0.04] * 3, [0.075, 0.04, 0.04], (2000, 3))
    away = np.stack([np.linalg.norm(points - center, axis=1) for center in ([0.0] * 3, [APART, 0.0, 0.0])])
    # The faces of the balls are up to a third of a millimetre inside of their spheres.
    clear = (np.abs(away - BALL) > 3e-4).all(axis=0)
    found = mesh_signed_distance(object_bvh(mesh), np.ascontiguousarray(points[clear]))
    inside = (away[:, clear] < BALL).any(axis=0)
    assert inside.any() and not inside.all()
    np.testing.assert_array_equal(found < 0.0, inside)


SWAY = 0.001 * np.array([[0.0], [1.0], [0.0], [1.0], [0.0]])
"""Heights of a hand that goes up and down [m], shape (5, 1)."""


def judged(before: object, after: object, max_correction: float = 0.02) -> tuple[str, tuple[str, ...], str]:
    pair = FieldPair(hands_at(np.asarray(before) + 0.0 * SWAY, 5), hands_at(np.asarray(after) + 0.0 * SWAY, 5))
    found = field_verdict(field_rows(pair), max_correction)
    return found.word, found.missed, found.line


def test_a_repair_within_all_limits() -> None:
    word, missed, line = judged(SWAY - 0.003, SWAY + 1e-9)
    assert (word, missed) == (OK, ())
    judged_by = ("PD, joints, max", "contacts kept within 5 mm", "ACC, after over before", "correction of a joint, max")
    assert line == f"within limits: {', '.join(judged_by)}"


def test_each_limit_is_missed_by_itself() -> None:
    assert judged(SWAY - 0.003, SWAY - 2e-6)[:2] == (MISSED, ("depth_joints_max",))
    assert judged(SWAY - 0.003, SWAY - 2e-6)[2] == "limits missed: PD, joints, max 0.002 mm (at most 0.001 mm)"
    assert judged(SWAY - 0.003, SWAY - 0.9e-6)[0] == OK
    assert judged(SWAY - 0.003, SWAY, 0.0025)[1] == ("correction_max",)
    assert judged(SWAY - 0.003, SWAY, 0.0035)[0] == OK
    assert judged(SWAY - 0.003, SWAY + 0.006)[1] == ("contacts_kept_5mm",)
    assert judged(SWAY - 0.003, 1.2 * SWAY)[1] == ("acceleration_ratio",)
    both = judged(SWAY - 0.003, 1.2 * SWAY - 0.001)
    assert both[1] == ("depth_joints_max", "acceleration_ratio")
    assert both[2] == (
        "limits missed: PD, joints, max 1 mm (at most 0.001 mm); ACC, after over before 1.2 (at most 1.1)"
    )


def test_without_a_known_frame_nothing_is_judged() -> None:
    word, _, line = judged(np.nan, np.nan)
    assert word == EMPTY
    assert line.startswith("no frames: ")


def test_skin_and_cones_are_judged_too() -> None:
    skin = skin_hand([0.0, 0.0, 0.04], [0.01, 0.01, 0.06])
    assert "depth_skin_max" in field_verdict(field_rows(FieldPair(skin, skin)), 1.0).missed
    cones = sphere_hand(0.006)
    assert field_verdict(field_rows(FieldPair(cones, cones)), 1.0).missed == ("depth_cones_max",)


def test_the_table_shows_units_and_json_stores_si() -> None:
    pair = FieldPair(sphere_hand(0.006), sphere_hand(0.011))
    rows = field_rows(pair)
    table = field_table(rows, "a hand")
    assert table.headings == ["figure", "before", "after", "unit", "parameters"]
    cells = {row[0]: row[1:] for row in table.cells}
    assert cells["PD, cones, max"] == ["4.000", "0.000", "mm", "surface of cones and palm spheres"]
    assert cells["MPJPE"][0] == "—"
    assert cells["IV, exact, max"][1:3] == ["0.000", "cm³"]
    stored = json.loads(json.dumps(to_json(rows)))
    assert stored["depth_cones_max"]["before"] == pytest.approx(0.004)
    assert stored["depth_cones_max"]["unit"] == "m"
    assert stored["volume_exact_max"]["unit"] == "m³"
    assert stored["volume_exact_max"]["before"] == pytest.approx(4.17e-7, rel=1e-2)
    assert stored["mpjpe"]["before"] is None
    parameters = "distal phalanges, inside counts"
    assert stored["contacts_kept_5mm"] == {"before": None, "after": 100.0, "unit": "%", "parameters": parameters}


def test_every_unit_is_si_or_known_and_the_page_has_every_figure(repository: Path) -> None:
    metrics = field_metrics()
    assert {metric.unit for metric in metrics.values()} <= UNITS.keys() | {"N", "%", "m/s²", "m/s³"}
    page = (repository / "docs" / "lab" / "repair.md").read_text()
    assert [name for name in metrics if f"`{name}`" not in page] == []
