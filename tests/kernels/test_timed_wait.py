"""Deadlines waited for in compiled code: none is left early, and those that had passed are told."""

import errno
import time

import numpy as np

from hhsim.kernels.timed_wait import PASSED, sleep_until, wait_periods


def test_no_deadline_is_left_early() -> None:
    late = np.full(20, -7, np.int64)
    wait_periods(1_000, np.zeros(1, np.int64))
    began = time.monotonic_ns()
    missed = wait_periods(1_000_000, late)
    took = time.monotonic_ns() - began
    assert (late >= PASSED).all()
    assert np.count_nonzero(late == PASSED) <= missed
    assert took >= 20 * 1_000_000 + max(0, late[-1])


def test_what_has_passed_is_left_out_and_counted() -> None:
    # No machine wakes a thread a thousand times in a millisecond by its timer.
    late = np.zeros(1_000, np.int64)
    missed = wait_periods(1_000, late)
    passed = late == PASSED
    assert missed >= np.count_nonzero(passed) > 0
    for i in np.flatnonzero(~passed):
        following = passed[i + 1 : i + 1 + late[i] // 1_000]
        assert following.all(), "every deadline in the time overslept has passed"
    assert late[0] >= 0


def test_a_time_that_is_none_is_refused() -> None:
    assert sleep_until(time.monotonic_ns() - 1) == 0
    assert sleep_until(-(2**40)) == errno.EINVAL
