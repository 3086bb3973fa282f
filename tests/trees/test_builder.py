"""The builder: every tree covers its mesh and encloses its leaves, whatever the mesh; and its errors are true."""

from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from sampled import sampled
from scipy.spatial.transform import Rotation

from hhsim.errors import InputError, MeshError
from hhsim.mesh.mesh import Mesh
from hhsim.trees import builder as tree_builder
from hhsim.trees.builder import build_sphere_tree
from hhsim.trees.error import prove_cover, sample_mesh
from hhsim.trees.hierarchy import at_level, build_hierarchy
from hhsim.trees.options import TreeOptions
from hhsim.trees.sphere_tree import SphereTree
from hhsim.trees.surface_cover import GRID, canonical_frame

pytestmark = pytest.mark.slow


def mesh_of(shape: trimesh.Trimesh, name: str = "shape") -> Mesh:
    return Mesh(np.asarray(shape.vertices), np.asarray(shape.faces), name=name)


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


@pytest.mark.parametrize(
    ("name", "level"),
    sampled(
        [(name, level) for name in SHAPES for level in (1, 2)],
        lambda _, case: case in [("box", 2), ("needle", 1), ("torus", 1)],
    ),
)
def test_levels_cover_and_enclose(name: str, level: int) -> None:
    mesh = mesh_of(SHAPES[name])
    tree = build_sphere_tree(mesh, TreeOptions(level=level))
    assert_sound(tree, mesh)
    assert tree.depth == level
    assert 0.5 * 8**level < tree.leaf_count <= 8**level
    assert np.bincount(tree.parent[1:]).max() <= 8
    assert tree.mesh_sha256 == mesh.sha256
    assert dict(tree.options) == TreeOptions(level=level).recorded()
    assert [error.spheres for error in tree.errors] == [len(cover.radius) for cover in tree.covers]


@pytest.mark.parametrize(
    ("name", "leaves"),
    sampled(
        [(name, leaves) for name in ("box", "plate", "torus") for leaves in (1, 3, 20, 64)],
        lambda _, case: case in [("box", 1), ("torus", 3)],
    ),
)
def test_as_few_leaves_as_are_asked_for_cover_and_enclose(name: str, leaves: int) -> None:
    mesh = mesh_of(SHAPES[name])
    tree = build_sphere_tree(mesh, TreeOptions(leaves=leaves))
    assert_sound(tree, mesh)
    assert 1 <= tree.leaf_count <= leaves
    if (name, leaves) == ("box", 1):
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
