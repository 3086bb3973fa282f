"""The check of a cover's proof, triangles that enclose nothing, and the search for the fewest spheres."""

import math
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
from hhsim.trees.builder import NEAR, PROBED, PROBES, build_sphere_tree, find_fewest, proved_anew
from hhsim.trees.contact_surface import encloses
from hhsim.trees.coverage_check import faults
from hhsim.trees.error import prove_cover
from hhsim.trees.options import TreeOptions
from hhsim.trees.sphere_tree import LevelCover, SphereTree
from hhsim.trees.triangle_tree import tree_of_any, triangle_tree
from tools.tree_checks import sticking_out


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


def soup(count: int, seed: int = 3, size: float = 0.03) -> Mesh:
    """Loose triangles [m]."""
    random = np.random.default_rng(seed)
    middle = random.uniform(-0.05, 0.05, (count, 1, 3))
    corners = middle + random.normal(size=(count, 3, 3)) * size
    return Mesh(corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3), name="soup")


def uncovered(mesh: Mesh, center: FloatArray, radius: FloatArray) -> float:
    """Farthest that a random point of the mesh is outside of all spheres [m]."""
    random = np.random.default_rng(1)
    share = random.dirichlet(np.full(3, 0.5), size=(len(mesh.faces), 40))
    points = np.einsum("fnk,fki->fni", share, mesh.triangles).reshape(-1, 3)
    points = np.concatenate([points, mesh.vertices])
    return max(float((np.linalg.norm(point - center, axis=1) - radius).min()) for point in points)


@pytest.mark.parametrize(("count", "level"), [(1, 2), (7, 3), (60, 2), (300, 2), (300, 3)])
def test_the_leaves_cover_every_triangle(count: int, level: int) -> None:
    mesh = soup(count)
    tree = triangle_tree(mesh, level)
    assert tree.depth == level and tree.leaf_count <= 8**level
    assert uncovered(mesh, tree.leaf_center, tree.leaf_radius) < 1e-12
    assert max(sticking_out(tree, above, leaves_only=True) for above in range(level)) < 1e-12


def test_only_what_encloses_something_gets_the_usual_tree() -> None:
    box = trimesh.creation.box((0.05, 0.06, 0.07))
    vertices, faces = np.array(box.vertices, np.float64), np.array(box.faces, np.int64)
    closed, opened, inward = Mesh(vertices, faces), Mesh(vertices, faces[1:]), Mesh(vertices, faces[:, ::-1])
    assert [encloses(mesh) for mesh in (closed, opened, inward)] == [True, False, False]
    assert "around" not in tree_of_any(closed, 2).options
    for mesh in (opened, inward):
        assert tree_of_any(mesh, 2).options == {"around": "triangles", "level": 2}


class Builder:
    """Makes covers of one sphere that stands for many, off by scale · n ** −slope and some noise."""

    def __init__(self, scale: float, slope: float, noise: float = 0.0, gap: float = 0.0) -> None:
        self.scale, self.slope, self.noise, self.gap = scale, slope, noise, gap
        self.tried: list[int] = []

    def error(self, count: int) -> float:
        noise = self.noise * float(np.random.default_rng(count).normal())
        return float(self.scale * count**-self.slope * np.exp(noise))

    def __call__(self, count: int) -> LevelCover:
        self.tried.append(count)
        radius = np.zeros(count)
        radius[0] = self.error(count)
        return LevelCover(np.zeros((count, 3)), radius, np.zeros(count), self.gap * radius[0], np.zeros(1, np.int32))


@given(
    st.floats(0.3, 30.0), st.floats(0.45, 1.1), st.sampled_from([0.0, 0.01, 0.03]), st.floats(0.0, 1.0), st.integers(0)
)
def test_the_end_is_enclosed(scale: float, slope: float, noise: float, gap: float, seed: int) -> None:
    build = Builder(scale, slope, noise, gap)
    most = 20_000
    wanted = build.error(1 + seed % 10_000)
    found = len(find_fewest(build, wanted, most).radius)
    assert build.error(found) <= wanted
    below = [count for count in build.tried if count < found and build.error(count) > wanted]
    assert found == 1 or max(below) >= min(NEAR * found, found - 1)
    if found <= PROBED:
        probes = [math.floor(share * found) for share in PROBES]
        assert all(probe == 0 or build.error(probe) > wanted for probe in probes)
    assert len(build.tried) == len(set(build.tried)) <= 30
    # A better builder begins below what was found, and ends where one sphere less, or some hundredths, are too few.
    better = Builder(0.85 * scale, slope, noise, gap)
    if found > 1:
        fewer = len(find_fewest(better, wanted, 64, build(found)).radius)
        assert fewer <= found and (fewer == found or better.error(fewer) <= wanted)
        below = [count for count in better.tried if count < fewer and better.error(count) > wanted]
        assert fewer == 1 or max(below) >= min(NEAR * fewer, fewer - 1, 64)
        assert len(better.tried) <= 12 and max(better.tried) <= 64
