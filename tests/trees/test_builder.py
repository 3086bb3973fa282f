"""The builder: trees cover and enclose whatever the mesh, their proofs are checked, and as few spheres as will do."""

import math
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
import trimesh
from conftest import sampled
from hypothesis import given, settings
from hypothesis import strategies as st
from mesh_oracle import mesh_of
from scipy.spatial.transform import Rotation

from hhsim.arrays import FloatArray
from hhsim.errors import InputError, MeshError
from hhsim.mesh.mesh import Mesh
from hhsim.trees import builder as tree_builder
from hhsim.trees.builder import NEAR, PROBED, PROBES, build_sphere_tree, find_fewest, proved_anew
from hhsim.trees.contact_surface import encloses
from hhsim.trees.coverage_check import faults
from hhsim.trees.error import prove_cover, sample_mesh
from hhsim.trees.hierarchy import at_level, build_hierarchy
from hhsim.trees.options import TreeOptions
from hhsim.trees.sphere_tree import LevelCover, SphereTree
from hhsim.trees.surface_cover import GRID, canonical_frame
from hhsim.trees.triangle_tree import tree_of_any, triangle_tree
from tools.tree_checks import sticking_out

pytestmark = pytest.mark.slow


SHAPES = {
    "icosphere": trimesh.creation.icosphere(3, 0.05),
    "box": trimesh.creation.box((0.1, 0.1, 0.1)),
    "plate": trimesh.creation.box((0.1, 0.08, 0.002)),
    "cylinder": trimesh.creation.cylinder(0.03, 0.1, sections=32),
    "needle": trimesh.creation.cone(0.002, 0.1, sections=12),
    "torus": trimesh.creation.torus(0.04, 0.012, major_sections=24, minor_sections=12),
}


def assert_sound(tree: SphereTree, mesh: Mesh) -> None:
    """Every node encloses its leaves without tolerance, every level covers the mesh by proof and by sampling."""
    assert tree.check(mesh) == ()
    ancestor = np.arange(tree.leaf_start, len(tree.radius))
    for _ in range(tree.depth):
        ancestor = tree.parent[ancestor]
        distance = np.linalg.norm(tree.leaf_center - tree.center[ancestor], axis=1)
        assert (distance + tree.leaf_radius <= tree.radius[ancestor] * (1.0 + 1e-15)).all()
    points = sample_mesh(mesh, 3000, np.random.default_rng(9))
    for level in range(tree.depth + 1):
        center, radius = tree.center[tree.level == level], tree.radius[tree.level == level]
        assert prove_cover(mesh, center, radius)[0].size == 0
        center, radius = tree.spheres(level)
        assert tree.errors[level].bound == pytest.approx(tree.covers[level].bound)
        assert (np.linalg.norm(points[:, None] - center, axis=2) - radius).min(axis=1).max() <= 0.0
        assert tree.errors[level].gap_max == 0.0


ASKED = [(name, {"level": level}) for name in SHAPES for level in (1, 2)]
ASKED += [(name, {"leaves": leaves}) for name in ("box", "plate", "torus") for leaves in (1, 3, 20, 64)]
ASKED_OFTEN = [("box", {"level": 2}), ("needle", {"level": 1}), ("torus", {"level": 1}), ("box", {"leaves": 1})]


@pytest.mark.parametrize(("name", "asked"), sampled(ASKED, lambda _, case: case in ASKED_OFTEN), ids=str)
def test_levels_cover_and_enclose(name: str, asked: dict[str, int]) -> None:
    mesh, options = mesh_of(SHAPES[name]), TreeOptions(**asked)
    tree = build_sphere_tree(mesh, options)
    assert_sound(tree, mesh)
    if "level" in asked:
        assert tree.depth == options.level and 0.5 * 8**options.level < tree.leaf_count <= 8**options.level
    else:
        assert 1 <= tree.leaf_count <= asked["leaves"]
    assert np.bincount(tree.parent[1:], minlength=1).max() <= 8
    assert tree.mesh_sha256 == mesh.sha256
    assert dict(tree.options) == options.recorded()
    assert [error.spheres for error in tree.errors] == [len(cover.radius) for cover in tree.covers]
    if asked == {"leaves": 1} and name == "box":
        # About a cube of 0.1 m, whose corners are √3 times as far from its middle as its faces.
        assert tree.errors[-1].bound == pytest.approx(0.05 * (np.sqrt(3.0) - 1.0), rel=0.01)


@settings(max_examples=3)
@given(st.integers(4, 30), st.integers(0, 2**31), st.integers(1, 3), st.sampled_from([2, 3, 8]), st.floats(0.02, 1.0))
def test_random_convex_meshes(points: int, seed: int, level: int, branching: int, flat: float) -> None:
    rng = np.random.default_rng(seed)
    hull = trimesh.convex.convex_hull(0.05 * rng.normal(size=(points, 3)) * [1.0, 1.0, flat])
    mesh = mesh_of(hull)
    tree = build_sphere_tree(mesh, TreeOptions(level=level, branching=branching, seed=seed % 100))
    assert_sound(tree, mesh)
    assert tree.leaf_count <= branching**level


@settings(max_examples=60)
@given(
    st.integers(1, 64),
    st.integers(0, 2**31),
    st.sampled_from([(1, 64), (2, 8), (3, 4), (3, 8), (6, 2)]),
    st.integers(1, 4),
)
def test_hierarchy_of_any_balls(count: int, seed: int, shape: tuple[int, int], values: int) -> None:
    level, branching = shape
    rng = np.random.default_rng(seed)
    # Few distinct centres and radii: coinciding, collinear and nested spheres.
    center, radius = rng.integers(0, values, size=(count, 3)).astype(float), rng.integers(0, values, size=count) / 2.0
    tree = build_hierarchy(center, radius, level, branching)
    assert (tree.depth, tree.leaf_count) == (level, count)
    assert np.bincount(tree.parent[1:]).max() <= branching
    spheres = np.column_stack([center, radius])
    leaves = np.column_stack([tree.leaf_center, tree.leaf_radius])
    assert np.array_equal(spheres[np.lexsort(spheres.T)], leaves[np.lexsort(leaves.T)])


@pytest.mark.parametrize("name", sampled(["box", "torus"], lambda place, name: name == "box"))
def test_the_same_bytes_with_any_number_of_threads(name: str) -> None:
    mesh = mesh_of(SHAPES[name])
    trees = [build_sphere_tree(mesh, TreeOptions(leaves=100), threads=threads) for threads in (1, 3)]
    for tree in trees[1:]:
        assert tree.errors == trees[0].errors
        assert tree.center.tobytes() == trees[0].center.tobytes()
        assert tree.radius.tobytes() == trees[0].radius.tobytes()
        for one, other in zip(tree.covers, trees[0].covers, strict=True):
            assert one.proof.tobytes() == other.proof.tobytes()
            assert one.depth.tobytes() == other.depth.tobytes()
    with pytest.raises(InputError, match="0 threads, expected 1 to 64"):
        build_sphere_tree(mesh, threads=0)


@pytest.mark.parametrize("name", sampled(["box", "torus"], lambda place, name: name == "torus"))
def test_a_level_is_the_tree_that_is_built_for_it(name: str) -> None:
    mesh = mesh_of(SHAPES[name])
    fine, coarse = (build_sphere_tree(mesh, TreeOptions(level=level)) for level in (2, 1))
    cut = at_level(fine, 1)
    for field in ("center", "radius", "level", "parent"):
        assert getattr(cut, field).tobytes() == getattr(coarse, field).tobytes()
    assert (cut.errors, cut.options, cut.check(mesh)) == (coarse.errors, coarse.options, ())
    for one, other in zip(cut.covers, coarse.covers, strict=True):
        assert (one.center.tobytes(), one.proof.tobytes()) == (other.center.tobytes(), other.proof.tobytes())
    assert at_level(fine, 0).check(mesh) == ()
    turned = fine.transformed(Rotation.from_rotvec([0.3, -0.2, 1.0]).as_matrix(), [0.1, 0, 0])
    assert at_level(turned, 1).leaf_count == fine.covers[1].radius.size


def test_spheres_that_stick_out_by_more_than_the_mesh_is_wide_are_no_cover(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tree_builder, "cover_of", lambda *_: (np.array([[3.0, 0.0, 0.0]]), np.array([3.2])))
    with pytest.raises(MeshError, match=r"shape: a sphere may stick 6150 mm out of a mesh 174.9 mm across: no cover"):
        build_sphere_tree(mesh_of(SHAPES["box"]), TreeOptions(level=1))


def test_meshes_without_an_inside_are_refused() -> None:
    shape = SHAPES["box"]
    inside_out = Mesh(np.asarray(shape.vertices), np.asarray(shape.faces)[:, ::-1], name="turned")
    sheet = Mesh(np.eye(3), np.array([[0, 1, 2], [0, 2, 1]]), name="sheet")
    for mesh in (inside_out, sheet):
        with pytest.raises(MeshError, match=f"{mesh.name}: the mesh has no inside"):
            build_sphere_tree(mesh, TreeOptions(level=1))


@pytest.mark.parametrize(
    "wrong",
    [
        *({"level": 0}, {"level": 6}, {"branching": 1}, {"leaves": 0}, {"leaves": 65, "level": 2}, {"cover": "inner"}),
        *({"leaves": 8**5 + 1}, {"max_error": 0.0}, {"branching": 64}),
    ],
)
def test_options_check_themselves(wrong: dict[str, Any]) -> None:
    with pytest.raises(InputError, match=r"expected|did you mean|known: "):
        TreeOptions(**wrong)


POINTS = {
    "box": np.array(trimesh.creation.box((0.1, 0.1, 0.1)).vertices),
    "torus": np.array(trimesh.creation.torus(0.04, 0.012).vertices),
    "cloud": np.random.default_rng(3).normal(size=(50, 3)),
    "two points": np.array([[0.0, 0.0, 0.0], [1.0, 2.0, 3.0]]),
}


@pytest.mark.parametrize("name", POINTS)
def test_a_motion_leaves_no_trace(name: str) -> None:
    points = POINTS[name]
    plain = canonical_frame(points).into(points)
    rng = np.random.default_rng(5)
    for seed in range(5):
        rotation = Rotation.random(random_state=seed)
        scale = 10.0 ** rng.uniform(-4.0, 4.0)
        there = scale * rotation.apply(points) + scale * rng.normal(size=3)
        if name == "two points":
            # The second axis of a line is nobody's; the first is its own.
            assert canonical_frame(there).into(there)[:, 0] == pytest.approx(plain[:, 0], abs=GRID)
        else:
            assert np.array_equal(canonical_frame(there).into(there), plain)


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


def soup(count: int) -> Mesh:
    """Loose triangles [m]."""
    random = np.random.default_rng(3)
    corners = random.uniform(-0.05, 0.05, (count, 1, 3)) + random.normal(size=(count, 3, 3)) * 0.03
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
