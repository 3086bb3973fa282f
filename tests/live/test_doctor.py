"""The verdict on a machine follows from measured wake-ups and stated limits, the advice from who took the time."""

import os
import threading
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from hhsim.kernels.live.deadlines import PASSED
from hhsim.live import doctor
from hhsim.live.doctor import (
    HOST_ADVICE,
    NOBODY_ADVICE,
    OTHERS_ADVICE,
    Diagnosis,
    Wakeups,
    measure_wakeups,
    quick_warning,
)
from hhsim.live.real_time import RealTimeWishes, timer_slack
from hhsim.result.miss_cause import CAUSES, MissCause
from hhsim.system.scheduling_facts import SchedulingFact

US, MS = 1_000, 1_000_000


def planted(
    missed: int = 0,
    streak: int = 1,
    cause: MissCause = MissCause.WOKEN_LATE,
    late_us: int = 30,
    run_delay: int = 0,
    wakeups: int = 10_000,
) -> Wakeups:
    """So many wake-ups, each overslept one losing `streak` periods."""
    late = np.full(wakeups - missed, late_us * US, np.int64)
    late[: missed // streak] = streak * MS + 500 * US
    causes = dict.fromkeys(CAUSES, 0)
    causes[cause] = missed
    mode = {"refused": ["no SCHED_FIFO at priority 50"], "fifo": 0}
    return Wakeups(1000.0, late, missed, streak if missed else 0, causes, run_delay, 0, mode)


@pytest.mark.parametrize(
    ("wakeups", "beyond"),
    [
        (planted(), []),
        (planted(missed=10), []),
        (planted(missed=11), ["missed periods"]),
        (planted(missed=9, streak=9), []),
        (planted(missed=10, streak=10), ["missed in a row"]),
        (planted(late_us=250), []),
        (planted(late_us=251), ["wake-up, p99"]),
        # A short look: one alone says nothing, two do.
        (planted(missed=1, wakeups=300), []),
        (planted(missed=2, wakeups=300), ["missed periods"]),
    ],
)
def test_the_limits(wakeups: Wakeups, beyond: list[str]) -> None:
    diagnosis = Diagnosis(wakeups, [])
    assert [measure.name for measure in diagnosis.measures if not measure.kept] == beyond
    assert diagnosis.good == (not beyond)
    assert ("does not keep" in diagnosis.verdict) == bool(beyond)
    words = {"missed periods": "periods were missed"}
    assert all(words.get(name, name) in diagnosis.verdict for name in beyond)


@pytest.mark.parametrize(
    ("cause", "run_delay", "first"),
    [
        (MissCause.HOST, 0, HOST_ADVICE),
        (MissCause.WOKEN_LATE, 30 * MS, OTHERS_ADVICE),
        (MissCause.WOKEN_LATE, MS, NOBODY_ADVICE),
    ],
)
def test_who_took_the_time_is_told_first(cause: MissCause, run_delay: int, first: str) -> None:
    facts = [SchedulingFact("kernel", "6.1"), SchedulingFact("frequency governor", "powersave", "cpupower")]
    bad = Diagnosis(planted(missed=30, cause=cause, run_delay=run_delay), facts)
    assert bad.advice == [first, "no SCHED_FIFO at priority 50", "cpupower"]
    assert Diagnosis(planted(missed=3, cause=cause), facts).advice == []


def test_before_a_session_a_good_machine_gets_no_word(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    def measure(rate: float, seconds: float, wishes: RealTimeWishes) -> Wakeups:
        asked.append((rate, seconds, wishes.punctual, wishes.lock_memory))
        return found

    monkeypatch.setattr(doctor, "measure_wakeups", measure)
    found = planted(wakeups=300)
    assert quick_warning(1000.0, RealTimeWishes()) == ""
    found = planted(wakeups=300, missed=4, cause=MissCause.HOST)
    line = quick_warning(1000.0, RealTimeWishes())
    assert "4 of 300 periods were missed (taken by the host 4)" in line
    assert line.endswith("; hhsim doctor tells more") and line.count("missed") == 1
    assert "\n" not in line
    assert asked == [(1000.0, doctor.QUICK_SECONDS, True, False)] * 2
    assert doctor.QUICK_SECONDS < 0.5


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


def test_an_interrupt_ends_the_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(future: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("concurrent.futures.Future.result", interrupted)
    before = threading.active_count()
    with pytest.raises(KeyboardInterrupt):
        measure_wakeups(1000.0, 3600.0, RealTimeWishes.none())
    assert threading.active_count() == before
