"""The method `penalty` against closed forms, the energy by brute force, and inputs that provoke."""

from typing import Any

import numpy as np
import pytest
from contact_scenes import ROOT, moved, row_matrix
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from sphere_scenes import brute_pairs, bumpy_ball, random_targets, sphere_tree

from hhsim.hand.configuration import HandConfiguration, sequence
from hhsim.hand.model import HandModel
from hhsim.kernels.tick.penalty import LIMIT_WEIGHT
from hhsim.kernels.tick.state import STATUS_START_INSIDE, WORK_CANDIDATES, WORK_QP_ITERATIONS, WORK_TOUCHING
from hhsim.motion.analytic_motion import still
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.methods.penalty import PenaltyEngine
from hhsim.solver.options import TOUCH, SolverOptions, Stiffness
from hhsim.trees.sphere_tree import SphereTree

HAND = HandModel.default("right")
BALL = bumpy_ball(600)
FREE = [0.0, 0.0, 0.4]
GRASP = still([0.0, -0.045, 0.052], flexion=0.5)
FAR = sphere_tree(np.array([[0.0, 0.0, 100.0]]), np.array([0.01]))


def solver_of(tree: SphereTree, **options: Any) -> HandSolver:
    return HandSolver(HAND, tree.arrays(), SolverOptions(method="penalty", **options))


def onto_the_ball(ticks: int = 400) -> HandConfiguration:
    return still(FREE).line(GRASP, 199).hold(ticks)


def shown(record: Any, tick: int) -> HandConfiguration:
    """The graphic hand of one tick."""
    return HandConfiguration.of(record).part(tick, tick + 1)


def rigid(contact: float, translation: float = 1000.0) -> Stiffness:
    """A hand that gives way in translation only."""
    return Stiffness(translation=translation, rotation=1e12, flexion=1e12, penalty=contact)


# ---------------------------------------------------------------------------------------------------- closed forms


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
    solver = solver_of(tree, stiffness=rigid(contact, coupling))
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
    solver = HandSolver(HAND, BALL.arrays(), options)
    motion = onto_the_ball(1500)
    record = solver.run(*motion)
    assert np.linalg.norm(record.total[-1]) > 1.0
    np.testing.assert_allclose(record.total[-1], record.palm_wrench[-1, :3], atol=1e-6)
    np.testing.assert_allclose(record.phalanx[-1].sum(axis=(0, 1)), record.total[-1], atol=1e-6)
    wanted, found = motion.part(len(motion.position) - 1, len(motion.position)), shown(record, -2)
    limited = np.isclose(found.flexion[0], HAND.flexion_min) | np.isclose(found.flexion[0], HAND.flexion_max)
    assert np.count_nonzero(limited) <= 1
    for variable in range(21):
        if variable >= 6 and limited.ravel()[variable - 6]:
            continue
        # So short, since a contact may be this near to letting go, where the energy's curvature jumps.
        step = 1e-8
        up, down = (
            energy(BALL, options, wanted, moved(found, sign * step * np.eye(21)[variable])) for sign in (1.0, -1.0)
        )
        assert abs(up - down) / (2.0 * step) < 1e-5, variable


@pytest.mark.parametrize("stiffness", [1e3, 1e5, 1e6])
def test_in_a_frozen_hold_energy_never_grows(stiffness: float) -> None:
    options = SolverOptions(method="penalty", stiffness=Stiffness(penalty=stiffness))
    solver = HandSolver(HAND, BALL.arrays(), options)
    motion = onto_the_ball(0)
    solver.run(*motion)
    hold = GRASP.hold(299)
    record = solver.run(*hold)
    velocity = [np.diff(record.position, axis=0), np.diff(record.flexion, axis=0).reshape(-1, 15)]
    turns = Rotation.from_quat(record.orientation, scalar_first=True)
    velocity.insert(1, (turns[1:] * turns[:-1].inv()).as_rotvec())
    speed = np.concatenate(velocity, axis=1) / options.period
    kinetic = 0.5 * options.response**2 * speed**2 @ options.stiffness.diagonal()
    total = np.array([energy(BALL, options, hold.part(0, 1), shown(record, t)) for t in range(1, 300)]) + kinetic
    assert total[0] > total[-1]
    # What is linearised is curved: to second order in steps that are micrometres by then.
    assert (np.diff(total) <= 1e-9 * total[0]).all()
    assert kinetic[-1] < 1e-20


def test_the_step_is_the_least_value_of_its_function() -> None:
    options = SolverOptions(method="penalty", linearisations=40)
    solver = HandSolver(HAND, BALL.arrays(), options)
    motion = random_targets(HAND, 600, 3, sweep=True)
    assert isinstance(solver.engine, PenaltyEngine)
    loaded, rounds = 0, 0
    share = options.response / options.period
    alpha = (1.0 + share) ** 2
    for tick in range(600):
        record = solver.run(*motion.part(tick, tick + 1))
        state, work = solver.workspace.states[0], solver.engine.method.work[0]
        total = int(state.contacts.start[6])
        if total == 0:
            continue
        rows = row_matrix(state) / ROOT
        y = work.step.copy()
        push = work.weight[:total] * np.maximum(0.0, work.threshold[:total] - rows @ y)
        limit = LIMIT_WEIGHT * (np.maximum(0.0, y - work.highest) + np.minimum(0.0, y - work.lowest))
        gradient = alpha * y - work.bias - rows.T @ push + limit
        scale = np.abs(work.bias).max() + np.abs(rows.T @ push).max() + np.abs(limit).max()
        # A joint at its limit is held by what rounding leaves of so stiff a spring's length.
        rounding = np.where(limit != 0.0, 4.0 * LIMIT_WEIGHT * np.spacing(np.abs(y)), 0.0)
        assert (np.abs(gradient) <= 1e-8 * scale + rounding).all(), tick
        np.testing.assert_allclose(
            record.total[0], state.contacts.normal[:, :total] @ push, rtol=1e-9, atol=1e-9 * push.sum()
        )
        loaded += bool(push.any())
        rounds = max(rounds, int(record.work[0, WORK_QP_ITERATIONS]))
    assert loaded > 100
    assert 1 < rounds < 40


# --------------------------------------------------------------------------------------------------------- stress


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("options", [{}, {"linearisations": 1}, {"stiffness": Stiffness(penalty=1e7)}])
def test_random_targets_leave_the_hand_finite_and_near(options: dict[str, Any], seed: int) -> None:
    solver = solver_of(BALL, **options)
    motion = random_targets(HAND, 1800, seed, sweep=True)
    record = solver.run(*motion)
    for values in record:
        assert np.isfinite(values).all()
    assert np.linalg.norm(record.position, axis=1).max() < 0.5
    assert (record.flexion >= HAND.flexion_min - 1e-12).all()
    assert (record.flexion <= HAND.flexion_max + 1e-12).all()
    np.testing.assert_allclose(np.linalg.norm(record.orientation, axis=1), 1.0, atol=1e-12)
    assert (record.status & ~STATUS_START_INSIDE == 0).all()


@pytest.mark.parametrize("seed", [0, 1])
def test_no_pair_is_missed_however_deep_and_fast(seed: int) -> None:
    solver = solver_of(BALL)
    motion = random_targets(HAND, 480, seed, sweep=True)
    deepest = 0.0
    record = solver.run(*motion)
    for tick in range(0, 480, 5):
        distance = brute_pairs(HAND, BALL.leaf_center, BALL.leaf_radius, shown(record, tick))
        assert record.work[tick, WORK_TOUCHING] == np.count_nonzero(distance <= TOUCH)
        deepest = min(deepest, distance.min())
    assert deepest < -3e-3, "these targets are to push the hand deep inside"


def test_a_hand_too_deep_for_the_arrays_is_pushed_by_its_deepest_pairs() -> None:
    crowd = bumpy_ball(8000)
    solver = solver_of(crowd)
    solver.run(*still(FREE))
    pose = still([0.0, -0.02, 0.0], flexion=0.6)
    assert np.count_nonzero(brute_pairs(HAND, crowd.leaf_center, crowd.leaf_radius, pose) < 0.0) > 4096
    motion = still(FREE).line(pose, 3).hold(200)
    record = solver.run(*motion)
    assert not record.status.any()
    assert record.work[:, WORK_CANDIDATES].max() > 2048
    for values in record:
        assert np.isfinite(values).all()


def test_a_joint_is_shown_at_its_limit_and_passes_the_force_on() -> None:
    wild = np.where(np.arange(15).reshape(5, 3) % 2 == 0, 9.0, -9.0)
    record = solver_of(FAR).run(*sequence(still(np.zeros(3)), still(np.zeros(3), flexion=wild, ticks=60)))
    np.testing.assert_allclose(record.flexion[-1], np.where(wild > 0.0, HAND.flexion_max, HAND.flexion_min), atol=1e-12)
    # A finger that cannot bend further back carries the palm with it: the balance holds with joints at their limits.
    flat = still([0.0, -0.09, 0.01], flexion=np.array(HAND.flexion_min))
    motion = still(FREE).line(flat, 299).hold(300)
    record = solver_of(BALL).run(*motion)
    assert np.linalg.norm(record.total[-1]) > 0.5
    assert np.linalg.norm(record.phalanx[-1, 2, 0]) > 0.5
    np.testing.assert_allclose(record.flexion[-1, 2], HAND.flexion_min[2], atol=1e-12)
    np.testing.assert_allclose(record.total[-1], record.palm_wrench[-1, :3], atol=1e-5)
