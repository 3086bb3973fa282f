"""Wake-ups measured in a thread of their own: every period is in one place, and the caller stays as it was."""

import os
import threading
from typing import Any

import pytest
from numpy.typing import NDArray

from hhsim.kernels.live.deadlines import PASSED
from hhsim.live import doctor
from hhsim.live.doctor import measure_wakeups
from hhsim.live.real_time import RealTimeWishes, timer_slack
from hhsim.result.miss_cause import MissCause

MS = 1_000_000


def test_the_caller_is_left_as_it_was() -> None:
    before = os.sched_getaffinity(0), os.sched_getscheduler(0), timer_slack(), threading.active_count()
    measured = measure_wakeups(1000.0, 0.12, RealTimeWishes(lock_memory=False))
    assert (os.sched_getaffinity(0), os.sched_getscheduler(0), timer_slack(), threading.active_count()) == before
    assert measured.mode["timer_slack_ns"] == 1
    assert measured.mode["gc_frozen"] is False
    # What was slept over at the end of a block lies beyond it.
    assert measured.periods >= 120
    assert sum(measured.causes.values()) == measured.missed
    assert (measured.late >= 0).all()
    assert measured.percentile(50.0) <= measured.percentile(99.0) <= measured.percentile(100.0)


class Accounts:
    """Readings as they are scripted: of the run delay and of the steal, one pair a block."""

    def __init__(self, readings: list[tuple[int, int]]) -> None:
        self.readings = iter(readings)
        self.steal = 0

    def run_delay_ns(self) -> int:
        delay, self.steal = next(self.readings)
        return delay

    def steal_ns(self) -> int:
        return self.steal

    def close(self) -> None:
        pass


def scripted(monkeypatch: pytest.MonkeyPatch, readings: list[tuple[int, int]], overslept: list[int]) -> None:
    """Blocks of which the third wake-up is so many periods late, and accounts that go by the script."""
    periods = iter([0, *overslept])

    def wait(deadlines: Any, late_out: NDArray[Any]) -> int:
        late_out[:] = 20_000
        gone = next(periods)
        if gone:
            late_out[2] = gone * deadlines.period_ns + 5_000
            late_out[3 : 3 + gone] = PASSED
        return gone

    monkeypatch.setattr(doctor, "wait_periods", wait)
    monkeypatch.setattr(doctor, "CpuAccounts", lambda cpu: Accounts(readings))


def test_each_miss_is_named_by_the_accounts_of_its_block(monkeypatch: pytest.MonkeyPatch) -> None:
    readings = [(0, 0), (0, 10 * MS), (4 * MS, 20 * MS), (4 * MS, 20 * MS), (4 * MS, 20 * MS)]
    scripted(monkeypatch, readings, [5, 4, 3, 0])
    measured = measure_wakeups(1000.0, 0.2, RealTimeWishes.none())
    assert measured.causes == {
        MissCause.COMPUTED: 0,
        MissCause.WOKEN_LATE: 4 + 3,
        MissCause.HOST: 5,
        MissCause.DEVICE: 0,
    }
    assert (measured.missed, measured.streak, measured.periods) == (12, 5, 200)
    assert (measured.run_delay, measured.steal) == (4 * MS, 20 * MS)


def test_what_the_system_does_not_tell_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    scripted(monkeypatch, [(-1, -1)] * 3, [2, 0])
    measured = measure_wakeups(1000.0, 0.1, RealTimeWishes.none())
    assert (measured.run_delay, measured.steal, measured.causes[MissCause.WOKEN_LATE]) == (None, None, 2)


def test_deadlines_that_went_by_before_it_could_sleep_are_missed_too(monkeypatch: pytest.MonkeyPatch) -> None:
    def wait(deadlines: Any, late_out: NDArray[Any]) -> int:
        late_out[:] = 20_000
        late_out[:3] = PASSED
        return 3

    monkeypatch.setattr(doctor, "wait_periods", wait)
    monkeypatch.setattr(doctor, "CpuAccounts", lambda cpu: Accounts([(0, 0), (0, 3 * MS)]))
    measured = measure_wakeups(1000.0, 0.05, RealTimeWishes.none())
    assert (measured.missed, measured.streak, measured.causes[MissCause.HOST]) == (3, 3, 3)
    assert len(measured.late) == measured.periods - measured.missed


def test_what_goes_wrong_in_the_thread_is_raised(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> int:
        raise OSError("no clock")

    monkeypatch.setattr(doctor, "wait_periods", fail)
    with pytest.raises(OSError, match="no clock"):
        measure_wakeups(1000.0, 0.1, RealTimeWishes.none())


def test_an_interrupt_ends_the_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(future: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("concurrent.futures.Future.result", interrupted)
    before = threading.active_count()
    with pytest.raises(KeyboardInterrupt):
        measure_wakeups(1000.0, 3600.0, RealTimeWishes.none())
    assert threading.active_count() == before
