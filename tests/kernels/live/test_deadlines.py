"""Deadlines waited for in compiled code: none is left early, and those that had passed are told."""

import time

import numpy as np

from hhsim.kernels.live.deadlines import PASSED, wait_periods
from hhsim.live.loop.records import deadline_record


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
