"""The verdict on a machine follows from measured wake-ups and stated limits, the advice from who took the time."""

import numpy as np
import pytest

from hhsim.live import doctor
from hhsim.live.doctor import HOST_ADVICE, NOBODY_ADVICE, OTHERS_ADVICE, Diagnosis, Wakeups, quick_warning
from hhsim.live.real_time import RealTimeWishes
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
