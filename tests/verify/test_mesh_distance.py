"""The referee's geometry: distances by closed forms, rays, kernels and coal; trees; runs that touched a mesh."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
import trimesh
from conftest import sampled
from corrupted_meshes import corrupted
from hypothesis import example, given
from hypothesis import strategies as st
from numpy.typing import NDArray
from planted_faults import described_grasp, failing, verdict
from short_grasp import short_grasp
from trimesh.triangles import closest_point

from hhsim.errors import HhsimError, MeshError
from hhsim.hand.forward_kinematics import PlacedHand, forward_kinematics, hand_shape
from hhsim.hand.model import HandModel
from hhsim.kernels.mesh.bvh import build_mesh_bvh
from hhsim.mesh.catalogue import load_object
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.mesh_penetration import RESOLUTION, mesh_clearance
from hhsim.replay.replay import replay_scene
from hhsim.result.reader import Result, load_result
from hhsim.scene.scene import make_scene
from hhsim.solver.options import SolverOptions
from hhsim.trees.builder import build_sphere_tree
from hhsim.trees.cache import cached_sphere_tree
from hhsim.trees.hierarchy import build_hierarchy
from hhsim.trees.options import TreeOptions
from hhsim.trees.sphere_tree import SphereTree
from hhsim.trees.triangle_tree import tree_of_any
from hhsim.verify.claim import HOLDS
from hhsim.verify.contacts import PALM, RoundCones, ready_triangles
from hhsim.verify.depth_checks import EXACT, coal_distance, has_coal
from hhsim.verify.mesh_distance import TrueSurface
from hhsim.verify.verify import verify
from tools import tree_checks
from tools.tree_checks import Verdict, referee, sticking_out

BOX = trimesh.creation.box((0.1, 0.06, 0.04))
MESH = Mesh(np.asarray(BOX.vertices), np.asarray(BOX.faces), name="box")
Points = NDArray[np.float64]
HAND = HandModel.default()
FAR = 0.02


def over(height: float) -> PlacedHand:
    """A hand, palm down, over the origin."""
    return forward_kinematics(
        HAND, [[0.0, -0.06, height]], [[1.0, 0.0, 0.0, 0.0]], np.full((1, 5, 3), 0.2), np.zeros((1, 5))
    )


def one_cone(referee: TrueSurface, a: Points, b: Points, radius_a: float, radius_b: float, limit: float) -> float:
    (found,) = referee.round_cones(RoundCones(a[None], b[None], np.array([radius_a]), np.array([radius_b])), limit)
    return float(found)


def test_an_axis_that_is_inside_is_in_by_its_radius() -> None:
    referee, a = TrueSurface(MESH), np.array([-0.01, 0.0, 0.0])
    assert one_cone(referee, a, np.array([0.01, 0.0, 0.0]), 0.004, 0.003, FAR) == -0.004
    through = one_cone(referee, a, np.array([0.01, 0.0, 0.1]), 0.004, 0.003, FAR)
    assert through == pytest.approx(-0.0038), "its radius where it passes through the top, a fifth along"
    deep = one_cone(referee, a, np.array([0.01, 0.0, 0.0]), 0.004, 0.003, 0.0)
    assert deep == -0.004, "farther from the surface than the limit, and inside"
    # A ball is as deep as its centre is, and its radius.
    assert one_cone(referee, a, a, 0.004, 0.004, FAR) == pytest.approx(-0.024)


def test_a_box_with_or_without_a_needle_in_it_has_its_distance_in_closed_form() -> None:
    corner = len(MESH.vertices)
    first, *others = MESH.faces
    u, v, w = first
    # A third corner between the others, by a triangle without area.
    vertices = np.vstack([MESH.vertices, 0.5 * (MESH.vertices[u] + MESH.vertices[v])])
    mesh = Mesh(vertices, np.array([*others, (u, corner, w), (corner, v, w), (u, v, corner)]))
    points = np.random.default_rng(1).uniform(-0.08, 0.08, (2000, 3))
    beyond = np.abs(points) - [0.05, 0.03, 0.02]
    expected = np.linalg.norm(np.maximum(beyond, 0.0), axis=1) + np.minimum(beyond.max(axis=1), 0.0)
    for surface in (TrueSurface(MESH), TrueSurface(mesh), TrueSurface(mesh, open_too=True)):
        np.testing.assert_allclose(surface.signed_distance(points), expected, atol=1e-12)


@pytest.mark.parametrize("name", ["bunny", "cube"])
def test_a_whole_hand_is_where_the_kernels_have_it(name: str) -> None:
    mesh = load_object(name).mesh
    referee, bvh = TrueSurface(mesh), build_mesh_bvh(mesh.vertices, mesh.faces)
    top = float(mesh.bounds[1, 2])
    signs = set()
    for height in np.linspace(top + 0.01, top + 0.1, 16):
        placed = over(float(height))
        theirs = referee.clearances(hand_shape(HAND), placed, FAR)
        assert theirs.shape == (1, PALM + 1)
        ours = float(mesh_clearance(bvh, hand_shape(HAND), placed, FAR)[0])
        if theirs.min() > -0.003:
            assert theirs.min() == pytest.approx(ours, abs=1e-6 + 0.01 * RESOLUTION)
        signs.add(np.sign(ours))
    assert signs == {-1.0, 1.0}


THIRD: dict[str, tuple[float, float]] = {
    "a corner twice": (1.0, 0.0),
    "a corner between the others": (0.25, 0.0),
    "a corner beyond the others": (-0.5, 0.0),
    "higher by rounding": (0.5, 1e-17),
    "a needle": (0.5, 1e-9),
}
"""Where the third corner is, along the first side and beside it [m]."""


@pytest.mark.parametrize("name", THIRD)
def test_a_triangle_without_area_is_as_far_as_its_line(name: str) -> None:
    random, (share, beside) = np.random.default_rng(5), THIRD[name]
    for _ in range(20):
        a, b, point = random.uniform(-0.02, 0.02, (3, 3))
        c = a + share * (b - a) + beside * np.cross(b - a, [0.6, 0.0, 0.8]) / np.linalg.norm(b - a)
        mesh = Mesh(np.array([a, b, c]), np.array([[0, 1, 2]]))
        first, last = (a + bound * (b - a) for bound in (min(share, 0.0), max(share, 1.0)))
        expected = pytest.approx(from_segment(point, first, last) - 0.002, abs=3e-9)
        assert one_cone(TrueSurface(mesh, open_too=True), point, point, 0.002, 0.002, np.inf) == expected


lengths = st.floats(-0.05, 0.05).map(lambda x: round(x, 4))
places = st.tuples(lengths, lengths, lengths).map(np.array)
radii = st.floats(0.0, 0.012).map(lambda x: round(x, 4))


@given(st.tuples(places, places, places), places, places, radii, radii)
@example((np.zeros(3), np.ones(3), np.array([1.0, 0.0, 0.0])), *2 * [np.array([0.0, 0.0, 1.0])], 0.002, 0.008)
@example((np.zeros(3), np.eye(3)[1], np.eye(3)[0]), np.zeros(3), np.array([0.03, 0.0, 0.0]), 0.0, 0.008)
def test_a_round_cone_is_as_far_from_a_triangle_as_its_balls(
    corners: tuple[Points, Points, Points], a: Points, b: Points, radius_a: float, radius_b: float
) -> None:
    mesh = Mesh(np.array(corners), np.array([[0, 1, 2]]))
    referee = TrueSurface(mesh, open_too=True)
    found = one_cone(referee, a, b, radius_a, radius_b, np.inf)
    share = np.linspace(0.0, 1.0, 201)[:, None]
    balls = trimesh.triangles.closest_point(np.tile(mesh.triangles, (201, 1, 1)), a + share * (b - a))
    radius = (radius_a + share * (radius_b - radius_a))[:, 0]
    least = (np.linalg.norm(balls - a - share * (b - a), axis=1) - radius).min()
    between = 0.5 / 200 * (np.linalg.norm(b - a) + abs(radius_b - radius_a))
    assert least - between - 1e-9 <= found <= least + 1e-9
    if has_coal() and ready_triangles(mesh.triangles).solid[0]:
        assert found == pytest.approx(coal_distance(a, b, radius_a, radius_b, mesh.triangles[0]), abs=2 * EXACT)


@given(places, radii, places, places, radii, radii)
@pytest.mark.skipif(not has_coal(), reason="coal is not installed: pip install 'hhsim[verify]'")
def test_a_round_cone_is_as_far_from_a_sphere_as_coal_has_it(
    center: Points, radius: float, a: Points, b: Points, radius_a: float, radius_b: float
) -> None:
    cone = RoundCones(a[None], b[None], np.array([radius_a]), np.array([radius_b]))
    place, size = cone.nearest_balls(center[None])
    found = float(np.linalg.norm(place - center) - size[0] - radius)
    assert found == pytest.approx(coal_distance(a, b, radius_a, radius_b, center, radius), abs=2 * EXACT)


def from_segment(point: Points, a: Points, b: Points) -> float:
    share = np.clip((point - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
    return float(np.linalg.norm(point - a - share * (b - a)))


@pytest.fixture(scope="module")
def on_mesh(tmp_path_factory: pytest.TempPathFactory) -> Result:
    return described_grasp(tmp_path_factory.mktemp("mesh"), surface="mesh")


def test_an_honest_result_on_the_mesh_holds_in_every_claim(on_mesh: Result) -> None:
    found = verify(on_mesh, every=40)
    assert failing(found) == set()
    for name in ("second run", "depth", "non-penetration", "mesh"):
        assert verdict(found, name) == HOLDS
    assert np.isnan(found.sphere_penetration) and found.mesh_penetration == 0.0
    # A force is borne within a micrometre of the mesh, or what bears it does not touch.
    assert on_mesh.scene["solver"]["touch"] == 1e-6 >= on_mesh.summary["contact_error_max"]
    bears = next(claim for claim in found.claims if claim.name == "complementarity")
    assert bears.verdict == HOLDS and bears.checked > 0
    assert on_mesh.summary["force_contact_max"] > 1.0


METHODS = ("coupled", "progressive")
SOME = (14, 18, 43, 63)
"""Turned faces, vertices that are not finite, overlaps with slivers, needles."""


@pytest.mark.parametrize(
    ("seed", "method"),
    sampled(
        [(seed, method) for seed in range(200) for method in METHODS],
        lambda place, case: case[0] in SOME and case[1] == METHODS[SOME.index(case[0]) % 2],
    ),
)
@pytest.mark.quick("14-coupled", "18-progressive")
def test_a_corrupted_mesh_is_touched_as_it_is_or_refused(seed: int, method: str, tmp_path: Path) -> None:
    vertices, faces, what = corrupted(seed)
    try:
        extent = Mesh(vertices, faces).extent.max()
        mesh = Mesh((vertices - np.nanmean(vertices, axis=0)) * (0.1 / extent), faces)
        scene = make_scene(mesh, tree_of_any(mesh, 2), HandModel.default(), short_grasp())
    except HhsimError as error:
        assert "\n" not in str(error), what
        return
    summary = replay_scene(scene, SolverOptions(method=method, surface="mesh"), tmp_path / "run.h5")
    assert summary.attributes()["penetration_max"] == 0.0, what
    assert summary.attributes()["stuck_ticks"] == 0, what
    found = verify(load_result(tmp_path / "run.h5"), every=60)
    assert [claim for claim in found.claims if claim.failed] == [], what
    assert next(claim.verdict for claim in found.claims if claim.name == "mesh") == HOLDS, what


def judged(mesh: Mesh, tree: SphereTree, levels: Sequence[int] | None = None) -> tuple[Verdict, ...]:
    """With fewer samples than usual."""
    return referee(mesh, tree, levels, mesh_points=20_000, sphere_points=40_000)


SMALL = trimesh.creation.box((0.02, 0.02, 0.02))
WHERE = MESH.vertices, SMALL.vertices + [0.05, 0.0, 0.0], SMALL.vertices + 1.0
FACES = MESH.faces, SMALL.faces[:, ::-1] + 8, SMALL.faces + 16
"""A box, a smaller one, inside out, that cuts through it, and one far away."""


def test_what_is_beyond_the_box_of_a_mesh_that_cuts_through_itself_is_outside() -> None:
    mesh = Mesh(np.concatenate(WHERE[:2]), np.concatenate(FACES[:2]))
    distance = TrueSurface(mesh).signed_distance(np.array([[0.09, 0.0, 0.0], [0.061, 0.005, -0.002]]))
    np.testing.assert_allclose(distance, [0.03, 0.001], atol=1e-12)


def test_of_a_mesh_as_found_inside_is_what_it_goes_around() -> None:
    # As above, and a box far away, so that the box around them all reaches there.
    surface = TrueSurface(Mesh(np.concatenate(WHERE), np.concatenate(FACES)), open_too=True)
    distance = surface.signed_distance(np.array([[0.09, 0.0, 0.0], [-0.02, 0.0, 0.0], [1.0, 1.0, 1.0]]))
    np.testing.assert_allclose(distance, [0.03, -0.02, -0.01], atol=1e-12)


@pytest.mark.parametrize("name", ["bunny", "cup"])
def test_signed_distance_by_brute_force_and_rays(name: str) -> None:
    mesh = load_object(name).mesh
    rng = np.random.default_rng(2)
    # Near the surface too, and over vertices, where a face's own normal tells the wrong side.
    over = mesh.vertices[::60]
    points = np.concatenate(
        [rng.uniform(mesh.bounds[0], mesh.bounds[1], (60, 3)), over + 1e-3 * rng.normal(size=over.shape)]
    )
    inside = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).contains(points)
    expected = []
    for point in points:
        nearest = closest_point(mesh.triangles, np.tile(point, (len(mesh.faces), 1)))
        expected.append(np.linalg.norm(nearest - point, axis=1).min())
    np.testing.assert_allclose(TrueSurface(mesh).signed_distance(points), np.where(inside, -1, 1) * expected, atol=1e-9)


def test_a_lone_ball_in_closed_form() -> None:
    tree = build_hierarchy(np.array([[0.01, 0.0, 0.0]]), np.array([0.022]), 1, 8)
    found = judged(MESH, tree, [1])[0]
    assert found.gap == pytest.approx(np.linalg.norm([0.06, 0.03, 0.02]) - 0.022, abs=1e-9)
    assert found.protrusion == pytest.approx(0.002, abs=1e-7)
    # A cap above two faces, whose heights are spread evenly: Archimedes.
    assert found.protrusion_mean == pytest.approx(0.001, rel=0.03)


def test_a_hole_between_the_samples_is_found() -> None:
    built = build_sphere_tree(MESH, TreeOptions(level=2))
    (whole,) = judged(MESH, built, [2])
    assert whole.gap == 0.0
    assert 0.0 <= whole.slack < 1e-6, "spheres are no larger than they must be"
    # So little that hardly a random point lies in it: the search has to find it.
    shrunk = build_hierarchy(built.leaf_center, built.leaf_radius - 1e-6, 2, 8)
    (holed,) = judged(MESH, shrunk, [2])
    assert holed.gap == pytest.approx(1e-6 - whole.slack, rel=0.3)


def test_a_sphere_that_sticks_out_is_found() -> None:
    center = np.array([[0.0, 0.0, 0.0], [0.03, 0.0, 0.0], [-0.02, 0.0, 0.0], [0.04, 0.0, 0.0], [-0.02, 0.0, 0.0]])
    radius = np.array([0.06, 0.012, 0.02, 0.002, 0.02])
    shape = np.array([0, 1, 1, 2, 2]), np.array([-1, 0, 0, 1, 2])
    tree = SphereTree(center, radius, *shape)
    assert sticking_out(tree, 1) == pytest.approx(0.0)
    assert sticking_out(tree, 0) == pytest.approx(-0.018)
    assert sticking_out(tree, 2) == -np.inf
    radius[1] = 0.031
    wide = SphereTree(center, radius, *shape)
    assert sticking_out(wide, 0) == pytest.approx(0.001), "an inner sphere counts too"
    assert sticking_out(wide, 0, leaves_only=True) == pytest.approx(-0.018)


def test_an_open_mesh_has_no_outside() -> None:
    with pytest.raises(MeshError, match="not watertight"):
        TrueSurface(Mesh(MESH.vertices, MESH.faces[1:], name="open"))


BARS = {"bunny": 0.70e-3, "teapot": 0.70e-3, "cube": 1.9e-3, "hexagonal-prism": 1.45e-3, "cylinder": 1.25e-3}
"""Most protrusion of 512 leaves [m], objects of 100 mm."""
NO_GAP = 1e-9


def judge(name: str, level: int, bar: float, levels: Sequence[int] | None = None) -> None:
    mesh = load_object(name).mesh
    mesh = mesh.scaled(0.1 / float(mesh.extent.max()))
    tree = cached_sphere_tree(mesh, TreeOptions(level=level))
    verdicts = judged(mesh, tree, levels)
    assert verdicts[-1].protrusion <= bar
    for found in verdicts:
        error = tree.errors[found.level]
        assert found.spheres <= 8**found.level
        assert found.gap <= NO_GAP
        assert found.protrusion <= error.bound
        assert sticking_out(tree, found.level, leaves_only=True) <= NO_GAP
    # What the builder's own measurement tells is hardly better than it is: its samples miss the very peaks.
    assert tree.errors[-1].protrusion_max >= 0.95 * verdicts[-1].protrusion
    assert tree.errors[-1].protrusion_mean == pytest.approx(verdicts[-1].protrusion_mean, rel=0.03)


@pytest.mark.parametrize("name", sampled(BARS, lambda place, name: name == "cube"))
@pytest.mark.soak
def test_512_leaves_keep_to_the_bars(name: str) -> None:
    judge(name, 3, BARS[name])


@pytest.mark.soak
def test_4096_leaves_keep_to_the_bar(monkeypatch: pytest.MonkeyPatch) -> None:
    # An object that is quickly built; its coarser levels are those above, and so many leaves need fewer points each.
    monkeypatch.setattr(tree_checks, "LEAST_EACH", 12)
    judge("teapot", 4, 0.17e-3, [4])
