"""Deadlines in compiled code: none is left early, they follow samples that have a phase, and none that have none."""

import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from hhsim.kernels.live.deadlines import EARLIEST, PASSED, wait_periods
from hhsim.kernels.live.phase import (
    AFTER_MEAN,
    LARGEST_SHIFT,
    LEAST_SAMPLES,
    PHASE,
    WEIGHT,
    count_phase,
    deadline_shift,
)
from hhsim.live.session.loop import deadline_record
from hhsim.solver.workspace import zeroed


def test_no_deadline_is_left_early() -> None:
    late = np.full(20, -7, np.int64)
    deadlines = deadline_record(1_000_000, time.monotonic_ns())[0]
    wait_periods(deadlines, np.zeros(1, np.int64))
    began = time.monotonic_ns()
    missed = wait_periods(deadlines, late)
    took = time.monotonic_ns() - began
    assert (late >= PASSED).all()
    assert np.count_nonzero(late == PASSED) <= missed
    assert took >= 20 * 1_000_000 + max(0, late[-1])


def test_what_has_passed_is_left_out_and_counted() -> None:
    # No machine wakes a thread a thousand times in a millisecond by its timer.
    late = np.zeros(1_000, np.int64)
    deadlines = deadline_record(1_000, time.monotonic_ns())[0]
    missed = wait_periods(deadlines, late)
    passed = late == PASSED
    assert missed >= np.count_nonzero(passed) > 0
    assert deadlines.tick + 1 >= len(late)
    assert missed == deadlines.missed_total
    for i in np.flatnonzero(~passed):
        following = passed[i + 1 : i + 1 + late[i] // 1_000]
        assert following.all(), "every deadline in the time overslept has passed"


PERIOD = 1_000_000
LONG_AGO = 7_000_000_000_123


def follow(sent: NDArray[np.int64], begin: int) -> tuple[list[int], list[int]]:
    """Of a loop that begins then: how long before its deadline each sample came, and how far deadlines moved [ns]."""
    phase = zeroed(PHASE)[0]
    deadline, at, ahead, moved = begin, 0, [], []
    while at < len(sent):
        newest = int(np.searchsorted(sent, deadline, "right"))
        if newest > at:
            ahead.append(deadline - int(sent[newest - 1]))
            count_phase(phase, int(sent[newest - 1]), PERIOD)
            at = newest
        moved.append(deadline_shift(phase, deadline, PERIOD, PERIOD))
        deadline += PERIOD + moved[-1]
    return ahead, moved


@settings(max_examples=15)
@given(
    offset=st.integers(0, PERIOD - 1),
    every=st.sampled_from([1, 2, 4, 5, 10]),
    jitter=st.floats(0.0, 0.03),
    parts_per_million=st.integers(-50, 50),
)
def test_samples_come_where_ticks_can_begin_with_them(
    offset: int, every: int, jitter: float, parts_per_million: int
) -> None:
    rng = np.random.default_rng(offset)
    # Half a period is the longest way, and jitter and a clock that runs away make it longer.
    count = LEAST_SAMPLES + int(0.8 / LARGEST_SHIFT) // every + 400
    steady = np.arange(count) * every * PERIOD * (1.0 + 1e-6 * parts_per_million)
    sent = LONG_AGO + np.sort(steady + rng.normal(0.0, jitter * PERIOD, count)).astype(np.int64)
    ahead, moved = follow(sent, LONG_AGO - offset)
    before = np.array(ahead[-300:]) / PERIOD
    assert np.abs(moved).max() <= LARGEST_SHIFT * PERIOD
    # A clock that goes faster or slower leads the running mean by what it gains in as many samples as that weighs.
    leads = every * 1e-6 * abs(parts_per_million) / WEIGHT
    assert abs(np.median(before) - AFTER_MEAN) <= leads + 0.5 * jitter + 1e-3
    assert 0.0 < np.percentile(before, 2.0) <= np.percentile(before, 98.0) < EARLIEST


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
    assert abs(deadline_shift(phase, LONG_AGO + PERIOD // 2, PERIOD, PERIOD)) == LARGEST_SHIFT * PERIOD


@given(st.lists(st.integers(0, 10 * PERIOD), min_size=1, max_size=300), st.integers(0, PERIOD - 1))
def test_the_mean_is_that_of_the_directions(handed: list[int], deadline: int) -> None:
    phase = zeroed(PHASE)[0]
    ways = np.exp(2j * np.pi * np.array(handed) / PERIOD)
    first = round(1.0 / WEIGHT)
    for sample in handed:
        count_phase(phase, sample, PERIOD)
    mean = ways[:first].mean()
    for way in ways[first:]:
        mean = (1.0 - WEIGHT) * mean + WEIGHT * way
    assert complex(phase.cosine, phase.sine) == pytest.approx(mean, abs=1e-9)
    # Many samples of the same phase leave nothing of the others.
    for _ in range(2_000):
        count_phase(phase, handed[0], PERIOD)
    off = (handed[0] + AFTER_MEAN * PERIOD - deadline + PERIOD / 2) % PERIOD - PERIOD / 2
    moved = deadline_shift(phase, deadline, PERIOD, PERIOD)
    if 1.0 < abs(off) < PERIOD / 2 - 1.0:
        assert np.sign(moved) == np.sign(off)
