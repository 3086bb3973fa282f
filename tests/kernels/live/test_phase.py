"""Deadlines in compiled code: none is left early, they follow samples that have a phase, and none that have none."""

import time

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from hhsim.kernels.live.deadlines import (
    AFTER_MEAN,
    EARLIEST,
    LARGEST_SHIFT,
    LEAST_SAMPLES,
    PASSED,
    PHASE,
    WEIGHT,
    count_phase,
    deadline_shift,
    wait_periods,
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
