"""Repairs and what they rest on, and meshes that are no solid: one around them, or trees of their triangles."""

import os
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from conftest import sampled
from corrupted_meshes import corrupted
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from hhsim.arrays import FloatArray, IntArray
from hhsim.errors import MeshError
from hhsim.kernels.cover.cover_error import union_distance
from hhsim.kernels.mesh.bvh import build_mesh_bvh, face_normals, mesh_signed_distance, winding_numbers
from hhsim.mesh import solidify
from hhsim.mesh.file import read_triangles
from hhsim.mesh.mesh import Mesh, load_mesh, with_inside
from hhsim.mesh.repair import MeshInRepair, closed_surface, merge_and_clean, winding_faults
from hhsim.mesh.signed_bvh import signed_bvh
from hhsim.mesh.solidify import solid_surface, turned_outward
from hhsim.mesh.topology import face_areas, face_samples, hole_caps, in_fixed_order, is_closed, signed_volume
from hhsim.trees.builder import build_sphere_tree
from hhsim.trees.error import sample_mesh
from hhsim.trees.options import TreeOptions
from tools.shapes.generators import sphere
from tools.shapes.surface_parts import band

BALL = sphere(0.08, subdivisions=2)


@settings(max_examples=25)
@given(seed=st.integers(0, 10**6))
def test_fixed_order_does_not_depend_on_the_order_before(seed: int) -> None:
    generator = np.random.default_rng(seed)
    vertex_order = generator.permutation(len(BALL.vertices))
    rank = np.argsort(vertex_order)
    turns = generator.integers(0, 3, len(BALL.faces))[:, None]
    faces = np.take_along_axis(rank[BALL.faces], (turns + np.arange(3)) % 3, axis=1)
    vertices, faces = in_fixed_order(BALL.vertices[vertex_order], faces[generator.permutation(len(faces))])
    np.testing.assert_array_equal(vertices, BALL.vertices)
    np.testing.assert_array_equal(faces, BALL.faces)


def tube(outline: FloatArray) -> tuple[FloatArray, NDArray[np.int64]]:
    """An open upright tube of height 1 over a counter-clockwise outline, shape (n, 2)."""
    count = len(outline)
    rings = [np.column_stack([outline, np.full(count, height)]) for height in (0.0, 1.0)]
    return np.concatenate(rings), band(np.arange(count), np.arange(count, 2 * count))


SQUARE = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]])
HORSESHOE = np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 3.0], [2.0, 3.0], [2.0, 1.0], [1.0, 1.0], [1.0, 3.0], [0.0, 3.0]])


@pytest.mark.parametrize(("outline", "centers"), [(SQUARE, 2), (HORSESHOE, 0), (SQUARE[:3], 0)])
def test_caps_close_the_tube_with_the_area_of_its_outline(outline: FloatArray, centers: int) -> None:
    vertices, faces = tube(outline)
    caps = hole_caps(vertices, faces)
    assert len(caps.width) == 2
    assert len(caps.vertices) - len(vertices) == centers
    assert is_closed(np.concatenate([faces, caps.faces]))
    # Flat caps that fold nowhere have exactly the outline's area.
    x, y = outline.T
    twice = np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)
    assert face_areas(caps.vertices, caps.faces).sum() == pytest.approx(twice)
    np.testing.assert_allclose(caps.bend, 0.0, atol=1e-12)


def repaired(vertices: FloatArray, faces: IntArray) -> MeshInRepair:
    """Repair, and hold what comes out against what a closed surface is."""
    surface = closed_surface(vertices, faces, "test")
    assert is_closed(surface.faces)
    assert signed_volume(surface.vertices, surface.faces) > 0.0
    assert len(np.unique(surface.faces)) == len(surface.vertices)
    assert winding_faults(surface.vertices, surface.faces)[0] == 0
    return surface


def volume(surface: MeshInRepair) -> float:
    return signed_volume(surface.vertices, surface.faces)


def second_ball(shift: float, inward: bool = False, scale: float = 1.0) -> tuple[FloatArray, IntArray]:
    faces = BALL.faces[:, ::-1] if inward else BALL.faces
    moved = BALL.vertices * scale + np.array([shift, 0.0, 0.0])
    return np.concatenate([BALL.vertices, moved]), np.concatenate([BALL.faces, faces + len(BALL.vertices)])


@settings(max_examples=25)
@given(seed=st.integers(0, 10**6), part=st.floats(0.01, 0.5))
def test_any_mixture_of_windings_is_set_right(seed: int, part: float) -> None:
    turned = np.random.default_rng(seed).random(len(BALL.faces)) < part
    faces = BALL.faces.copy()
    faces[turned] = faces[turned][:, ::-1]
    surface = repaired(BALL.vertices, faces)
    assert volume(surface) == pytest.approx(BALL.volume)
    minority = min(int(turned.sum()), len(faces) - int(turned.sum()))
    named = [sentence for sentence in surface.repairs if "against the neighbours" in sentence]
    triangles = "1 triangle" if minority == 1 else f"{minority} triangles"
    assert named == ([f"turned {triangles} wound against the neighbours"] if minority else [])


SOUP, LOOSE = BALL.triangles.reshape(-1, 3), np.arange(960).reshape(-1, 3)
NOISE = np.random.default_rng(0).uniform(-1e-8, 1e-8, size=SOUP.shape)
BESIDE = np.concatenate([BALL.vertices, [[0.1, 0.0, 0.0], [0.12, 0.0, 0.0], [0.1, 0.02, 0.0]]])
SHEET = np.array([[0, 1, 2], [0, 2, 1]]) + len(BALL.vertices)
AGAIN = np.concatenate([BALL.faces[:5], [[3, 3, 7], [1, 2, 1]]])


@pytest.mark.parametrize(
    ("vertices", "faces", "repairs"),
    [
        (SOUP, LOOSE, ["merged 960 vertices into 162: equal places, or used by no triangle"]),
        (SOUP + NOISE, LOOSE, ["merged 798 vertices closer than 0.0008 mm to another"]),
        (BALL.vertices, BALL.faces[:, ::-1], ["wound inside out: turned"]),
        (BALL.vertices, np.concatenate([BALL.faces, BALL.faces[:, ::-1]]), ["removed 320 duplicate triangles"]),
        (BESIDE, np.concatenate([BALL.faces, SHEET]), ["removed 2 duplicate triangles"]),
        (
            BALL.vertices,
            np.concatenate([BALL.faces, AGAIN]),
            ["removed 2 degenerate triangles", "removed 5 duplicate triangles"],
        ),
    ],
    ids=["soup", "nearly equal vertices", "inside out", "both sides", "sheet of two sides beside it", "degenerate"],
)
def test_a_ball_is_restored(vertices: FloatArray, faces: IntArray, repairs: list[str]) -> None:
    surface = repaired(vertices, faces)
    assert surface.merged + surface.repairs == repairs
    assert bool(surface.merged) == ("equal places" in repairs[0])
    assert len(surface.faces) == len(BALL.faces)
    assert volume(surface) == pytest.approx(BALL.volume)


def test_loose_fragments_are_dropped_up_to_a_limit() -> None:
    chip = np.array([[0.1, 0.0, 0.0], [0.104, 0.0, 0.0], [0.1, 0.004, 0.0]])
    vertices = np.concatenate([BALL.vertices, chip])
    faces = np.concatenate([BALL.faces, [[162, 163, 164]]])
    surface = repaired(vertices, faces)
    assert len(surface.repairs) == 1
    assert surface.repairs[0].startswith("dropped 1 loose open fragment, 0.04")
    large = np.concatenate([BALL.vertices, chip + 20.0 * (chip - chip[0])])
    with pytest.raises(MeshError, match="an open surface: 1 hole"):
        closed_surface(large, faces, "test")


@settings(max_examples=25)
@given(seed=st.integers(0, 10**6), holes=st.integers(1, 6))
def test_missing_triangles_are_filled(seed: int, holes: int) -> None:
    missing = np.random.default_rng(seed).choice(len(BALL.faces), size=holes, replace=False)
    surface = repaired(BALL.vertices, np.delete(BALL.faces, missing, axis=0))
    assert volume(surface) == pytest.approx(BALL.volume, rel=0.01)
    assert surface.repairs[0].startswith("closed ")


def test_one_sided_strip_is_refused() -> None:
    count = 40
    angle = 2.0 * np.pi * np.arange(count) / count
    ring = np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    across = np.cos(angle / 2)[:, None] * ring + np.sin(angle / 2)[:, None] * np.array([0.0, 0.0, 1.0])
    faces = []
    for i in range(count):
        a, b = i, i + count
        c, d = (i + 1, i + 1 + count) if i + 1 < count else (count, 0)
        faces += [[a, c, b], [b, c, d]]
    with pytest.raises(MeshError, match="one-sided"):
        closed_surface(np.concatenate([ring - 0.3 * across, ring + 0.3 * across]), np.array(faces), "test")


JOINED, TURNED = "joined 2 overlapping parts into 1", "1 of 2 parts wound inside out: turned"


@pytest.mark.parametrize(
    ("balls", "turned", "repairs", "least", "most"),
    [
        (second_ball(0.05), False, [JOINED], 1.0, 2.0),
        (second_ball(0.0, scale=0.5), False, [JOINED], 1.0, 1.0),
        (second_ball(0.0, inward=True, scale=0.5), False, [], 0.875, 0.875),
        (second_ball(0.0, inward=True, scale=0.5), True, ["2 of 2 parts wound inside out: turned"], 0.875, 0.875),
        (second_ball(0.1, inward=True), False, [TURNED], 2.0, 2.0),
        (second_ball(0.05, inward=True), False, [TURNED, JOINED], 1.0, 2.0),
    ],
    ids=["overlap", "swallowed", "cavity", "cavity inside out", "apart, one inside out", "overlap, one inside out"],
)
def test_two_balls_become_one_solid(
    balls: tuple[FloatArray, IntArray], turned: bool, repairs: list[str], least: float, most: float
) -> None:
    vertices, faces = balls
    surface = repaired(vertices, faces[:, ::-1] if turned else faces)
    assert surface.repairs == repairs
    assert least - 1e-9 <= volume(surface) / BALL.volume <= most + 1e-9


PUSHED = BALL.vertices * [1.0, 1.0, 1.0]
PUSHED[:, 2] = np.where(PUSHED[:, 2] > 0.01, -1.5 * PUSHED[:, 2], PUSHED[:, 2])
X, _, Z = BALL.triangles.mean(axis=1).T
FIN = [*BALL.faces[0, :2], len(BALL.vertices)]


@pytest.mark.parametrize(
    ("vertices", "faces", "message"),
    [
        (BALL.vertices, BALL.faces[Z < 0.0], r"an open surface: 1 hole up to .* of its area; give it a thickness"),
        (BALL.vertices, BALL.faces[(np.abs(Z) >= 0.015) | (X <= -0.02)], "too much to close safely"),
        (PUSHED, BALL.faces, r"crosses itself: the winding number is neither 0 nor 1 .* \(from -1\.00 to"),
        (np.concatenate([PUSHED, BALL.vertices + [0.05, 0.0, 0.0]]), second_ball(0.0)[1], "a part crosses itself"),
        (
            np.concatenate([BALL.vertices, 3.0 * BALL.vertices[FIN[:1]] + [0.0, 0.03, 0.0]]),
            np.concatenate([BALL.faces, [FIN]]),
            "not watertight: 1 edge shared by more than two triangles and 2 open edges",
        ),
        (BALL.vertices * [1.0, 1.0, 1e-12], BALL.faces, "no volume: it encloses"),
    ],
    ids=["half", "bent window", "pushed through itself", "a part pushed through itself", "fin", "flat"],
)
def test_what_no_safe_repair_closes_is_refused(vertices: FloatArray, faces: IntArray, message: str) -> None:
    with pytest.raises(MeshError, match=message):
        closed_surface(vertices, faces, "test")


@pytest.mark.parametrize("halvings", [2, 5])
def test_triangles_with_no_inside_behind_are_refused_unless_they_are_few(halvings: int) -> None:
    # The finer ball has more triangles than are looked at one by one.
    ball = sphere(0.1, subdivisions=halvings)
    for side, is_refused in ((0.02, True), (0.0005, False)):
        # Both sides of a square, each cut along another diagonal: closed, and around nothing.
        square = 0.1 + side * np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]])
        sheets = len(ball.vertices) + np.array([[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]])
        vertices, faces = np.concatenate([ball.vertices, square]), np.concatenate([ball.faces, sheets])
        if is_refused:
            with pytest.raises(MeshError, match="folded over itself: 4 triangles with no inside behind"):
                closed_surface(vertices, faces, "ball")
        else:
            assert len(closed_surface(vertices, faces, "ball").faces) == len(faces)


CORRUPTED = int(os.environ.get("HHSIM_CORRUPTED", "0"))
SEEDS = range(CORRUPTED) if CORRUPTED else range(2, 200, 11)
POINTS = 400


@pytest.fixture
def coarse(monkeypatch: pytest.MonkeyPatch) -> None:
    if not CORRUPTED:
        monkeypatch.setattr(solidify, "TOLERANCE", 4e-3)
        monkeypatch.setattr(solidify, "SAMPLES", 6000)


def signed_distance(surface: MeshInRepair, points: FloatArray) -> FloatArray:
    return mesh_signed_distance(build_mesh_bvh(surface.vertices, surface.faces), points)


def stated(surface: MeshInRepair, pattern: str) -> float:
    """A length [m] that the statement names, 0 where it names none."""
    lengths = [match for sentence in surface.repairs for match in re.findall(pattern, sentence)]
    return max((1e-3 * float(length) for length in lengths), default=0.0)


def assert_true_statement(vertices: FloatArray, faces: IntArray, surface: MeshInRepair) -> float:
    """Hold a solid against the exact winding number of the triangles that it was made of.

    Returns:
        How far the surface of the file may be outside of it [m], as it says itself.
    """
    assert is_closed(surface.faces)
    assert signed_volume(surface.vertices, surface.faces) > 0.0
    assert len(np.unique(surface.faces)) == len(surface.vertices)
    out = stated(surface, r"at most (\S+) mm outside")
    buried = stated(surface, r"and (\S+) mm inside it")
    assumed = stated(surface, r"assumed, up to (\S+) mm")
    size = surface.size

    # One of each triangle, and turned outward: what is counted twice or backwards has no winding number to speak of.
    cleaned = MeshInRepair(vertices, faces, "test")
    merge_and_clean(cleaned)
    vertices = cleaned.vertices
    faces, _ = turned_outward(vertices, cleaned.faces)
    rng = np.random.default_rng(5)
    middle, face, _ = face_samples(vertices, faces, POINTS, rng)
    chosen = rng.choice(len(middle), POINTS)
    middle, normal = middle[chosen], face_normals(vertices, faces)[face[chosen]]
    beside = normal * size * 10.0 ** rng.uniform(-3.5, -1.0, size=(POINTS, 1))
    points = np.concatenate([middle + beside, middle - beside])
    number = np.empty(len(points))
    winding_numbers(vertices[faces], points, number)
    distance = signed_distance(surface, points)
    # Well within by winding number, yet outside of the solid: no more than it says.
    room = max(out, assumed) + 0.001 * size
    lost = distance[number > 0.8].max(initial=0.0)
    assert lost <= room, f"{1e3 * lost:.3g} mm lost, {1e3 * room:.3g} mm stated"
    room = max(buried, assumed) + 0.001 * size
    won = -distance[np.abs(number) < 0.2].min(initial=0.0)
    assert won <= room, f"{1e3 * won:.3g} mm added, {1e3 * room:.3g} mm stated"
    return out


@pytest.mark.parametrize(
    "seed", [seed if CORRUPTED or seed in (35, 101) else pytest.param(seed, marks=pytest.mark.soak) for seed in SEEDS]
)
@pytest.mark.usefixtures("coarse")
def test_corrupted_meshes_become_a_covered_solid_or_are_refused(seed: int) -> None:
    vertices, faces, what = corrupted(seed)
    try:
        mesh = Mesh(vertices, faces)
        vertices = (vertices - np.nanmean(vertices, axis=0)) * (0.1 / mesh.extent.max())
        surface = solid_surface(vertices, faces, "test")
    except MeshError as error:
        assert "\n" not in str(error), what
        assert re.search("export the mesh again|give it a thickness|no volume", str(error)), f"{what}: {error}"
        return
    out = assert_true_statement(vertices, faces, surface)
    solid = Mesh(surface.vertices, surface.faces)
    tree = build_sphere_tree(solid, TreeOptions(level=2))
    # The points of the file that part inside from outside lie in the leaves, up to what was stated.
    source, _, _ = face_samples(vertices, faces, 2 * POINTS, np.random.default_rng(7))
    off = signed_distance(surface, source)
    border = source[np.abs(off) <= out]
    gap = np.linalg.norm(border[:, None] - tree.leaf_center, axis=2) - tree.leaf_radius
    assert gap.min(axis=1).max(initial=-1.0) <= out + 1e-9, what


NASTY = ("nasty_bunny_94_components.ply", "nasty_teapot_open_shells.obj")


@pytest.mark.parametrize("file", sampled(NASTY, lambda place, _: place == 1))
@pytest.mark.usefixtures("coarse")
def test_nasty_meshes_get_the_same_solid_by_winding_number_as_by_repair(
    shared_data: Path, file: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    vertices, faces = read_triangles(shared_data / "meshes" / file)
    repaired = solid_surface(vertices, faces, file)

    def refused(*_: object) -> MeshInRepair:
        raise MeshError(f"{file}: not to be repaired")

    monkeypatch.setattr(solidify, "closed_surface", refused)
    assumed = solid_surface(vertices, faces, file)
    assert assumed.repairs[0].startswith("not to be repaired: its inside is taken to be where the winding number")
    volume = signed_volume(repaired.vertices, repaired.faces)
    assert signed_volume(assumed.vertices, assumed.faces) == pytest.approx(volume, rel=0.02)


def test_loose_triangles_are_refused_as_a_solid(shared_data: Path) -> None:
    with pytest.raises(MeshError, match=r"an open surface: 100 holes .* give it a thickness in a mesh editor"):
        load_mesh(shared_data / "meshes/nasty_soup_100_triangles.stl", size=0.1)


BOX = trimesh.creation.box((0.1, 0.06, 0.04))
ROUND = trimesh.creation.icosphere(2, 0.03)


def mesh_of(*shapes: trimesh.Trimesh, faces: object = None) -> Mesh:
    whole = trimesh.util.concatenate(list(shapes))
    return Mesh(np.asarray(whole.vertices), np.asarray(whole.faces if faces is None else faces), name="shape")


def at(shape: trimesh.Trimesh, x: float, y: float = 0.0, z: float = 0.0) -> trimesh.Trimesh:
    return shape.copy().apply_translation((x, y, z))


def inside_out(shape: trimesh.Trimesh) -> trimesh.Trimesh:
    turned = shape.copy()
    turned.invert()
    return turned


WALL = trimesh.Trimesh([[0, 0, 0], [0.1, 0, 0], [0.1, 0.08, 0.01], [0, 0.08, 0]], [[0, 1, 2], [0, 2, 3]])
FLAT = trimesh.Trimesh([[0, 0, 0], [0.1, 0, 0], [0.1, 0.08, 0], [0, 0.08, 0]], [[0, 1, 2], [0, 2, 3]])


def fanned_bracket(turn: float = 0.0, bend: float = 0.0) -> Mesh:
    """A U of 90 mm whose caps are fans about a corner, so that triangles fold over each other beside the solid."""
    ring = np.array([(0, 0), (9, 0), (9, 8), (6, 8), (6, 3), (3, 3), (3, 8), (0, 8)]) * 0.01
    points = np.concatenate([np.c_[ring, np.zeros(8)], np.c_[ring, np.full(8, 0.02)]])
    points += bend * np.random.default_rng(3).normal(size=points.shape)
    faces = [face for n in range(1, 7) for face in ((0, n + 1, n), (8, 8 + n, 9 + n))]
    faces += [face for n in range(8) for m in [(n + 1) % 8] for face in ((n, m, 8 + m), (n, 8 + m, 8 + n))]
    turned = trimesh.transformations.rotation_matrix(turn, [1, 2, 3])[:3, :3]
    # As a binary STL has them.
    return Mesh((points @ turned.T).astype(np.float32), np.array(faces), name="bracket")


CASES = {
    "folded caps": (fanned_bracket(), [0.015, 0.04, 0.01], True),
    "folded caps, turned": (fanned_bracket(turn=1.0), fanned_bracket(turn=1.0).triangles[0].mean(axis=0), False),
    "folded caps that are bent": (fanned_bracket(bend=1e-4), [0.015, 0.04, 0.01], True),
    "sheet": (mesh_of(WALL), [0.05, 0.04, 0.02], False),
    "half a ball": (mesh_of(ROUND, faces=ROUND.faces[ROUND.triangles_center[:, 2] > 0.0]), [0.0, 0.0, 0.005], False),
    "two boxes that cross, one inside out": (mesh_of(BOX, inside_out(at(BOX, 0.03, 0.02, 0.01))), [0.04, 0.0, 0], True),
    "ball with a hole": (mesh_of(ROUND, faces=np.asarray(ROUND.faces)[:-1]), [0.0, 0.0, 0.0], True),
    "boxes that touch, and a sheet": (mesh_of(BOX, at(BOX, 0.1), at(FLAT, 0.0, 0.0, 0.04)), [0.09, 0.0, 0.0], True),
    "box with a partition": (mesh_of(BOX, at(WALL, -0.05, -0.04, 0.0)), [0.0, 0.02, 0.015], True),
    "three leaves on an edge": (
        Mesh(0.1 * np.eye(5, 3), np.array([[0, 1, 2], [0, 1, 3], [1, 0, 4]]), name="fan"),
        [0.03, 0.03, 0.03],
        False,
    ),
}


@pytest.mark.parametrize("name", CASES)
@pytest.mark.quick(
    "sheet", "two boxes that cross, one inside out", "boxes that touch, and a sheet", "three leaves on an edge"
)
def test_a_tree_covers_the_triangles_of_a_mesh_that_is_no_solid(name: str) -> None:
    given, point, is_inside = CASES[name]
    mesh = with_inside(replace(given, source=given.name), solid=None)
    bvh = signed_bvh(mesh)
    assert (mesh_signed_distance(bvh, np.array([point]))[0] < 0.0) == is_inside
    # Nothing far away is inside, and the distance is that to the triangles there.
    far = np.random.default_rng(2).normal(size=(500, 3))
    away = mesh_signed_distance(bvh, far)
    assert np.allclose(away, np.abs(mesh_signed_distance(build_mesh_bvh(mesh.vertices, mesh.faces), far)))
    tree = build_sphere_tree(mesh, TreeOptions(level=2))
    assert tree.check(mesh) == ()
    points = sample_mesh(given, 4000, np.random.default_rng(1))
    gap = np.empty(len(points))
    x, y, z = (np.ascontiguousarray(tree.leaf_center[:, k]) for k in range(3))
    union_distance(points, x, y, z, tree.leaf_radius.copy(), gap)
    assert gap.max() == 0.0
    last = tree.errors[-1]
    assert last.protrusion_max <= last.bound * (1.0 + 1e-9)
    # Spheres of a sheet stand in it: sixty-four of them are well below its size.
    assert last.bound < 0.2 * given.extent.max()
