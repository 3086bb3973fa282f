"""What the solver promises whatever the input: no penetration, limits kept, the same bytes every time."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sampled import sampled
from sphere_scenes import (
    BALL_RADIUS,
    CURL,
    UNTIMED,
    brute_pairs,
    bumpy_ball,
    cloud,
    random_targets,
    record_clearance,
    sphere_tree,
)

from hhsim.arrays import FloatArray
from hhsim.errors import HhsimError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.kernels.jit import JIT_ENABLED
from hhsim.kernels.tick.block import TickRecord, run_block
from hhsim.kernels.tick.state import STATUS_STUCK
from hhsim.motion.analytic_motion import still
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.options import SolverOptions, Stiffness
from hhsim.trees.sphere_tree import SphereTree

RIGHT = HandModel.default("right")
LEFT = HandModel.default("left")
METHODS = ("coupled", "progressive")
DEEPEST = 1e-6
"""Penetration [m] that the acceptance figure allows; the solver aims at none."""
TREES = {leaves: bumpy_ball(leaves) for leaves in (300, 1200, 4000)}


def assert_sound(hand: HandModel, tree: SphereTree, record: TickRecord) -> FloatArray:
    """Finite, within the limits, free of penetration by brute force, joints where pose and angles put them."""
    for name in UNTIMED:
        assert np.isfinite(getattr(record, name)).all(), name
    np.testing.assert_allclose(np.linalg.norm(record.orientation, axis=1), 1.0, atol=1e-12)
    assert (record.flexion >= hand.flexion_min - 1e-9).all()
    assert (record.flexion <= hand.flexion_max + 1e-9).all()
    for tick in range(0, len(record.position), 97):
        placed = hand.joints(
            record.position[tick], record.orientation[tick], record.flexion[tick], record.abduction[tick]
        )
        np.testing.assert_allclose(record.joints[tick], placed, atol=1e-12)
    clearance = record_clearance(hand, tree, record)
    assert clearance.min() >= -DEEPEST
    return clearance


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    ("leaves", "seed", "sweep"),
    sampled(
        [(300, 0, False), (300, 1, True), (1200, 2, False), (1200, 3, True), (4000, 4, False), (4000, 5, True)],
        lambda place, case: place == 1,
    ),
)
def test_random_hands_never_penetrate(method: str, leaves: int, seed: int, sweep: bool) -> None:
    hand = LEFT if seed % 3 == 0 else RIGHT
    tree = TREES[leaves]
    solver = HandSolver(hand, tree.arrays(), SolverOptions(method=method))
    record = solver.run(*random_targets(hand, 2400, seed, sweep=sweep))
    clearance = assert_sound(hand, tree, record)
    touching = clearance.min(axis=1) < 1e-5
    assert touching.mean() > 0.3, "the scene hardly provokes"
    stuck = record.status & STATUS_STUCK > 0
    assert stuck.mean() < 0.01


@given(st.integers(0, 2**32 - 1), st.sampled_from(METHODS), st.booleans())
@settings(max_examples=12)
def test_random_hands_never_penetrate_random_spheres(seed: int, method: str, sweep: bool) -> None:
    # Sizes from 0.1 to 10 mm, gaps that a finger fits into and some that it does not.
    random = np.random.default_rng(seed)
    tree = cloud(random, int(random.integers(5, 300)), spread=0.06)
    solver = HandSolver(RIGHT, tree.arrays(), SolverOptions(method=method))
    record = solver.run(*random_targets(RIGHT, 360, seed, hold=40, sweep=sweep))
    assert_sound(RIGHT, tree, record)


@pytest.mark.parametrize("method", METHODS)
def test_abduction_sweeps_a_finger_against_the_ball_but_not_into_it(method: str) -> None:
    # The glove's abduction passes through unchanged where nothing is in the way; a ball beside each finger is.
    flexion = np.full((5, 3), 0.1)
    spread = np.zeros((1201, 5))
    spread[1:] = 0.3 * np.sin(np.arange(1200) / 60.0)[:, None] * [1.0, 1.0, -1.0, 1.0, -1.0]
    spread = np.clip(spread, RIGHT.abduction_min, RIGHT.abduction_max)
    joints = RIGHT.joints(np.zeros(3), [1.0, 0.0, 0.0, 0.0], flexion, np.zeros(5))
    center = joints[:, 2] + [[-0.01, 0.0, 0.02], [-0.018, 0.0, 0.0], [0.0, 0.0, 0.03], [0.0, 0.0, 0.03], [0.019, 0, 0]]
    tree = sphere_tree(center, np.full(5, 0.006))
    motion = still(np.zeros(3), flexion=flexion, ticks=1201)._replace(abduction=spread)
    motion.position[0] = [0.0, 0.0, -0.3]
    record = HandSolver(RIGHT, tree.arrays(), SolverOptions(method=method)).run(*motion)
    clearance = assert_sound(RIGHT, tree, record)
    assert (clearance.min(axis=1) < 1e-5).sum() > 100
    free = (clearance[:, 6:9].min(axis=1) > 2e-3) & (record.lag == 0.0)
    assert free.sum() > 900
    np.testing.assert_allclose(record.abduction[free, 2], spread[free, 2], atol=1e-9)


@pytest.mark.parametrize(
    "stiffness", [Stiffness(1e-3, 1e-6, 1e-6), Stiffness(1e6, 1.0, 0.1), Stiffness(100.0, 50.0, 5.0)], ids=str
)
@pytest.mark.parametrize("method", METHODS)
def test_any_stiffness_keeps_the_promise(method: str, stiffness: Stiffness) -> None:
    tree = TREES[300]
    options = SolverOptions(method=method, stiffness=stiffness)
    record = HandSolver(RIGHT, tree.arrays(), options).run(*random_targets(RIGHT, 600, 7))
    assert_sound(RIGHT, tree, record)


@pytest.mark.parametrize(
    ("method", "force"),
    [("coupled", "kkt"), ("progressive", "kkt"), ("paper", "paper"), ("paper", "kkt"), ("penalty", "kkt")],
)
def test_the_same_input_gives_the_same_bytes_in_blocks_of_any_size(method: str, force: str) -> None:
    tree, options = TREES[300].arrays(), SolverOptions(method=method, force=force)
    motion = random_targets(RIGHT, 540, 3, sweep=True)
    whole, again = (HandSolver(RIGHT, tree, options).run(*motion) for _ in range(2))
    for name in UNTIMED:
        assert getattr(whole, name).tobytes() == getattr(again, name).tobytes(), name
    for size in (1, 7, 512):
        solver = HandSolver(RIGHT, tree, options)
        blocks = [solver.run(*motion.part(first, first + size)) for first in range(0, 540, size)]
        for name in UNTIMED:
            joined = np.concatenate([getattr(block, name) for block in blocks])
            assert joined.tobytes() == getattr(whole, name).tobytes(), (name, size)


@pytest.mark.skipif(not JIT_ENABLED, reason="without the compiler there are no signatures")
def test_read_only_input_is_solved_by_the_same_kernel() -> None:
    tree, motion = TREES[300], random_targets(RIGHT, 10, 0)
    once = HandSolver(RIGHT, tree.arrays(), SolverOptions()).run(*motion)
    compiled = len(run_block.signatures)  # type: ignore[attr-defined]
    for values in motion:
        values.flags.writeable = False
    again = HandSolver(RIGHT, tree.arrays(), SolverOptions()).run(*motion)
    assert len(run_block.signatures) == compiled  # type: ignore[attr-defined]
    np.testing.assert_array_equal(again.position, once.position)


def test_no_ticks_are_no_work() -> None:
    solver = HandSolver(RIGHT, TREES[300].arrays(), SolverOptions())
    record = solver.run(*still([0.0, 0.0, 0.3]).part(0, 0))
    assert len(record.status) == 0


def test_frozen_input_comes_to_rest() -> None:
    # The figure: the force's variation falls below 1e-6 within 20 ticks of a frozen input.
    goal = still([0.0, -0.045, 0.052], flexion=CURL)
    start = still([0.0, -0.045, 0.15])
    for method in METHODS:
        for leaves in (300, 4000):
            solver = HandSolver(RIGHT, TREES[leaves].arrays(), SolverOptions(method=method))
            solver.run(*start.line(goal, 299))
            record = solver.run(*goal.hold(59))
            size = np.linalg.norm(record.total, axis=1)
            assert size[-1] > 1.0
            assert (np.abs(np.diff(size))[20:] / size[-1] < 1e-6).all()


def test_spheres_in_one_place_and_of_no_size_are_sound() -> None:
    center = np.concatenate([np.zeros((40, 3)), np.full((40, 3), 1e-9), [[0.0, 0.0, 0.02]]])
    radius = np.concatenate([np.full(40, BALL_RADIUS), np.full(40, 1e-6), [0.0]])
    tree = sphere_tree(center, radius)
    for method in METHODS:
        record = HandSolver(RIGHT, tree.arrays(), SolverOptions(method=method)).run(*random_targets(RIGHT, 300, 9))
        assert_sound(RIGHT, tree, record)


def test_too_many_contacts_are_an_error_that_says_what_to_do() -> None:
    tip = RIGHT.joints([0.0, 0.0, 0.4], [1.0, 0.0, 0.0, 0.0], np.zeros((5, 3)), np.zeros(5))[1, 3]
    crowd = sphere_tree(np.repeat((tip - [0.0, 0.0, 0.05])[None], 5000, axis=0), np.full(5000, 1e-3))
    solver = HandSolver(RIGHT, crowd.arrays(), SolverOptions())
    motion = still([0.0, 0.0, 0.4]).line(still([0.0, 0.0, 0.34]), 59)
    with pytest.raises(HhsimError, match=r"margin.*coarser"):
        solver.run(*motion)


def test_more_contacts_than_fit_within_a_step_make_it_shorter_and_the_hand_arrives() -> None:
    joints = RIGHT.joints([0.0, 0.0, 0.4], [1.0, 0.0, 0.0, 0.0], np.zeros((5, 3)), np.zeros(5))
    # Under three fingertips 2,000 spheres each, one below the other within a millimetre.
    below = np.outer(np.linspace(0.0, 8e-4, 2000), [0.0, 0.0, -1.0])
    tops = [joints[f, 3] - [0.0, 0.0, RIGHT.radius[f, 3] + 0.021] for f in (1, 2, 3)]
    columns = sphere_tree(np.concatenate([top + below for top in tops]), np.full(6000, 1e-3))
    motion = still([0.0, 0.0, 0.4]).line(still([0.0, 0.0, 0.37]), 99)
    for method in METHODS:
        record = HandSolver(RIGHT, columns.arrays(), SolverOptions(method=method)).run(*motion)
        assert_sound(RIGHT, columns, record)
        last = HandConfiguration.of(record).part(-1)
        gaps = brute_pairs(RIGHT, columns.leaf_center, columns.leaf_radius, last)[[5, 8, 11]].min(axis=1)
        assert (gaps < 2e-6).all()


def test_place_puts_the_graphic_hand_where_it_is_told() -> None:
    solver = HandSolver(RIGHT, TREES[300].arrays(), SolverOptions())
    place = still([0.0, 0.0, 0.2], flexion=0.2).at(0)
    solver.place(*place)
    np.testing.assert_array_equal(solver.workspace.states[0].pose.position, place.position)
    record = solver.run(*still([0.0, 0.0, 0.2], flexion=0.2))
    np.testing.assert_allclose(record.joints[0], RIGHT.joints(*place), atol=1e-15)
