"""Deadlines follow samples: to right after them where they have a phase, and nowhere where they have none."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from hhsim.kernels.live.phase import (
    DEVIATIONS,
    FIRST_SHIFT,
    LARGEST_SHIFT,
    LATE_SHARE,
    LEAST_SAMPLES,
    MOST_FURTHER,
    MOST_LEAPS,
    PHASE,
    WEIGHT,
    count_phase,
    deadline_shift,
)
from hhsim.solver.workspace import zeroed

PERIOD = 1_000_000
LONG_AGO = 7_000_000_000_123


def follow(sent: NDArray[np.int64], begin: int) -> tuple[list[int], list[int]]:
    """Of a loop that begins then: how long each sample waited for its tick, and by how much deadlines moved [ns]."""
    phase = zeroed(PHASE)[0]
    deadline, at, waited, moved = begin, 0, [], []
    while at < len(sent):
        newest = int(np.searchsorted(sent, deadline, "right"))
        if newest > at:
            waited.append(deadline - int(sent[newest - 1]))
            count_phase(phase, int(sent[newest - 1]), PERIOD)
            at = newest
        moved.append(deadline_shift(phase, deadline, PERIOD, PERIOD))
        deadline += PERIOD + moved[-1]
    return waited, moved


@settings(max_examples=15)
@given(
    offset=st.integers(0, PERIOD - 1),
    every=st.sampled_from([1, 2, 4, 5, 10]),
    jitter=st.floats(0.0, 0.03),
    parts_per_million=st.integers(-50, 50),
)
def test_ticks_begin_right_after_the_samples(offset: int, every: int, jitter: float, parts_per_million: int) -> None:
    rng = np.random.default_rng(offset)
    count = LEAST_SAMPLES + 200 // every + 1_200
    steady = np.arange(count) * every * PERIOD * (1.0 + 1e-6 * parts_per_million)
    sent = LONG_AGO + np.sort(steady + rng.normal(0.0, jitter * PERIOD, count)).astype(np.int64)
    waited, moved = follow(sent, LONG_AGO - offset)
    late = np.array(waited[-400:]) / PERIOD
    leaps = np.flatnonzero(np.abs(moved) > LARGEST_SHIFT * PERIOD)
    assert (np.abs(moved)[leaps] == FIRST_SHIFT * PERIOD).all()
    assert (np.diff(leaps) == 1).all(), "to the first phase, and not again"
    assert len(leaps) <= 0.5 / FIRST_SHIFT + 5
    # A clock that goes faster or slower leads the running mean by what it gains in as many samples as that weighs, and
    # the deviation of what is in that mean is as much.
    leads = every * 1e-6 * abs(parts_per_million) / WEIGHT
    assert np.percentile(late, 98.0) <= 2.0 * DEVIATIONS * jitter + (1.0 + DEVIATIONS) * leads + 0.01
    assert np.median(late) >= -leads - 1e-3


@settings(max_examples=15)
@given(offset=st.integers(0, PERIOD - 1), hertz=st.sampled_from([60.0, 72.0, 90.0, 120.0, 144.0, 199.0, 300.0, 990.0]))
def test_other_rates_move_nothing_in_the_long_run(offset: int, hertz: float) -> None:
    sent = LONG_AGO + np.rint(np.arange(2_000) * 1e9 / hertz).astype(np.int64)
    _, moved = follow(sent, LONG_AGO - offset)
    assert not any(moved[len(moved) // 10 :])


def test_before_there_is_a_phase_nothing_moves() -> None:
    phase = zeroed(PHASE)[0]
    for _ in range(LEAST_SAMPLES):
        assert deadline_shift(phase, LONG_AGO + PERIOD // 2, PERIOD, PERIOD) == 0
        count_phase(phase, LONG_AGO, PERIOD)
    assert deadline_shift(phase, LONG_AGO + PERIOD // 2, PERIOD, 0.7 * PERIOD) == 0, "a glove that sends more often"
    assert abs(deadline_shift(phase, LONG_AGO + PERIOD // 2, PERIOD, PERIOD)) == FIRST_SHIFT * PERIOD


def test_a_phase_that_is_lost_on_the_way_is_followed_slowly() -> None:
    phase = zeroed(PHASE)[0]
    for _ in range(LEAST_SAMPLES):
        count_phase(phase, LONG_AGO, PERIOD)
    assert deadline_shift(phase, LONG_AGO - PERIOD // 4, PERIOD, PERIOD) == FIRST_SHIFT * PERIOD
    assert deadline_shift(phase, LONG_AGO - PERIOD // 4, PERIOD, 0.0) == 0
    assert deadline_shift(phase, LONG_AGO - PERIOD // 4, PERIOD, PERIOD) == LARGEST_SHIFT * PERIOD


@settings(max_examples=15)
@given(seed=st.integers(0, 10**6), tail=st.floats(0.0, 0.1), spread=st.floats(0.002, 0.02))
def test_however_jitter_is_spread_few_samples_wait_for_the_next_tick(seed: int, tail: float, spread: float) -> None:
    rng = np.random.default_rng(seed)
    count = 5_000
    jitter = np.where(rng.random(count) < tail, rng.exponential(3.0 * spread, count), rng.normal(0.0, spread, count))
    sent = LONG_AGO + np.sort((5.0 * np.arange(count) + jitter) * PERIOD).astype(np.int64)
    waited, _ = follow(sent, LONG_AGO)
    late = np.array(waited[1_000:]) / PERIOD
    assert (late > 0.6).mean() <= 3.0 * LATE_SHARE
    assert np.median(late) <= (DEVIATIONS + MOST_FURTHER + 1.0) * (spread + 5.0 * tail * spread) + 0.01


def test_samples_that_answer_ticks_are_not_run_after() -> None:
    phase, deadline, moved = zeroed(PHASE)[0], LONG_AGO, []
    for _ in range(LEAST_SAMPLES + 200):
        count_phase(phase, deadline + PERIOD // 2, PERIOD)
        moved.append(deadline_shift(phase, deadline, PERIOD, PERIOD))
        deadline += PERIOD + moved[-1]
    assert np.count_nonzero(np.abs(moved) == FIRST_SHIFT * PERIOD) <= MOST_LEAPS
    assert np.abs(moved[-100:]).max() <= LARGEST_SHIFT * PERIOD


@given(st.lists(st.integers(0, 10 * PERIOD), min_size=1, max_size=300), st.integers(0, PERIOD - 1))
def test_the_mean_is_that_of_the_directions(handed: list[int], deadline: int) -> None:
    phase = zeroed(PHASE)[0]
    ways = np.exp(2j * np.pi * np.array(handed) / PERIOD)
    first = round(1.0 / WEIGHT)
    for time in handed:
        count_phase(phase, time, PERIOD)
    mean = ways[:first].mean()
    for way in ways[first:]:
        mean = (1.0 - WEIGHT) * mean + WEIGHT * way
    assert complex(phase.cosine, phase.sine) == pytest.approx(mean, abs=1e-9)
    # Many samples of the same phase leave nothing of the others.
    for _ in range(2_000):
        count_phase(phase, handed[0], PERIOD)
    off = (handed[0] - deadline + PERIOD / 2) % PERIOD - PERIOD / 2
    moved = deadline_shift(phase, deadline, PERIOD, PERIOD)
    if 1.0 < abs(off) < PERIOD / 2 - 1.0:
        assert np.sign(moved) == np.sign(off)
