"""The kernels' clocks are the system's: their readings fall between those of the standard library."""

import threading
import time
from collections.abc import Callable

import pytest

from hhsim.kernels.clock import monotonic_ns, thread_cpu_ns


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


def test_the_cpu_clock_is_the_calling_threads_own() -> None:
    # A thread that has only just begun has used less CPU than this one, which has compiled or loaded the kernels.
    readings: list[int] = []
    thread_cpu_ns()
    thread = threading.Thread(target=lambda: readings.append(thread_cpu_ns()))
    thread.start()
    thread.join()
    assert 0 <= readings[0] < thread_cpu_ns()
