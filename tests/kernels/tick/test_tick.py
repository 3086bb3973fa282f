"""One tick: what it takes, never does, and reports; method `penalty` by closed forms and the energy by brute force."""

from typing import Any

import numpy as np
import pytest
from conftest import sampled
from contact_scenes import moved
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from sphere_scenes import brute_pairs, bumpy_ball, object_tree, random_targets, record_clearance, sphere_tree

from hhsim.hand.configuration import HandConfiguration, sequence
from hhsim.hand.model import HandModel
from hhsim.kernels.tick.state import (
    STATUS_INPUT_INVALID,
    STATUS_LAG,
    STATUS_START_INSIDE,
    WORK_CANDIDATES,
    WORK_LINEARISATIONS,
    WORK_TOUCHING,
)
from hhsim.motion.analytic_motion import still
from hhsim.solver.options import TOUCH, SolverOptions, Stiffness
from hhsim.solver.solver import HandSolver
from hhsim.trees.sphere_tree import SphereTree

HAND = HandModel.default("right")
BALL = bumpy_ball(300)
METHODS = ("coupled", "progressive")
FREE = [0.0, 0.0, 0.4]


def solver_at(tree: SphereTree, start: HandConfiguration, **options: Any) -> HandSolver:
    """A solver whose graphic hand is at the first configuration of a motion, free of the object."""
    solver = HandSolver(HAND, tree.arrays(), SolverOptions(**options))
    record = solver.run(*start.part(0, 1))
    assert record.status[0] == 0
    return solver


@given(st.integers(0, 2**32 - 1), st.sampled_from(METHODS))
@settings(max_examples=30)
def test_in_free_space_the_hand_goes_all_the_way(seed: int, method: str) -> None:
    random = np.random.default_rng(seed)
    target = random_targets(HAND, 1, seed, sweep=True)
    target = target._replace(position=random.normal(0.0, 0.02, (1, 3)) + [[0.0, 0.0, 0.5]])
    solver = solver_at(BALL, still(FREE), method=method)
    record = solver.run(*target)
    assert record.status[0] == 0
    assert record.lag[0] == 0.0
    np.testing.assert_allclose(record.position, target.position, atol=1e-15)
    np.testing.assert_allclose(record.flexion, target.flexion, atol=1e-12)
    np.testing.assert_allclose(record.abduction, target.abduction, atol=1e-12)
    same = np.abs(np.sum(record.orientation * target.orientation, axis=1))
    np.testing.assert_allclose(same, 1.0, atol=1e-12)
    np.testing.assert_allclose(record.joints[0], HAND.joints(*target.at(0)), atol=1e-12)


BAD = {
    "NaN position": ("position", (1,), np.nan),
    "infinite position": ("position", (2,), np.inf),
    "position nowhere near": ("position", (1,), 1e200),
    "position too far": ("position", (1,), -1e7),
    "NaN quaternion": ("orientation", (0,), np.nan),
    "zero quaternion": ("orientation", (slice(None),), 0.0),
    "NaN flexion": ("flexion", (3, 1), np.nan),
    "infinite flexion": ("flexion", (4, 2), -np.inf),
    "NaN abduction": ("abduction", (2,), np.nan),
    "two infinities that cancel": ("flexion", (0, slice(0, 2)), np.array([np.inf, -np.inf])),
}


WAYS: list[dict[str, Any]] = [*({"method": name} for name in (*METHODS, "penalty")), {"qp": "quadprog"}]


@pytest.mark.parametrize(
    ("name", "options"),
    sampled(
        [(name, options) for options in WAYS for name in BAD],
        lambda place, case: place < len(BAD) or case[0] == "NaN position",
    ),
    ids=str,
)
def test_input_that_is_none_is_held(name: str, options: dict[str, Any]) -> None:
    channel, index, value = BAD[name]
    motion = still([0.0, -0.045, 0.052], flexion=0.4, ticks=6)
    motion = sequence(still(FREE), motion)
    bad = motion._replace(**{channel: getattr(motion, channel).copy()})
    getattr(bad, channel)[(slice(2, 4), *index)] = value
    fine, found = (HandSolver(HAND, BALL.arrays(), SolverOptions(**options)).run(*given) for given in (motion, bad))
    np.testing.assert_array_equal(
        found.status & STATUS_INPUT_INVALID > 0, [False, False, True, True, False, False, False]
    )
    for kept in ("position", "orientation", "flexion", "abduction", "joints", "total"):
        np.testing.assert_array_equal(getattr(found, kept), getattr(fine, kept))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    ("tree", "position"),
    # In the middle thousands of palm pairs overlap: more than the tick's lists are made for.
    [(BALL, [0.0, -0.02, 0.02]), (object_tree("sphere", 3), [0.0, 0.0, 0.0])],
    ids=["inside", "in the middle"],
)
def test_starting_inside_begins_at_a_free_place(tree: SphereTree, position: list[float], method: str) -> None:
    motion = still(position, flexion=0.5, ticks=300)
    record = HandSolver(HAND, tree.arrays(), SolverOptions(method=method)).run(*motion)
    inside = record.status & STATUS_START_INSIDE > 0
    assert inside[0]
    assert not inside[1:].any()
    assert 0.0 <= record_clearance(HAND, tree, record).min() < 1e-5
    # As near as it can come: it ends in contact, and no further away than the ball is wide.
    assert record.work[-1, WORK_TOUCHING] > 0
    assert np.linalg.norm(record.position[-1] - motion.position[-1]) < 0.08


@pytest.mark.parametrize("method", METHODS)
def test_what_a_tick_counts(method: str) -> None:
    goal = still([0.0, -0.045, 0.052], flexion=0.5)
    motion = still(FREE).line(goal, 199).hold(50)
    record = solver_at(BALL, motion, method=method).run(*motion)
    clearance = record_clearance(HAND, BALL, record)
    touched = clearance.min(axis=1) <= TOUCH
    np.testing.assert_array_equal(record.work[:, WORK_TOUCHING] > 0, touched)
    assert touched[-1]
    assert record.work[-1, WORK_CANDIDATES] >= record.work[-1, WORK_TOUCHING]
    assert (record.work[:, WORK_LINEARISATIONS] <= SolverOptions().linearisations).all()
    lag = record.status & STATUS_LAG > 0
    np.testing.assert_array_equal(record.lag[lag] > 0.0, True)
    assert not record.status[-1]


FINE_BALL = bumpy_ball(600)
GRASP = still([0.0, -0.045, 0.052], flexion=0.5)
FAR = sphere_tree(np.array([[0.0, 0.0, 100.0]]), np.array([0.01]))


def solver_of(tree: SphereTree, **options: Any) -> HandSolver:
    return HandSolver(HAND, tree.arrays(), SolverOptions(method="penalty", **options))


@given(st.floats(1e2, 1e6), st.floats(1e2, 1e4), st.floats(1e-5, 2e-3), st.integers(1, 4), st.integers(0, 2**32 - 1))
@settings(max_examples=30)
def test_the_depth_of_one_contact_is_that_of_two_springs_in_a_row(
    contact: float, coupling: float, command: float, spheres: int, seed: int
) -> None:
    # A command that is `command` deep along the normal: k_t (command - depth) = n k depth, whatever the masses are.
    random = np.random.default_rng(seed)
    flexion = random.uniform(0.0, 0.5, (5, 3))
    turn = Rotation.random(random_state=random).as_quat(scalar_first=True)
    joints = HAND.joints(np.zeros(3), turn, flexion, np.zeros(5))
    along = joints[1, 3] - joints[1, 2]
    normal = along / np.linalg.norm(along)
    radius = 0.004
    center = joints[1, 3] + (HAND.radius[1, 3] + radius) * normal
    tree = sphere_tree(np.repeat(center[None], spheres, axis=0), np.full(spheres, radius))
    # A hand that gives way in translation only.
    stiffness = Stiffness(translation=coupling, rotation=1e12, flexion=1e12, penalty=contact)
    solver = solver_of(tree, stiffness=stiffness)
    record = solver.run(
        *sequence(still(-0.02 * normal, turn, flexion), still(command * normal, turn, flexion, ticks=400))
    )
    depth = command * coupling / (coupling + spheres * contact)
    assert normal @ record.position[-1] == pytest.approx(depth, rel=1e-6)
    np.testing.assert_allclose(record.total[-1], -spheres * contact * depth * normal, rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(record.phalanx[-1, 1, 2], record.total[-1], rtol=1e-12)
    assert record.work[-1, WORK_TOUCHING] == spheres


@pytest.mark.parametrize("response", [2e-4, 1e-3, 7e-3])
@pytest.mark.parametrize("period", [1e-3, 2e-4])
def test_in_free_space_every_degree_of_freedom_follows_critically_damped(response: float, period: float) -> None:
    # Backward Euler of x'' τ² + 2 τ x' + x = 1 has the double root τ / (τ + h).
    solver = solver_of(FAR, response=response, period=period)
    turn = Rotation.from_rotvec([0.0, 0.3, 0.0]).as_quat(scalar_first=True)
    goal = still([0.01, -0.02, 0.03], turn, 0.4, 0.1)
    solver.run(*still(np.zeros(3)))
    record = solver.run(*goal.hold(59))
    tick = np.arange(1, 61)
    left = (1.0 + tick * period / (response + period)) * (response / (response + period)) ** tick
    np.testing.assert_allclose(record.position, (1.0 - left)[:, None] * goal.position, atol=1e-12)
    np.testing.assert_allclose(record.flexion, (1.0 - left)[:, None, None] * goal.flexion[:1], atol=1e-12)
    angle = 2.0 * np.arctan2(record.orientation[:, 2], record.orientation[:, 0])
    np.testing.assert_allclose(angle, 0.3 * (1.0 - left), atol=1e-12)
    np.testing.assert_array_equal(record.abduction, np.full((60, 5), 0.1))


def energy(tree: SphereTree, options: SolverOptions, wanted: HandConfiguration, found: HandConfiguration) -> float:
    """Potential energy [J] of coupling and contacts, by brute force over all pairs."""
    turn = Rotation.from_quat(wanted.orientation[0], scalar_first=True)
    turn *= Rotation.from_quat(found.orientation[0], scalar_first=True).inv()
    bend = (wanted.flexion[0] - found.flexion[0]).ravel()
    off = np.concatenate([wanted.position[0] - found.position[0], turn.as_rotvec(), bend])
    depth = np.maximum(0.0, -brute_pairs(HAND, tree.leaf_center, tree.leaf_radius, found))
    coupling = options.stiffness.diagonal() @ off**2
    return float(0.5 * (coupling + options.stiffness.penalty * np.sum(depth**2)))


@pytest.mark.parametrize("stiffness", [1e3, 1e5])
def test_at_rest_forces_balance_the_coupling_and_the_energy_is_least(stiffness: float) -> None:
    options = SolverOptions(method="penalty", stiffness=Stiffness(penalty=stiffness))
    solver = HandSolver(HAND, FINE_BALL.arrays(), options)
    motion = still(FREE).line(GRASP, 199).hold(1500)
    record = solver.run(*motion)
    assert np.linalg.norm(record.total[-1]) > 1.0
    np.testing.assert_allclose(record.total[-1], record.palm_wrench[-1, :3], atol=1e-6)
    np.testing.assert_allclose(record.phalanx[-1].sum(axis=(0, 1)), record.total[-1], atol=1e-6)
    wanted, found = motion.part(len(motion.position) - 1), HandConfiguration.of(record).part(-2, -1)
    limited = np.isclose(found.flexion[0], HAND.flexion_min) | np.isclose(found.flexion[0], HAND.flexion_max)
    assert np.count_nonzero(limited) <= 1
    for variable in range(21):
        if variable >= 6 and limited.ravel()[variable - 6]:
            continue
        # So short, since a contact may be this near to letting go, where the energy's curvature jumps.
        step = 1e-8
        up, down = (
            energy(FINE_BALL, options, wanted, moved(found, sign * step * np.eye(21)[variable])) for sign in (1.0, -1.0)
        )
        assert abs(up - down) / (2.0 * step) < 1e-5, variable


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("options", [{}, {"linearisations": 1}, {"stiffness": Stiffness(penalty=1e7)}])
def test_random_targets_leave_the_hand_finite_and_near(options: dict[str, Any], seed: int) -> None:
    solver = solver_of(FINE_BALL, **options)
    motion = random_targets(HAND, 1800, seed, sweep=True)
    record = solver.run(*motion)
    for values in record:
        assert np.isfinite(values).all()
    assert np.linalg.norm(record.position, axis=1).max() < 0.5
    assert (record.flexion >= HAND.flexion_min - 1e-12).all()
    assert (record.flexion <= HAND.flexion_max + 1e-12).all()
    np.testing.assert_allclose(np.linalg.norm(record.orientation, axis=1), 1.0, atol=1e-12)
    assert (record.status & ~STATUS_START_INSIDE == 0).all()
