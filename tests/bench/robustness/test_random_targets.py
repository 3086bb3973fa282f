"""Random targets: as wide, as fast and as wild as they say, and the same however they are cut."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from hhsim.bench.robustness.random_targets import RandomTargets, StressOptions
from hhsim.hand.configuration import HandConfiguration, sequence
from hhsim.hand.model import HandModel
from hhsim.motion.analytic_motion import hold_readings

HAND = HandModel.default()
JUMPS = StressOptions(hold=1, jumps=True)


def equal(one: HandConfiguration, other: HandConfiguration) -> bool:
    return all(a.tobytes() == b.tobytes() for a, b in zip(one, other))


@given(st.lists(st.integers(0, 150), min_size=1, max_size=8), st.integers(0, 2**32 - 1), st.booleans(), st.booleans())
@example([0, 1], 0, False, False)
@settings(max_examples=25)
def test_any_cut_gives_the_same_motion(sizes: list[int], seed: int, wild: bool, jumps: bool) -> None:
    options = StressOptions(wild=wild, jumps=jumps, hold=25)
    targets = RandomTargets(HAND, seed, options)
    pieces = [targets.take(size) for size in sizes]
    assert [piece.ticks for piece in pieces] == sizes
    assert equal(sequence(*pieces), RandomTargets(HAND, seed, options).take(sum(sizes)))


@pytest.mark.parametrize("seed", range(3))
def test_the_palm_goes_no_faster_than_it_may_and_straight_to_its_target(seed: int) -> None:
    motion = RandomTargets(HAND, seed).take(1200)
    steps = np.linalg.norm(np.diff(motion.position, axis=0), axis=1)
    assert steps.max() <= 2e-3 * (1.0 + 1e-12)
    target = RandomTargets(HAND, seed, JUMPS).take(21)
    for hold in range(1, 20):
        start, end = motion.position[60 * hold - 1], motion.position[60 * hold + 59]
        way = target.position[hold] - start
        share = min(1.0, 0.12 / float(np.linalg.norm(way)))
        np.testing.assert_allclose(end, start + share * way, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(motion.orientation, axis=1), 1.0, atol=1e-14)


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
