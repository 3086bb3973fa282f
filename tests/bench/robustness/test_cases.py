"""Every hard case for the two methods that promise to pass it; the penetration once more, by brute force."""

import math
from collections.abc import Sequence
from functools import cache

import numpy as np
import pytest
from conftest import sampled
from hypothesis import example, given, settings
from hypothesis import strategies as st
from repair_scenes import referee_clearance
from sphere_scenes import brute_pairs, record_clearance

from hhsim.bench.figures import placed_of
from hhsim.bench.robustness.case import DEEPEST, HardCase, HardRun, Outcome, own_figures
from hhsim.bench.robustness.contact_cases import SLIDE
from hhsim.bench.robustness.input_cases import LOOP
from hhsim.bench.robustness.objects import INDEX, crossings, threaded
from hhsim.bench.robustness.random_targets import RandomTargets, StressOptions
from hhsim.bench.suites.hard import common_figures, hard_cases, run_scenes
from hhsim.hand.configuration import HandConfiguration, sequence
from hhsim.hand.model import HandModel
from hhsim.kernels.tick.state import WORK_TOUCHING
from hhsim.motion.analytic_motion import hold_readings
from hhsim.solver.options import SolverOptions

pytestmark = pytest.mark.slow

METHODS = ("coupled", "progressive")
CASES = {case.name: case for case in hard_cases(ticks=4 * LOOP)}
ON_MESH = {case.name: case for case in hard_cases(ticks=4 * LOOP, surfaces=("mesh",))}
QUICK = (
    ("sharp-edge", "coupled"),
    ("flat-finger", "progressive"),
    ("many-at-a-vertex", "coupled"),
    ("gimbal-lock", "progressive"),
)
"""On the mesh, every time; all of them by either method in the soak."""
SOME_PAIRS, ALL_PAIRS = 2e5, 4e9
"""Of bodies and spheres that brute force looks at in one run; beyond that it takes every nth tick."""
BY_BOTH = ("start-inside", "bad-samples")
"""By `progressive`, every time; by `coupled` all but those alike, and all by both in the soak."""
ALIKE = (
    *("doubled-constraints", "stiffness-ratios", "scaled-scene", "quaternion-flips"),
    *("palm-through-wall", "endurance"),
)
"""Scenes of which another is as hard; `make soak` has them."""


@cache
def scenes(name: str, seed: int = 0) -> Sequence[HardRun]:
    return tuple(ON_MESH[name].build(seed))


@cache
def on_spheres(name: str, method: str = "coupled") -> list[Outcome]:
    return run_scenes(scenes(name), SolverOptions(method=method))


def brute_force(outcome: Outcome, most_pairs: float) -> float:
    """Worst penetration [m] of the ticks at hand, every body against every leaf of the tree."""
    hand, tree = outcome.run.hand, outcome.run.tree
    record = outcome.ticks
    pairs = len(record.status) * tree.leaf_count * (15 + hand.palm_tree.leaf_count)
    every = math.ceil(pairs / most_pairs)
    clearance = record_clearance(hand, tree, type(record)._make(values[::every] for values in record))
    assert np.isfinite(clearance).all()
    return float(max(0.0, -clearance.min()))


def assert_passed(case: HardCase, outcomes: Sequence[Outcome], most_pairs: float) -> None:
    refusals = [outcome.refusal for outcome in outcomes if outcome.refusal]
    if case.may_refuse and refusals:
        return
    assert not refusals
    for figure in [*common_figures(outcomes), *own_figures(outcomes)]:
        assert figure.passed, f"{figure.name}: {figure.value}, bar {figure.bar} {figure.unit}"
    for outcome in outcomes:
        depth = brute_force(outcome, most_pairs) if outcome.options.surface == "spheres" else some_ticks(outcome)
        assert depth <= DEEPEST * outcome.run.scale, outcome.run.name


def some_ticks(outcome: Outcome, count: int = 2) -> float:
    """Worst penetration [m] of a few ticks, by the referee."""
    ticks = np.linspace(0, len(outcome.ticks.status) - 1, count).astype(int)
    return max(0.0, -referee_clearance(outcome.run.hand, outcome.run.mesh, placed_of(outcome.ticks).at(ticks)))


@pytest.mark.parametrize(
    ("name", "method", "most_pairs"),
    sampled(
        [(name, method, pairs) for name in CASES for method in METHODS for pairs in (SOME_PAIRS, ALL_PAIRS)],
        lambda place, case: (
            case[2] == SOME_PAIRS and case[0] not in ALIKE and (case[1] == "coupled" or case[0] in BY_BOTH)
        ),
    ),
)
def test_every_hard_case_is_passed(name: str, method: str, most_pairs: float) -> None:
    assert_passed(CASES[name], on_spheres(name, method), most_pairs)


@pytest.mark.parametrize(
    ("name", "method"),
    sampled([(name, method) for name in ON_MESH for method in METHODS], lambda _, case: case in QUICK),
)
def test_every_hard_case_is_passed_on_the_mesh(name: str, method: str) -> None:
    outcomes = run_scenes(scenes(name), SolverOptions(method=method, surface="mesh"))
    assert_passed(ON_MESH[name], outcomes, SOME_PAIRS)


@pytest.mark.parametrize("method", sampled(METHODS, lambda place, method: method == "coupled"))
def test_a_finger_that_slides_over_facets_does_not_stop_at_an_edge(method: str) -> None:
    # The first cylinder whose facets are narrower than a fingertip; as the method comes, and to convergence.
    pair = [run for run in scenes("facets") if run.name == "256 around a cylinder, along the finger"]
    outcomes = run_scenes(pair, SolverOptions(method=method, surface="mesh"))
    figures = [*common_figures(outcomes), *own_figures(outcomes)]
    assert all(figure.passed for figure in figures), [figure for figure in figures if not figure.passed]
    for outcome in outcomes:
        # Only the finger that points bears a force: what is measured is one contact.
        assert not np.delete(outcome.ticks.phalanx, INDEX, axis=1).any()
        assert outcome.safety["stuck"] == outcome.safety["lagging"] == 0
        assert (np.linalg.norm(outcome.ticks.total[SLIDE], axis=1) > 0.05).all()


def test_scenes_provoke_what_they_are_named_for() -> None:
    # A scene that a free hand passes would say nothing of a method.
    for name, least in (
        ("deep-command", 100),
        ("fast-swipe", 5),
        ("opposed-surfaces", 400),
        ("ridge", 500),
        ("wire", 10),
    ):
        for outcome in on_spheres(name):
            meets = (outcome.ticks.work[:, WORK_TOUCHING] > 0) | outcome.ticks.total.any(axis=1)
            assert meets.sum() >= least, (name, outcome.run.name)
    for outcome, pairs in zip(on_spheres("many-pairs"), (500, 2000), strict=True):
        run, record = outcome.run, outcome.ticks
        shown = HandConfiguration.of(record)
        distance = brute_pairs(run.hand, run.tree.leaf_center, run.tree.leaf_radius, shown, tick=100)
        assert (distance <= SolverOptions().margin).sum() >= pairs


def test_the_same_seed_gives_the_same_scene() -> None:
    def drawn(name: str, seed: int) -> list[np.ndarray]:
        runs = tuple(ON_MESH[name].build(seed))
        trees = [run.tree.center for run in runs if run.tree is not None]
        return [*(run.motion.position for run in runs), *trees, *(run.mesh.vertices for run in runs if run.mesh)]

    for name in ("bad-samples", "degenerate-spheres"):
        once, again, other = (drawn(name, seed) for seed in (5, 5, 6))
        assert all(np.array_equal(*pair, equal_nan=True) for pair in zip(once, again, strict=True))
        assert not all(np.array_equal(*pair, equal_nan=True) for pair in zip(once, other, strict=True))


def test_crossings_are_counted_through_the_disc_and_not_around_it() -> None:
    def way(*points: tuple[float, float, float]) -> int:
        return crossings(np.array(points)[:, None], 0.05)

    assert way((0.0, 0.0, 0.1), (0.0, 0.0, -0.1)) == 1
    assert way((0.0, 0.0, 0.1), (0.0, 0.0, -0.1), (0.01, 0.0, 0.1)) == 2
    assert way((0.0, 0.0, 0.1), (0.1, 0.0, 0.1), (0.1, 0.0, -0.1), (0.0, 0.0, -0.1)) == 0
    # Where it crosses counts, not where it was before: at x = 0.04, and at x = 0.06.
    assert way((0.0, 0.0, 0.1), (0.08, 0.0, -0.1)) == 1
    assert way((0.0, 0.0, 0.1), (0.12, 0.0, -0.1)) == 0
    assert way((0.0, 0.0, 0.1), (0.01, 0.0, 0.05), (0.02, 0.0, 0.001)) == 0


def test_a_finger_is_in_a_ring_or_it_is_not() -> None:
    line = np.array([[0.0, -0.05, 0.0], [0.0, -0.01, 0.0], [0.0, 0.01, 0.0], [0.0, 0.05, 0.0]])
    center, axis = np.zeros(3), np.array([0.0, 1.0, 0.0])
    shifts = [(0.0, 0.0, 0.0), (0.009, 0.0, 0.0), (0.011, 0.0, 0.0), (0.0, 0.2, 0.0), (0.0, -0.2, 0.0)]
    joints = np.array([line + shift for shift in shifts])
    np.testing.assert_array_equal(threaded(joints, center, axis, 0.01), [True, True, False, False, False])
    # In and out again is not in.
    bent = np.array([[[0.0, -0.05, 0.0], [0.0, 0.01, 0.0], [0.001, 0.02, 0.0], [0.002, -0.05, 0.0]]])
    assert not threaded(bent, center, axis, 0.01)[0]


HAND = HandModel.default()


@given(st.lists(st.integers(0, 150), min_size=1, max_size=8), st.integers(0, 2**32 - 1), st.booleans(), st.booleans())
@example([0, 1], 0, False, False)
@settings(max_examples=25)
def test_any_cut_gives_the_same_motion(sizes: list[int], seed: int, wild: bool, jumps: bool) -> None:
    options = StressOptions(wild=wild, jumps=jumps, hold=25)
    targets = RandomTargets(HAND, seed, options)
    pieces = [targets.take(size) for size in sizes]
    assert [piece.ticks for piece in pieces] == sizes
    whole = RandomTargets(HAND, seed, options).take(sum(sizes))
    assert all(a.tobytes() == b.tobytes() for a, b in zip(sequence(*pieces), whole))


def test_the_wild_mode_does_what_broken_devices_do() -> None:
    motion = RandomTargets(HAND, 1, StressOptions(wild=True)).take(60_000)
    finite = [np.isfinite(values.reshape(motion.ticks, -1)).all(axis=1) for values in motion]
    assert all(30 < (~field).sum() < 3000 for field in finite), "every field is lost at times, and seldom"
    sound = np.all(finite, axis=0) & (np.abs(motion.orientation) < 1e6).all(axis=1)
    length = np.linalg.norm(motion.orientation[sound], axis=1)
    assert (length == 0.0).sum() > 100
    assert length[length > 0.0].min() < 0.01 and length.max() > 10.0
    readings = hold_readings(motion)
    assert all(np.isfinite(values).all() for values in readings)
    away = np.linalg.norm(readings.position, axis=1)
    assert ((away > 0.3) & (away < 0.9)).sum() > 500, "teleports"
    assert ((away > 5.0) & (away < 100.0)).sum() > 50
    assert (readings.flexion > HAND.flexion_max + 1.0).any() and (readings.flexion < HAND.flexion_min - 1.0).any()
    assert (np.abs(readings.abduction) > 1.5).any()
    unit = readings.orientation / np.linalg.norm(readings.orientation, axis=1, keepdims=True)
    turned = (unit[1:] * unit[:-1]).sum(axis=1)
    assert (turned < -0.9).sum() > 500, "signs flip"
    assert (np.abs(turned) < 0.5).sum() > 500, "it spins"
