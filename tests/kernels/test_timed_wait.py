"""Sleeping in compiled code."""

import errno
import time

from hhsim.kernels.timed_wait import sleep_until


def test_a_time_that_is_none_is_refused() -> None:
    assert sleep_until(time.monotonic_ns() - 1) == 0
    assert sleep_until(-(2**40)) == errno.EINVAL
