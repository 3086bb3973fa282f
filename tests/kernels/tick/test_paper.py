"""Method `paper`: the paper's Eq. 3 to 13, asked of every pair; where it is right, where it fails, how that is told.

Rows are held against finite differences of the constraints' values as the paper prints them.
"""

import math
from typing import Any, NamedTuple

import numpy as np
import pytest
from contact_scenes import LEFT, RIGHT, ROOT
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation
from sphere_scenes import (
    CURL,
    UNTIMED,
    brute_pairs,
    bumpy_ball,
    cloud,
    random_hand,
    random_targets,
    record_clearance,
    set_pose,
    sphere_tree,
    tick_state,
)

from hhsim.arrays import FloatArray
from hhsim.hand.configuration import HandConfiguration, sequence
from hhsim.hand.model import HandModel
from hhsim.kernels.hand.hand_shape import frustum_shapes
from hhsim.kernels.rotation import euler_axes
from hhsim.kernels.tick.block import TickRecord
from hhsim.kernels.tick.paper import PAPER_STATE, finger_program
from hhsim.kernels.tick.paper_contacts import ON_FRUSTUM, ON_SPHERE, detect, palm_rows
from hhsim.kernels.tick.state import STATUS_STUCK
from hhsim.motion.analytic_motion import still
from hhsim.solver.options import SolverOptions
from hhsim.solver.solver import HandSolver
from hhsim.solver.workspace import zeroed
from hhsim.trees.sphere_tree import SphereTree

GROWTH = 2e-3
STEP = 1e-6
"""Of the central differences [m, rad]."""
ACCURACY = 1e-8
"""Rounding of a squared distance of 0.1 m over the step; rows are compared as squared distances [m², m²/rad]."""
SEEDS = st.integers(0, 2**32 - 1)
ANGLES = st.tuples(*[st.floats(-3.1, 3.1)] * 3).map(np.array)


class Frustum(NamedTuple):
    """The paper's symbols for a phalanx [m]: its thick bottom D, r₁, its thin one E, r₂."""

    d: FloatArray
    e: FloatArray
    r1: float
    r2: float


def frustum_of(hand: HandModel, joints: FloatArray, f: int, k: int) -> Frustum:
    """The cone between the circles where it touches the two joint spheres, constructed by their tangent."""
    a, b = joints[f, k], joints[f, k + 1]
    ra, rb = hand.radius[f, k], hand.radius[f, k + 1]
    u = (b - a) / np.linalg.norm(b - a)
    sine = (ra - rb) / np.linalg.norm(b - a)
    cosine = math.sqrt(1.0 - sine**2)
    return Frustum(a + ra * sine * u, b + rb * sine * u, ra * cosine, rb * cosine)


def frustum_excess(cone: Frustum, centers: FloatArray, radius: FloatArray) -> tuple[FloatArray, FloatArray]:
    """|OC| - |OC|_Γ (Eq. 4, 5) and k (Eq. 6) of spheres, shapes (L,)."""
    de = cone.e - cone.d
    length = np.linalg.norm(de)
    distance = np.linalg.norm(np.cross(cone.d - centers, de), axis=1) / length
    k = (centers - cone.e) @ (cone.d - cone.e) / length**2
    phi = math.atan2(cone.r1 - cone.r2, length)
    return distance - (radius / math.cos(phi) + k * (cone.r1 - cone.r2) + cone.r2), k


def scene(seed: int, angles: FloatArray) -> tuple[HandModel, HandConfiguration, Any, Any]:
    """A hand at these Euler angles among spheres, its pairs detected; some penetrate."""
    random = np.random.default_rng(seed)
    hand = RIGHT if seed % 2 else LEFT
    tree = cloud(random, int(random.integers(1, 400)), spread=0.12)
    turn = Rotation.from_euler("xyz", angles[None]).as_quat(scalar_first=True)
    at = random_hand(random, hand, 0.03)._replace(orientation=turn)
    state, paper = tick_state(ROOT**2), zeroed(PAPER_STATE)[0]
    paper.closed = True
    set_pose(hand, state.pose, at)
    frustum_shapes(hand.arrays(), paper.frustum)
    detect(hand.arrays(), hand.palm_tree.arrays(), tree.arrays(), GROWTH, state, paper)
    return hand, at, state, paper


@given(SEEDS, ANGLES)
@settings(max_examples=15)
def test_palm_rows_are_the_first_order_of_eq_8_in_position_and_euler_angles(seed: int, angles: FloatArray) -> None:
    _, at, state, paper = scene(seed, angles)
    count = int(state.candidates.count[15])
    euler_axes(angles, paper.axes)
    palm_rows(count, state, paper)
    common, rhs, normal = state.problem.common, state.problem.rhs, paper.normal
    hand_center = np.stack([paper.hand_x, paper.hand_y, paper.hand_z], axis=1)[:count]
    object_center = np.stack([paper.object_x, paper.object_y, paper.object_z], axis=1)[:count]
    total = paper.hand_radius[:count] + paper.object_radius[:count]

    def away(q: FloatArray) -> FloatArray:
        return np.asarray(q[:3] + hand_center @ Rotation.from_euler("xyz", q[3:]).as_matrix().T - object_center)

    def constraint(q: FloatArray) -> FloatArray:
        return np.asarray((away(q) ** 2).sum(axis=1) - total**2)

    q = np.concatenate([at.position[0], angles])
    value = constraint(q)
    np.testing.assert_allclose(-2.0 * total * rhs[:count], value, atol=1e-14)
    for j, unit in enumerate(np.eye(6)):
        rate = (constraint(q + STEP * unit) - constraint(q - STEP * unit)) / (2.0 * STEP)
        np.testing.assert_allclose(2.0 * total * common[j, :count] * ROOT[j], rate, atol=ACCURACY)
    length = np.linalg.norm(away(q), axis=1)
    np.testing.assert_allclose(np.linalg.norm(normal[:, :count], axis=0), length / total, rtol=1e-12)


@given(SEEDS, ANGLES, st.integers(0, 4))
@settings(max_examples=25)
def test_finger_rows_are_the_first_order_of_eq_10_and_13_in_joint_angles(seed: int, angles: FloatArray, f: int) -> None:
    hand, at, state, paper = scene(seed, angles)
    state.haptic.flexion[f] = at.flexion[0, f] + [0.1, -0.2, 0.3]
    rows = finger_program(hand.arrays(), f, state, paper)

    def constraints(flexion: FloatArray) -> tuple[FloatArray, FloatArray]:
        angles = at.flexion[0].copy()
        angles[f] = flexion
        joints = hand.joints(at.position[0], at.orientation[0], angles, at.abduction[0])
        values, sizes = [], []
        for k in range(3):
            body, count = 3 * f + k, state.candidates.count[3 * f + k]
            center = np.stack([paper.x[body], paper.y[body], paper.z[body]], axis=1)[:count]
            radius = paper.radius[body, :count]
            cone = frustum_of(hand, joints, f, k)
            excess, along = frustum_excess(cone, center, radius)
            cosine = np.linalg.norm(cone.e - cone.d) / np.hypot(np.linalg.norm(cone.e - cone.d), cone.r1 - cone.r2)
            limit = radius / cosine + along * (cone.r1 - cone.r2) + cone.r2
            total = hand.radius[f, k + 1] + radius
            apart = np.linalg.norm(center - joints[f, k + 1], axis=1)
            for i in range(count):
                if paper.kind[body, i] & ON_FRUSTUM:
                    values.append((excess[i] + limit[i]) ** 2 - limit[i] ** 2)
                    sizes.append(2.0 * limit[i] / cosine)
                if paper.kind[body, i] & ON_SPHERE:
                    values.append(apart[i] ** 2 - total[i] ** 2)
                    sizes.append(2.0 * total[i])
        return np.array(values), np.array(sizes)

    value, size = constraints(at.flexion[0, f])
    assert rows == len(value)
    if rows == 0:
        return
    np.testing.assert_allclose(-size * state.problem.rhs[:rows], value, atol=1e-13)
    for j, unit in enumerate(np.eye(3)):
        ahead, behind = (constraints(at.flexion[0, f] + sign * STEP * unit)[0] for sign in (1.0, -1.0))
        row = size * state.problem.block[j, :rows] * ROOT[6 + 3 * f + j]
        np.testing.assert_allclose(row, (ahead - behind) / (2.0 * STEP), atol=ACCURACY)
    np.testing.assert_allclose(paper.target[:3] / ROOT[6], [0.1, -0.2, 0.3], atol=1e-12)


BALL = bumpy_ball(300)
INDEX = 1


def paper(hand: HandModel, tree: SphereTree, motion: HandConfiguration, **options: object) -> TickRecord:
    record = HandSolver(hand, tree.arrays(), SolverOptions(method="paper", **options)).run(*motion)  # type: ignore[arg-type]
    for name in UNTIMED:
        assert np.isfinite(getattr(record, name)).all(), name
    return record


def under_the_index(hand: HandModel, flexion: FloatArray, radius: float) -> SphereTree:
    """One sphere that touches the pad of the index's distal phalanx from below."""
    joints = hand.joints(np.zeros(3), [1.0, 0.0, 0.0, 0.0], flexion, np.zeros(5))[INDEX]
    u = (joints[3] - joints[2]) / np.linalg.norm(joints[3] - joints[2])
    below = np.cross(u, [1.0, 0.0, 0.0])
    below *= -np.sign(below[2]) / np.linalg.norm(below)
    middle = 0.4 * joints[2] + 0.6 * joints[3]
    return sphere_tree((middle + (hand.radius[INDEX, 2] + radius) * below)[None], np.array([radius]))


@pytest.mark.parametrize("hand", [RIGHT, LEFT], ids=["right", "left"])
@pytest.mark.parametrize("radius", [0.003, 0.02, 0.04])
def test_a_single_contact_converges_to_the_known_optimum(hand: HandModel, radius: float) -> None:
    # The index bends against one sphere; the palm is free. scipy minimises the coupling over the true distance.
    free = np.zeros((5, 3))
    free[INDEX] = [0.2, 0.3, 0.2]
    bent = free.copy()
    bent[INDEX] = [0.45, 0.6, 0.4]
    tree = under_the_index(hand, free, radius)
    start, goal = still(np.zeros(3), flexion=0.7 * free), still(np.zeros(3), flexion=bent)
    record = paper(hand, tree, start.line(goal, 299).hold(60))
    assert not record.status.any()
    np.testing.assert_array_equal(record.position, 0.0)

    def gap(angles: FloatArray) -> float:
        posed = bent.copy()
        posed[INDEX] = angles
        pairs = brute_pairs(hand, tree.leaf_center, tree.leaf_radius, still(np.zeros(3), flexion=posed))
        return 1e3 * float(pairs[3 * INDEX : 3 * INDEX + 3].min())

    best = minimize(
        lambda angles: float(((angles - bent[INDEX]) ** 2).sum()),
        record.flexion[-1, INDEX] + 1e-3,
        method="SLSQP",
        constraints={"type": "ineq", "fun": gap},
        options={"ftol": 1e-14, "maxiter": 200},
    )
    assert best.success
    assert abs(gap(record.flexion[-1, INDEX])) < 1e-6
    np.testing.assert_allclose(record.flexion[-1, INDEX], best.x, atol=2e-5)
    # And on the way, too: a linearisation that looks half a millimetre ahead is good to its second order.
    assert record_clearance(hand, tree, record).min() > -1e-5


def test_random_targets_make_it_penetrate_and_it_says_so() -> None:
    # The stress of algorithm.md: what the project's own methods stand, this one does not, and the record must show it.
    record = paper(RIGHT, BALL, random_targets(RIGHT, 3000, 0))
    clearance = record_clearance(RIGHT, BALL, record)
    assert clearance.min() < -1e-3
    assert (record.status & STATUS_STUCK).any()
    stuck = record.status & STATUS_STUCK > 0
    assert record.lag[stuck].max() > 0.0 and not record.lag[~stuck].any()
    assert (record.flexion >= RIGHT.flexion_min - 1e-6).all() and (record.flexion <= RIGHT.flexion_max + 1e-6).all()


def test_a_part_that_has_no_solution_stays_until_the_haptic_one_is_free() -> None:
    # A jump to the middle of a ball is not seen coming. Out again, palm and fingers follow.
    inside = still([0.0, -0.03, 0.0], flexion=CURL, ticks=20)
    motion = sequence(still([0.0, 0.0, 0.3], ticks=5), inside, still([0.0, 0.0, 0.3], ticks=5))
    record = paper(RIGHT, BALL, motion)
    assert (record.status[6:25] & STATUS_STUCK).all()
    assert not record.status[25:].any()
    np.testing.assert_array_equal(record.position[25:], motion.position[25:])
    np.testing.assert_array_equal(record.flexion[25:], motion.flexion[25:])
