"""The kernels' clocks are the system's: their readings fall between those of the standard library; waits by them."""

import os
import threading
import time
from collections.abc import Callable

import pytest

from hhsim.kernels.clock import await_event, monotonic_ns, thread_cpu_ns


@pytest.mark.parametrize(
    ("kernel", "library"), [(monotonic_ns, time.monotonic_ns), (thread_cpu_ns, time.thread_time_ns)]
)
def test_readings_fall_between_those_of_the_library(kernel: Callable[[], int], library: Callable[[], int]) -> None:
    kernel()
    readings = []
    for _ in range(100):
        readings += [library(), kernel()]
    readings.append(library())
    assert readings == sorted(readings)


def test_an_event_ends_a_sleep_and_is_taken() -> None:
    event = os.eventfd(0, os.EFD_NONBLOCK)
    try:
        hour = time.monotonic_ns() + 3_600 * 10**9
        os.eventfd_write(event, 1)
        os.eventfd_write(event, 1)
        assert await_event(event, hour) == 1
        until = time.monotonic_ns() + 1_050_000_000  # seconds, and what is left
        assert await_event(event, until) == 0, "both are taken"
        assert time.monotonic_ns() >= until
        threading.Timer(0.05, os.eventfd_write, (event, 1)).start()
        assert await_event(event, hour) == 1
        assert await_event(event, time.monotonic_ns() - 10**9) == 0, "it is looked, and not slept"
        os.eventfd_write(event, 1)
        assert await_event(event, time.monotonic_ns() - 10**9) == 1
    finally:
        os.close(event)
