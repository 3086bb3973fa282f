"""`hhsim doctor`: the verdict by stated limits from measured wake-ups, who took the time, and what to change."""

import json
import os
import re
import threading
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
from conftest import Run
from numpy.typing import NDArray

from hhsim.kernels.live.deadlines import PASSED
from hhsim.live import doctor
from hhsim.live.doctor import HOST_ADVICE, NOBODY_ADVICE, OTHERS_ADVICE, Wakeups, measure_wakeups, quick_warning
from hhsim.live.real_time import RealTimeWishes, timer_slack

US, MS = 1_000, 1_000_000


def planted(
    missed: int = 0, streak: int = 1, late_us: int = 30, run_delay: int | None = 0, steal: int = 0, count: int = 10_000
) -> Wakeups:
    """So many wake-ups, each overslept one losing `streak` periods."""
    late = np.full(count - missed, late_us * US, np.int64)
    late[: missed // streak] = streak * MS + 500 * US
    mode = {"refused": ["no SCHED_FIFO at priority 50"], "fifo": 0, "memory_locked": False, "timer_slack_ns": 1}
    mode |= {"cpu": -1, "gc_frozen": False}
    return Wakeups(1000.0, late, missed, streak if missed else 0, run_delay, steal, mode)


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
        (planted(missed=1, count=300), []),
        (planted(missed=2, count=300), ["missed periods"]),
    ],
)
def test_the_limits(wakeups: Wakeups, beyond: list[str]) -> None:
    assert [row.name for row in wakeups.rows if not row.kept] == beyond
    assert wakeups.good == (not beyond) == ("does not keep" not in wakeups.verdict)
    words = {"missed periods": "periods were missed"}
    assert all(words.get(name, name) in wakeups.verdict for name in beyond)


@pytest.mark.parametrize(
    ("steal", "run_delay", "first"),
    [(30 * MS, 0, HOST_ADVICE), (0, 30 * MS, OTHERS_ADVICE), (0, MS, NOBODY_ADVICE), (0, None, NOBODY_ADVICE)],
)
def test_who_took_the_time_is_told_first(steal: int, run_delay: int | None, first: str) -> None:
    bad = planted(missed=30, steal=steal, run_delay=run_delay)
    assert bad.advice == [first, "no SCHED_FIFO at priority 50"]
    assert planted(missed=3, steal=steal).advice == []
    assert planted(late_us=251, steal=steal).advice == ["no SCHED_FIFO at priority 50"]


def test_before_a_session_a_good_machine_gets_no_word(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    def measure(rate: float, seconds: float, wishes: RealTimeWishes) -> Wakeups:
        asked.append((rate, seconds, wishes.punctual, wishes.lock_memory))
        return found

    monkeypatch.setattr(doctor, "measure_wakeups", measure)
    found = planted(count=300)
    assert quick_warning(1000.0, RealTimeWishes()) == ""
    found = planted(count=300, missed=4, steal=10 * MS)
    line = quick_warning(1000.0, RealTimeWishes())
    assert "4 of 300 periods were missed (the host had the processor for 10.0 ms)" in line and "\n" not in line
    assert line.endswith("; hhsim doctor tells more") and line.count("missed") == 1
    assert asked == [(1000.0, doctor.QUICK_SECONDS, True, False)] * 2 and doctor.QUICK_SECONDS < 0.5


def test_the_caller_is_left_as_it_was(monkeypatch: pytest.MonkeyPatch) -> None:
    def state() -> tuple[object, ...]:
        return os.sched_getaffinity(0), os.sched_getscheduler(0), timer_slack(), threading.active_count()

    before = state()
    measured = measure_wakeups(1000.0, 0.12, RealTimeWishes(lock_memory=False))
    assert state() == before
    assert measured.mode["timer_slack_ns"] == 1 and measured.mode["gc_frozen"] is False
    # What was slept over at the end of a block lies beyond it.
    assert measured.periods >= 120
    assert (measured.late >= 0).all()

    def interrupted(future: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("concurrent.futures.Future.result", interrupted)
    with pytest.raises(KeyboardInterrupt):
        measure_wakeups(1000.0, 3600.0, RealTimeWishes.none())
    assert state() == before


@pytest.mark.parametrize(
    ("readings", "overslept", "first", "told"),
    [
        ([(0, 0), (4, 20)], [5, 4, 3, 0], 2, (4 * MS, 20 * MS)),
        # What the system does not tell is none.
        ([(-1, -1)] * 2, [2, 0], 2, (None, None)),
        # Deadlines that went by before it could sleep are missed, too.
        ([(0, 0), (0, 3)], [3], -1, (0, 3 * MS)),
    ],
)
def test_every_missed_period_is_counted_beside_the_accounts(
    monkeypatch: pytest.MonkeyPatch,
    readings: list[tuple[int, int]],
    overslept: list[int],
    first: int,
    told: tuple[int | None, int | None],
) -> None:
    """Blocks of which one wake-up is so many periods late, and accounts [ms] that go by the script."""
    periods = iter([0, *overslept])

    def wait(deadlines: Any, late_out: NDArray[Any]) -> int:
        late_out[:] = 20_000
        gone = next(periods)
        if gone:
            late_out[first + 1 : first + 1 + gone] = PASSED
            if first >= 0:
                late_out[first] = gone * deadlines.period_ns + 5_000
        return gone

    monkeypatch.setattr(doctor, "wait_periods", wait)
    scale = [tuple(MS * value if value > 0 else value for value in pair) for pair in readings]
    monkeypatch.setattr(doctor, "CpuAccounts", lambda cpu: Mock(totals=iter(scale).__next__))
    measured = measure_wakeups(1000.0, 0.05 * len(overslept), RealTimeWishes.none())
    assert (measured.missed, measured.streak) == (sum(overslept), max(overslept))
    assert measured.periods == 50 * len(overslept)
    assert (measured.run_delay, measured.steal) == told


def test_the_command_prints_the_table_and_exits_by_the_verdict(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "measure_wakeups", lambda rate, seconds, wishes: found)
    found = planted(run_delay=None)
    answer = run("doctor")
    assert answer.code == 0 and "this machine keeps 1,000 Hz: none of 10,000 periods was missed" in answer.out
    assert re.search(r"run delay +not told", answer.out)
    document = run("doctor", "--json").document()
    assert (document["good"], document["periods"], document["advice"]) == (True, 10_000, [])
    found = planted(missed=34, steal=300 * MS)
    answer = run("doctor")
    assert answer.code == 1
    assert "34 of 10,000 periods were missed (the host had the processor for 300.0 ms)" in answer.out
    assert f"  - {HOST_ADVICE}\n" in answer.out
    document = run("doctor", "--json").document(1)
    assert (document["good"], round(1e3 * document["steal"])) == (False, 300)
    quiet = run("doctor", "--quiet")
    assert (quiet.code, quiet.out) == (1, "")


def test_a_real_measurement_counts_every_period(run: Run) -> None:
    answer = run("doctor", "--no-realtime", "--duration", "0.2", "--json")
    document = json.loads(answer.out)
    assert answer.code == (0 if document["good"] else 1) and document["periods"] >= 200
    assert document["real_time"]["fifo"] == 0
