"""Depth of a skin against trimesh, and freed skins before a judge that shares nothing with the repair."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from skin_samples import SkinSample, correction_to, shaken, skin_sample

from hhsim.arrays import BoolArray, FloatArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.mesh.mesh import Mesh
from hhsim.repair.skin import moved_skin
from hhsim.repair.skin_depth import PushedOut, WrittenSkin, push_out, skin_depth
from hhsim.repair.written_hand import NUMBERS, changed_hand
from hhsim.verify.mesh_distance import TrueSurface

ALL = np.ones(12, dtype=bool)


def mesh_of(shape: trimesh.Trimesh, at: FloatArray) -> Mesh:
    """Mesh [m] of a shape around a point."""
    return Mesh(np.array(shape.vertices) + at, np.array(shape.faces))


def moved(sample: SkinSample, posture: HandConfiguration, changed: BoolArray) -> FloatArray:
    """Skin of a sample in a posture."""
    return moved_skin(sample.skin, sample.joints, correction_to(sample, posture, changed))


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=15)
def test_depth_is_that_of_trimesh(seed: int) -> None:
    random = np.random.default_rng(seed)
    shape = trimesh.creation.annulus(0.01, 0.03, 0.04, sections=8) if seed % 2 else trimesh.creation.box((0.04,) * 3)
    mesh = mesh_of(shape, random.normal(0.0, 0.01, 3))
    points = random.uniform(-0.05, 0.05, (4, 30, 3))
    points[0] += 1.0
    depth, deepest = skin_depth(mesh, points)
    solid: Any = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    signed_distance: Any = trimesh.proximity.signed_distance
    for frame, vertices in enumerate(points):
        inside = signed_distance(solid, vertices)
        assert depth[frame] == pytest.approx(max(0.0, inside.max()), abs=1e-9)
        assert deepest[frame] == (inside.argmax() if inside.max() > 0.0 else -1)
    assert depth[0] == 0.0 and deepest[0] == -1


def test_vertices_move_with_the_posture_as_their_derivative_says() -> None:
    sample = skin_sample()
    written = WrittenSkin(sample.joints, sample.hand, sample.fitted, False, sample.skin).at(3)
    here, _, derivative = written.samples(written.posed(written.fitted))
    np.testing.assert_allclose(here[written.surface], sample.skin.vertices[3], atol=1e-12)
    for k in range(NUMBERS):
        change = np.zeros((1, NUMBERS))
        change[0, k] = 1e-6
        ends = [written.samples(written.posed(changed_hand(written.fitted, sign * change)))[0] for sign in (1.0, -1.0)]
        np.testing.assert_allclose(derivative[:, :, k], (ends[0] - ends[1]) / 2e-6, atol=1e-7)


def judged(sample: SkinSample, mesh: Mesh, found: PushedOut) -> None:
    """Hold a result against the skin itself, as referee and kernels measure it, and the promises of `PushedOut`."""
    changed = found.depth > 0.0
    for mine, given_one in zip(found.posture, sample.fitted):
        assert np.array_equal(mine[~changed], given_one[~changed])
    freed = moved(sample, found.posture, changed)
    np.testing.assert_allclose(found.depth, skin_depth(mesh, sample.skin.vertices)[0], atol=1e-12)
    np.testing.assert_allclose(found.depth_after, skin_depth(mesh, freed)[0], atol=1e-12)
    surface = TrueSurface(mesh)
    for frame in np.flatnonzero(found.is_freed):
        assert surface.signed_distance(freed[frame]).min() >= 0.0


@pytest.mark.parametrize("depth", [5e-4, 3e-3])
def test_a_skin_on_a_wall_is_freed_with_less_than_a_shift(depth: float) -> None:
    # A wall much larger than the hand: shifting the hand out is a way, and the least change is no dearer.
    sample = skin_sample()
    lowest = sample.skin.vertices[:, :, 2].min(axis=1)
    level = float(np.sort(lowest)[5] + depth)
    mesh = mesh_of(trimesh.creation.box((4.0, 4.0, 4.0)), np.array([0.0, 0.0, level - 2.0]))
    found = push_out(mesh, sample.hand, sample.skin, sample.joints, sample.fitted, sample.fitted)
    np.testing.assert_allclose(found.depth, np.maximum(level - lowest, 0.0), atol=1e-9)
    assert (found.depth > 0.0).any() and (found.depth == 0.0).any() and found.is_freed.all()
    judged(sample, mesh, found)
    written = WrittenSkin(sample.joints, sample.hand, sample.fitted, False, sample.skin)
    way = written.moved(sample.joints, found.posture) - sample.joints
    assert (np.sqrt((way**2).sum(axis=2).mean(axis=1)) <= 1.05 * found.depth + 5e-5).all()


SHAPES = {
    "ball": trimesh.creation.icosphere(subdivisions=3, radius=0.03),
    "box": trimesh.creation.box((0.05, 0.05, 0.05)),
    "plate": trimesh.creation.box((0.1, 0.003, 0.1)),
    "rod": trimesh.creation.cylinder(0.012, 0.2),
}


@pytest.mark.parametrize("name", SHAPES)
def test_a_hand_with_an_object_through_it_is_freed(name: str) -> None:
    sample = skin_sample()
    mesh = mesh_of(SHAPES[name], sample.joints[:, 10].mean(axis=0) + [0.0, 0.02, 0.02])
    found = push_out(mesh, sample.hand, sample.skin, sample.joints, sample.fitted, sample.fitted)
    assert found.is_freed.all() and found.depth.max() > 1e-3 and not found.depth_after.any()
    judged(sample, mesh, found)


@pytest.mark.soak
@given(st.integers(0, 2**32 - 1), st.sampled_from(sorted(SHAPES)))
@settings(max_examples=20)
def test_any_place_is_freed(seed: int, name: str) -> None:
    sample, random = skin_sample(), np.random.default_rng(seed)
    mesh = mesh_of(SHAPES[name], sample.joints[int(random.integers(12)), int(random.integers(21))])
    start = correction_to(sample, shaken(sample, seed, 1.0), ALL).posture
    found = push_out(mesh, sample.hand, sample.skin, sample.joints, sample.fitted, start)
    assert found.is_freed.all()
    assert skin_depth(mesh, moved(sample, found.posture, ALL))[0].max() <= 1e-12


def test_an_object_that_leaves_no_room_is_marked() -> None:
    # A hand in the middle of a block of 2 m: no free place is near.
    sample = skin_sample()
    mesh = mesh_of(trimesh.creation.box((2.0, 2.0, 2.0)), sample.fitted.position[0])
    one = np.array([0])
    skin = replace(sample.skin, vertices=sample.skin.vertices[one])
    found = push_out(mesh, sample.hand, skin, sample.joints[one], sample.fitted.at(one), sample.fitted.at(one))
    assert not found.is_freed[0] and found.depth_after[0] == found.depth[0] > 0.8
    assert all(np.array_equal(mine, given_one[one]) for mine, given_one in zip(found.posture, sample.fitted))
