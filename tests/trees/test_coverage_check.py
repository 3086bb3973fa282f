"""The check of a cover's proof: it passes what the builder made, and nothing that was tampered with."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from hhsim.arrays import FloatArray
from hhsim.errors import MeshError
from hhsim.mesh.mesh import Mesh
from hhsim.trees.builder import build_sphere_tree, proved_anew
from hhsim.trees.coverage_check import faults
from hhsim.trees.error import prove_cover
from hhsim.trees.options import TreeOptions
from hhsim.trees.sphere_tree import LevelCover, SphereTree


def mesh_of(shape: trimesh.Trimesh) -> Mesh:
    return Mesh(np.asarray(shape.vertices), np.asarray(shape.faces), name="shape")


MESH = mesh_of(trimesh.creation.torus(0.04, 0.012, major_sections=24, minor_sections=12))


@cache
def built() -> SphereTree:
    return build_sphere_tree(MESH, TreeOptions(level=2))


def pieces(triangle: FloatArray, codes: list[int]) -> list[tuple[int, FloatArray]]:
    """The triangles at the ends of a face's branches with their codes, by recursion as the format is written down."""
    code = codes.pop(0)
    if code >= 0:
        return [(code, triangle)]
    a, b, c = np.roll(triangle, code + 1, axis=0)
    middle = 0.5 * (a + b)
    return pieces(np.array([a, middle, c]), codes) + pieces(np.array([middle, b, c]), codes)


def changed(cover: LevelCover, place: int, code: int) -> LevelCover:
    proof = cover.proof.copy()
    proof[place] = code
    return replace(cover, proof=proof)


def faults_of(cover: LevelCover) -> tuple[str, ...]:
    return faults(MESH, (cover,))


def test_a_smaller_ball_is_found() -> None:
    cover = built().covers[-1]
    for sphere in np.unique(cover.proof[cover.proof >= 0])[::7]:
        radius = cover.radius.copy()
        radius[sphere] *= 0.7
        assert "does not contain it" in faults_of(replace(cover, radius=radius))[0]
    # Each of them is as small as it can be: less by a thousandth of the bound, no proof whatever would do.
    radius = cover.radius - 1e-3 * cover.bound
    assert prove_cover(MESH, cover.center, radius)[0].size
    assert faults_of(replace(cover, radius=radius))


def test_broken_codes_are_found_and_nothing_is_read_beyond_them() -> None:
    cover = built().covers[-1]
    spheres = len(cover.radius)
    halved = int(np.flatnonzero(cover.proof < 0)[0])
    for place, code, message in [
        (halved, -4, "a code without a meaning"),
        (halved, -(2**31), "a code without a meaning"),
        (halved, spheres, "a sphere that does not exist"),
        (halved, 2**31 - 1, "a sphere that does not exist"),
    ]:
        assert message in faults_of(changed(cover, place, code))[0]
    assert "ends too early" in faults_of(replace(cover, proof=cover.proof[:-1]))[0]
    assert "goes on after" in faults_of(replace(cover, proof=np.append(cover.proof, 0)))[0]
    assert "too often" in faults_of(replace(cover, proof=np.full(10_000, -1, np.int32)))[0]
    unproved = replace(cover, proof=np.empty(0, np.int32))
    assert faults(MESH, (unproved, cover)) == ("level 0: no proof that it covers the mesh",)
    for covers in ((), (unproved,)):
        assert faults(MESH, covers) == ("the tree holds no proof that it covers the mesh",)


@settings(max_examples=60)
@given(st.data())
def test_no_change_of_a_code_goes_unseen_unless_it_is_as_true(data: st.DataObject) -> None:
    cover = built().covers[1]
    place = data.draw(st.integers(0, len(cover.proof) - 1))
    code = data.draw(st.integers(-5, len(cover.radius) + 1))
    other = changed(cover, place, code)
    found = faults_of(other)
    codes = other.proof.tolist()
    try:
        ends = [end for triangle in MESH.triangles for end in pieces(triangle, codes)]
        true = not codes and all(
            sphere < len(cover.radius)
            and (np.linalg.norm(piece - cover.center[sphere], axis=1) <= cover.radius[sphere] - 1e-14).all()
            for sphere, piece in ends
        )
    except (IndexError, RecursionError):
        true = False
    assert (found == ()) == (true and code >= -3)


def test_a_moved_tree_is_proved_of_the_moved_mesh() -> None:
    rotation = Rotation.from_rotvec([0.3, -0.2, 1.0]).as_matrix()
    moved = built().scaled(0.3).transformed(rotation, [0.2, -0.1, 0.4])
    assert moved.check(MESH.scaled(0.3).transformed(rotation, [0.2, -0.1, 0.4])) == ()
    assert moved.check(MESH) != ()
    mirrored = built().transformed(np.diag([-1.0, 1.0, 1.0]), np.zeros(3))
    assert not any(cover.proved for cover in mirrored.covers)
    image = Mesh(MESH.vertices * [-1.0, 1.0, 1.0], MESH.faces[:, ::-1], name="image")
    assert proved_anew(mirrored, image).check(image) == ()
    with pytest.raises(MeshError, match=r"shape: \d+ faces are not covered"):
        proved_anew(mirrored, MESH.scaled(1.5))
