"""The builder: every tree covers its mesh and encloses its leaves, whatever the mesh; and its errors are true."""

import subprocess
import sys
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from sampled import sampled
from scipy.spatial.transform import Rotation

from hhsim.arrays import FloatArray
from hhsim.errors import InputError, MeshError
from hhsim.kernels.jit import JIT_ENABLED
from hhsim.mesh.mesh import Mesh
from hhsim.trees import builder as tree_builder
from hhsim.trees.builder import GROWTH, build_sphere_tree
from hhsim.trees.error import prove_cover, sample_mesh
from hhsim.trees.hierarchy import at_level, build_hierarchy
from hhsim.trees.options import FEW, TreeOptions
from hhsim.trees.sphere_tree import SphereTree
from hhsim.trees.surface_cover import cover_of

pytestmark = pytest.mark.slow


def mesh_of(shape: trimesh.Trimesh, name: str = "shape") -> Mesh:
    return Mesh(np.asarray(shape.vertices), np.asarray(shape.faces), name=name)


SHAPES = {
    "icosphere": trimesh.creation.icosphere(3, 0.05),
    "box": trimesh.creation.box((0.1, 0.1, 0.1)),
    "plate": trimesh.creation.box((0.1, 0.08, 0.002)),
    "cylinder": trimesh.creation.cylinder(0.03, 0.1, sections=32),
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
    points = sample_mesh(mesh.vertices, mesh.faces, 3000, np.random.default_rng(9))
    for level in range(tree.depth + 1):
        center, radius = tree.center[tree.level == level], tree.radius[tree.level == level]
        assert prove_cover(mesh.vertices, mesh.faces, center, radius)[0].size == 0
        center, radius = tree.spheres(level)
        assert tree.errors[level].bound == pytest.approx(tree.covers[level].bound)
        assert (np.linalg.norm(points[:, None] - center, axis=2) - radius).min(axis=1).max() <= 0.0
        assert tree.errors[level].gap_max == 0.0


@pytest.mark.parametrize(
    ("name", "level"),
    sampled([(name, level) for name in SHAPES for level in (1, 2)], lambda place, case: place % 6 == 3),
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


@pytest.mark.parametrize(
    ("leaves", "branching", "level"),
    sampled([(20, 8, 2), (9, 3, 2), (10, 3, 3), (7, 8, 1), (65, 64, 2)], lambda place, _: place in (0, 2, 3)),
)
@pytest.mark.quick("7-8-1")
def test_so_many_leaves_at_the_level_that_they_need(leaves: int, branching: int, level: int) -> None:
    mesh = mesh_of(SHAPES["box"])
    tree = build_sphere_tree(mesh, TreeOptions(leaves=leaves, branching=branching))
    assert (tree.depth, tree.leaf_count) == (level, leaves)
    assert [len(cover.radius) for cover in tree.covers] == [min(branching**at, leaves) for at in range(level + 1)]
    assert tree.check(mesh) == ()


@pytest.mark.parametrize("cover", sampled(["outer", "balanced"], lambda _, cover: cover == "outer"))
@pytest.mark.soak
def test_the_fewest_leaves_within_an_error(cover: str) -> None:
    mesh, most = mesh_of(SHAPES["torus"]), {"outer": 6e-4, "balanced": 3e-4}[cover]
    coarse = {"outer": 0.02, "balanced": 0.01}[cover]
    few = build_sphere_tree(mesh_of(SHAPES["box"]), TreeOptions(max_error=coarse, cover=cover)).covers[-1]
    searched = TreeOptions(leaves=len(few.radius), cover=cover)
    assert len(few.radius) > 1
    assert few.bound == build_sphere_tree(mesh_of(SHAPES["box"]), searched).covers[-1].bound
    tree = build_sphere_tree(mesh, TreeOptions(max_error=most, cover=cover))
    assert tree.check(mesh) == ()
    assert max(tree.covers[-1].bound, tree.covers[-1].gap) <= most
    assert tree.errors[-1].protrusion_max <= most
    assert 8 ** (tree.depth - 1) < tree.leaf_count <= 8**tree.depth
    # Few enough leaves are searched for in another way where their number is given.
    assert 0.93 * tree.leaf_count > FEW
    fewer = build_sphere_tree(mesh, TreeOptions(leaves=int(0.93 * tree.leaf_count), cover=cover))
    assert fewer.covers[-1].bound > most
    with pytest.raises(InputError, match="shape: no cover of up to 8 spheres is within 1 mm: 8 are off by up to"):
        build_sphere_tree(mesh, TreeOptions(level=1, max_error=1e-3))


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


def test_a_balanced_cover_halves_the_error() -> None:
    mesh = mesh_of(SHAPES["box"])
    outer, balanced = (build_sphere_tree(mesh, TreeOptions(level=2, cover=cover)) for cover in ("outer", "balanced"))
    assert balanced.check(mesh) == ()
    for level in range(3):
        full, half = outer.covers[level], balanced.covers[level]
        assert half.gap == pytest.approx(0.5 * full.bound)
        assert half.bound == pytest.approx(half.gap)
        error = balanced.errors[level]
        assert 0.0 < error.gap_max <= half.gap
        assert 0.0 < error.protrusion_max <= half.bound == pytest.approx(error.bound)
    assert full.gap == 0.0


def test_rounding_in_the_way_of_a_proof_makes_the_balls_a_little_larger(monkeypatch: pytest.MonkeyPatch) -> None:
    mesh = mesh_of(SHAPES["box"])

    def less(by: float) -> SphereTree:
        def build(*arguments: Any) -> tuple[FloatArray, FloatArray]:
            center, radius = cover_of(*arguments)
            return center, radius - by

        monkeypatch.setattr(tree_builder, "cover_of", build)
        return build_sphere_tree(mesh, TreeOptions(level=1))

    exact, grown = less(0.0), less(2e-8)
    assert grown.check(mesh) == ()
    assert grown.leaf_radius == pytest.approx(exact.leaf_radius + GROWTH * 0.1 - 2e-8, rel=1e-12)
    assert grown.errors[-1].bound == pytest.approx(exact.errors[-1].bound + GROWTH * 0.1 - 2e-8, rel=1e-9)
    with pytest.raises(MeshError, match=r"shape: \d+ faces could not be covered"):
        less(1e-6)


def box_with_needles(seed: int) -> Mesh:
    """A box in single numbers, some of whose edges have points so near to their ends that rounding turns triangles."""
    rng, box = np.random.default_rng(seed), trimesh.creation.box((0.1, 0.06, 0.02))
    points, faces = np.asarray(box.vertices), np.asarray(box.faces).tolist()
    for _ in range(20):
        a, b = rng.permutation(faces[rng.integers(len(faces))])[:2]
        new, share = len(points), rng.choice([1e-7, 1e-5])
        points = np.concatenate([points, [(1.0 - share) * points[a] + share * points[b]]])
        for face in [face for face in faces if a in face and b in face]:
            faces.remove(face)
            faces += [[new if corner == end else corner for corner in face] for end in (a, b)]
    turned = trimesh.transformations.random_rotation_matrix(rng.random(3))[:3, :3]
    return Mesh((points @ turned.T).astype(np.float32), np.array(faces), name="needles")


@pytest.mark.parametrize("seed", [8, 11])
def test_triangles_as_thin_as_rounding_make_no_sphere_of_metres(seed: int) -> None:
    tree = build_sphere_tree(box_with_needles(seed), TreeOptions(level=1))
    assert tree.check(box_with_needles(seed)) == ()
    assert tree.errors[-1].bound < 0.016


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


SIGNATURES = """
import numpy as np
import trimesh
from hhsim.kernels.cover import micro_triangle
from hhsim.kernels.mesh import bvh as mesh_bvh
from hhsim.mesh.mesh import Mesh
from hhsim.trees import builder, coverage_check, error, hierarchy, surface_cover
from hhsim.trees.options import TreeOptions

shape = trimesh.creation.box((0.1, 0.1, 0.1))
vertices, faces = np.asfortranarray(shape.vertices), np.asfortranarray(shape.faces)
for array in (vertices, faces):
    array.setflags(write=False)
builder.build_sphere_tree(Mesh(vertices, faces), TreeOptions(level=1))
surface_cover.cover_of(surface_cover.in_own_frame(Mesh(vertices, faces)), 8)
tree = hierarchy.build_hierarchy(np.asfortranarray(np.eye(3)), np.ones(3, np.float32), 1, 8)
bvh = mesh_bvh.build_mesh_bvh(vertices, faces)
mesh_bvh.mesh_signed_distance(bvh, np.asfortranarray(np.eye(3)))
error.prove_cover(vertices, faces, tree.leaf_center[::-1], tree.leaf_radius[::-1])[0]
for module in (surface_cover, mesh_bvh, micro_triangle, hierarchy, error, coverage_check):
    for name, kernel in vars(module).items():
        if len(getattr(kernel, "signatures", ())) > 1:
            print(name, kernel.signatures)
"""


@pytest.mark.skipif(not JIT_ENABLED, reason="without the compiler there are no signatures")
def test_each_kernel_is_compiled_once_whatever_arrays_come() -> None:
    done = subprocess.run([sys.executable, "-c", SIGNATURES], capture_output=True, text=True, check=True)
    assert done.stdout == ""
