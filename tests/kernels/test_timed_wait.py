"""Sleeping in compiled code."""

import errno
import os
import threading
import time

from hhsim.kernels.timed_wait import await_event, sleep_until


def test_a_time_that_is_none_is_refused() -> None:
    assert sleep_until(time.monotonic_ns() - 1) == 0
    assert sleep_until(-(2**40)) == errno.EINVAL


def test_an_event_ends_a_sleep_and_is_taken() -> None:
    event = os.eventfd(0, os.EFD_NONBLOCK)
    try:
        hour = time.monotonic_ns() + 3_600 * 10**9
        os.eventfd_write(event, 1)
        os.eventfd_write(event, 1)
        assert await_event(event, hour) == 1
        until = time.monotonic_ns() + 20_000_000
        assert await_event(event, until) == 0, "both are taken"
        assert time.monotonic_ns() >= until
        threading.Timer(0.05, os.eventfd_write, (event, 1)).start()
        assert await_event(event, hour) == 1
        assert await_event(event, time.monotonic_ns() - 10**9) == 0, "it is looked, and not slept"
        os.eventfd_write(event, 1)
        assert await_event(event, time.monotonic_ns() - 10**9) == 1
    finally:
        os.close(event)


def test_the_timeout_of_an_event_has_seconds_and_what_is_left() -> None:
    event = os.eventfd(0, os.EFD_NONBLOCK)
    try:
        until = time.monotonic_ns() + 1_050_000_000
        assert await_event(event, until) == 0
        assert time.monotonic_ns() >= until
    finally:
        os.close(event)
