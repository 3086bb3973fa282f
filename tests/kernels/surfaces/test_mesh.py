"""The mesh as a surface: lists and rows against brute force, fingers on all kinds of features, and whole motions."""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest
import trimesh
from conftest import sampled
from contact_scenes import moved
from mesh_oracle import Cones, along_axes, box_distance, from_triangles, least_of_features, random_cones
from sphere_scenes import PALM, palm_spheres, random_hand, set_pose, tick_state

from hhsim.arrays import FloatArray, IntArray
from hhsim.bench.robustness.random_targets import RandomTargets
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.forward_kinematics import PlacedHand, forward_kinematics, hand_shape
from hhsim.hand.model import HandModel
from hhsim.kernels.contact.detection import COUNT_GATHERS, ListDistances, evaluate
from hhsim.kernels.contact.surface import cone_distance
from hhsim.kernels.hand.kinematics import BODY_COUNT, DOF
from hhsim.kernels.mesh.bvh import build_mesh_bvh
from hhsim.kernels.mesh.features import MeshFeatures
from hhsim.kernels.sphere_tree import STACK_SIZE
from hhsim.kernels.surfaces.mesh import way_out
from hhsim.kernels.tick.state import STATUS_STUCK
from hhsim.mesh.catalogue import load_object
from hhsim.mesh.features import mesh_features
from hhsim.metrics.mesh_penetration import mesh_clearance
from hhsim.solver.method import SURFACES
from hhsim.solver.options import SolverOptions
from hhsim.solver.solver import HandSolver

pytestmark = pytest.mark.slow


HAND = HandModel.default("right")
ARRAYS = HAND.arrays()
MARGIN, SKIN = 1e-3, 3e-3


STACK = np.zeros(STACK_SIZE, np.int64)
SHAPE = hand_shape(HAND)
FREE_OF_ROUNDING = 1e-12
"""Of distances of centimetres [m]."""


def bodies(motion: HandConfiguration, tick: int = 0) -> Cones:
    """The phalanges, then the palm's spheres."""
    joints = HAND.joints(*motion.at(tick))
    palm = palm_spheres(HAND.palm_tree.leaf_center, motion.position[tick][None], motion.orientation[tick][None])[0]
    radius = HAND.palm_tree.leaf_radius
    return Cones(
        np.concatenate([joints[:, :3].reshape(-1, 3), palm]),
        np.concatenate([joints[:, 1:].reshape(-1, 3), palm]),
        np.concatenate([HAND.radius[:, :3].ravel(), radius]),
        np.concatenate([HAND.radius[:, 1:].ravel(), radius]),
    )


def sheet() -> tuple[FloatArray, IntArray]:
    """An open sheet with a crease."""
    place = np.array([[x, y, 0.3 * abs(x)] for x in (-0.06, 0.0, 0.06) for y in (-0.05, 0.05)])
    return place, np.array([[0, 2, 1], [1, 2, 3], [2, 4, 3], [3, 4, 5]])


def soup() -> tuple[FloatArray, IntArray]:
    random = np.random.default_rng(8)
    place = random.uniform(-0.05, 0.05, (40, 1, 3)) + random.normal(0.0, 0.01, (40, 3, 3))
    return place.reshape(-1, 3), np.arange(120).reshape(40, 3)


def arrays(shape: Any) -> tuple[FloatArray, IntArray]:
    return np.asarray(shape.vertices), np.asarray(shape.faces, np.int64)


def catalogue(name: str) -> tuple[FloatArray, IntArray]:
    return arrays(load_object(name).mesh)


CLOSED: dict[str, Callable[[], tuple[FloatArray, IntArray]]] = {
    **{name: partial(catalogue, name) for name in ("bunny", "cup", "teapot", "cube")},
    "torus": lambda: arrays(trimesh.creation.torus(0.04, 0.012)),
}
OPEN: dict[str, Callable[[], tuple[FloatArray, IntArray]]] = {"sheet": sheet, "soup": soup}


def least_by_search(motion: HandConfiguration, triangles: FloatArray, tick: int = 0) -> FloatArray:
    """Distance [m] of each body to the nearest of a few triangles, shape (15 + palm's spheres,)."""
    cones = bodies(motion, tick)
    count = len(triangles)
    pairs = Cones(*(np.repeat(values[:PALM], count, axis=0) for values in cones))
    phalanges = along_axes(pairs, from_triangles(np.tile(triangles, (PALM, 1, 1)))).reshape(-1, count)
    palm = from_triangles(triangles)(cones.a[PALM:, None]) - cones.radius_a[PALM:, None]
    return np.asarray(np.concatenate([phalanges, palm]).min(axis=1))


def soup_clearance(motion: HandConfiguration, mesh: MeshFeatures) -> float:
    """By the distance of a body to all triangles, which has its own test."""
    cones = bodies(motion)
    return float(min(cone_distance(mesh, cones.kernel(i), 0.05, STACK) for i in range(len(cones.a))))


@pytest.mark.parametrize("name", sampled([*CLOSED, *OPEN], lambda _, name: name == "sheet"))
def test_lists_hold_the_nearest_feature_of_every_body_wherever_the_hand_goes(name: str) -> None:
    vertices, faces = {**CLOSED, **OPEN}[name]()
    closed = name in CLOSED
    mesh, _ = mesh_features(vertices, faces, closed=closed)
    bvh = build_mesh_bvh(vertices, faces) if closed else None
    random = np.random.default_rng(11)
    judged = near = gathers = 0
    for _ in range(4):
        at = random_hand(random, HAND, 0.03)
        # Out of the object along a random way, and back until something is within a millimetre or two.
        way = random.normal(size=3)
        way /= np.linalg.norm(way)

        def clearance(motion: HandConfiguration) -> float:
            if bvh is None:
                return soup_clearance(motion, mesh)
            return float(mesh_clearance(bvh, SHAPE, forward_kinematics(HAND, *motion))[0])

        low, high = 0.0, 0.3
        for _ in range(9):
            middle = 0.5 * (low + high)
            inside = clearance(at._replace(position=at.position + middle * way)) < 0.0
            low, high = (middle, high) if inside else (low, middle)
        at = at._replace(position=at.position + high * way)
        state = tick_state(np.ones(DOF), surface=SURFACES["mesh"])
        gathers_before = int(state.work[COUNT_GATHERS])
        for _ in range(25):
            size = 10.0 ** random.uniform(-5.0, -1.8)
            step = random.normal(size=DOF) * size
            step[3:] *= 4.0
            target = moved(at, step, 4.0 * size * random.normal(size=5))
            independent = clearance(target)
            if not 1e-6 < independent < 6e-3:
                continue
            if bvh is None and len(faces) < 10:
                independent = float(least_by_search(target, vertices[faces]).min())
            at = target
            set_pose(HAND, state.pose, at)
            assert (
                evaluate(ARRAYS, state.pose, mesh, ListDistances(MARGIN, MARGIN, SKIN), state.candidates, state.work)
                == 0
            )
            cones = bodies(at)
            brute = np.array([least_of_features(mesh, cones.kernel(i)) for i in range(len(cones.a))])
            least = np.append(brute[:PALM], brute[PALM:].min())
            nearest, slack = np.array(state.candidates.nearest), np.array(state.candidates.slack)
            assert (slack >= MARGIN).all()
            assert (nearest >= least - FREE_OF_ROUNDING).all()
            listed = least < slack
            np.testing.assert_allclose(nearest[listed], least[listed], rtol=0.0, atol=FREE_OF_ROUNDING)
            if independent < 0.019:
                assert least.min() == pytest.approx(independent, abs=1e-6)
            judged += 1
            near += int(listed.sum())
        gathers += int(state.work[COUNT_GATHERS]) - gathers_before
    assert judged > 30
    assert near > 0.5 * judged, "hardly anything was near"
    assert gathers < 0.9 * judged * BODY_COUNT, "the lists never last"


@pytest.mark.parametrize(
    ("name", "method", "ticks"),
    sampled(
        [
            (name, method, ticks)
            for ticks in (1000, 200_000)
            for name in ("cube", "cup", "sheet")
            for method in ("coupled", "progressive")
        ],
        lambda _, case: case in (("cube", "coupled", 1000), ("cup", "progressive", 1000), ("sheet", "coupled", 1000)),
    ),
)
def test_no_hand_enters_a_mesh_or_gets_stuck_at_it(name: str, method: str, ticks: int) -> None:
    vertices, faces = {**CLOSED, **OPEN}[name]()
    mesh, _ = mesh_features(vertices, faces, closed=name in CLOSED)
    solver = HandSolver(HAND, mesh, SolverOptions(method=method, surface="mesh"))
    motion = RandomTargets(HAND, 5)
    bvh = build_mesh_bvh(vertices, faces) if name in CLOSED else None
    touched = 0
    for _ in range(0, ticks, 1000):
        record = solver.run(*motion.take(1000))
        assert not (record.status & STATUS_STUCK).any()
        if bvh is not None:
            shown = PlacedHand(record.joints, record.position, record.orientation)
            clearance = mesh_clearance(bvh, SHAPE, shown, 1e-3)
        else:
            went = HandConfiguration.of(record)
            clearance = np.array([soup_clearance(went.part(i, i + 1), mesh) for i in range(0, 1000, 10)])
            for i in range(0, 1000, 100):
                assert least_by_search(went, vertices[faces], i).min() > 0.0
        assert clearance.min() > 0.0
        touched += int((clearance < 1e-5).sum())
    # A hand that keeps away would pass for free.
    assert touched > 0.1 * len(clearance) * ticks / 1000


def random_triangles(random: np.random.Generator, count: int) -> FloatArray:
    """Of centimetres, and no slivers: their least height is above 3 % of the longest side."""
    found = np.empty((0, 3, 3))
    while len(found) < count:
        corners = random.normal(0.0, 0.02, (count, 3, 3))
        sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
        area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
        found = np.concatenate([found, corners[area > 0.03 * sides**2]])
    return found[:count]


@pytest.mark.parametrize(("count", "seed"), sampled([(600, 1), (100_000, 2)], lambda place, _: place == 0))
def test_a_cone_and_a_triangle_by_search_along_its_axis(count: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    corners, cones = random_triangles(random, count), random_cones(random, count)
    expected = along_axes(cones, from_triangles(corners))
    axes = Cones(cones.a, cones.b, np.zeros(count), np.zeros(count))
    # There a distance has a kink.
    through = along_axes(axes, from_triangles(corners)) < 1e-6
    for i in range(count):
        mesh, _ = mesh_features(corners[i], np.array([[0, 1, 2]]), closed=False)
        found = cone_distance(mesh, cones.kernel(i), np.inf, STACK)
        assert found == pytest.approx(expected[i], abs=FREE_OF_ROUNDING)
        least = least_of_features(mesh, cones.kernel(i))
        # Where the axis goes through, a face knows nothing of it: it is never asked about a body that deep.
        assert least >= expected[i] - FREE_OF_ROUNDING
        if not through[i]:
            assert least == pytest.approx(expected[i], abs=FREE_OF_ROUNDING)
    assert 0.004 * count < through.sum() < 0.5 * count


def test_way_out_of_a_cube_against_the_closed_form() -> None:
    vertices, faces = catalogue("cube")
    middle, half = 0.5 * (vertices.min(axis=0) + vertices.max(axis=0)), 0.5 * float(np.ptp(vertices[:, 0]))
    mesh, _ = mesh_features(vertices, faces, closed=True)
    points = np.random.default_rng(5).uniform(-2.0 * half, 2.0 * half, (2000, 3))
    found = np.array([way_out(mesh, *(middle + point), STACK) for point in points])
    height, normal = found[:, 0], found[:, 1:]
    assert np.abs(height - box_distance(points, half)).max() < FREE_OF_ROUNDING
    assert (height < 0.0).sum() > 200
    # As far along the normal is the surface.
    assert np.abs(box_distance(points - height[:, None] * normal, half)).max() < FREE_OF_ROUNDING
    assert np.abs(np.linalg.norm(normal, axis=1) - 1.0).max() < FREE_OF_ROUNDING
