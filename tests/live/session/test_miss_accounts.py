"""Deadlines: a tick a period, and every missed one has one of four names, by what was measured: each cause planted."""

from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from live_scripted import FIST, FREE, Deadlines, FakeClock, Moment, ScriptedSession

from hhsim.kernels.live import deadlines
from hhsim.kernels.live.deadlines import EARLIEST, NOTHING
from hhsim.result.miss_cause import CAUSES, MissCause, TimeTaken
from hhsim.result.safety import Safety

AT = 40
"""The tick in which something is planted, before any phase is known; the one after it has missed periods before it."""
MS = 1_000_000
COMPUTED, WOKEN_LATE, HOST = MissCause.COMPUTED, MissCause.WOKEN_LATE, MissCause.HOST


class Planted(ScriptedSession):
    """A session in whose tick `AT`, or after it, something takes time."""

    def __init__(self, ticks: int = 100) -> None:
        super().__init__([Moment(FREE + (FIST - FREE) * min(i, 60) / 60) for i in range(ticks)])

    def takes(self, wall: int = 0, cpu: int = 0, delay: int = 0, steal: int = 0, oversleep: int = 0) -> Any:
        """What a tick takes, by the clock and by the accounts [ns], and how late the loop is woken after it."""

        def happen() -> None:
            self.clock.work(wall)
            self.accounts.cpu += cpu
            self.accounts.delay += delay
            self.accounts.steal += steal
            if oversleep:
                self.clock.oversleep.append(oversleep)

        return happen

    def only_miss(self) -> Any:
        (row,) = self.run().ticks[self.ticks["missed"] > 0]
        return row


def test_the_causes_are_those_of_the_file() -> None:
    assert (deadlines.COMPUTED, deadlines.WOKEN_LATE, deadlines.HOST, deadlines.DEVICE) == CAUSES


@pytest.mark.parametrize(
    ("given", "missed", "kept", "cause"),
    [
        ({"wall": 5 * MS, "cpu": 5 * MS}, 5, 100_000, COMPUTED),
        ({"wall": 5 * MS, "cpu": MS // 5, "delay": 4 * MS}, 5, 4_900_000, WOKEN_LATE),
        ({"wall": 5 * MS, "cpu": MS // 5, "steal": 10 * MS}, 5, 4_900_000, HOST),
        ({"wall": 5 * MS, "cpu": MS // 5}, 5, 4_900_000, WOKEN_LATE),
        # The clock tells where the system does not.
        ({"wall": 5 * MS, "cpu": 5 * MS, "delay": -1, "steal": -1}, 5, 100_000, COMPUTED),
        ({"oversleep": 4 * MS + 300_000}, 4, 4_400_000, WOKEN_LATE),
        ({"oversleep": 4 * MS + 300_000, "steal": 10 * MS}, 4, 4_400_000, HOST),
    ],
)
def test_a_tick_that_takes_too_long_or_is_woken_late_is_named(
    given: dict[str, int], missed: int, kept: int, cause: MissCause
) -> None:
    planted = Planted()
    planted.solving(planted.takes(**given), AT)
    row = planted.only_miss()
    assert (row["tick"], row["missed"], row["cause"]) == (AT + 1 + missed, missed, cause)
    taken = dict(zip(TimeTaken._fields, row["taken"].tolist(), strict=True))
    assert (taken["computed"], taken["kept"]) == (given.get("cpu", 0), kept)
    assert (taken["run_delay"], taken["steal"]) == (max(given.get("delay", 0), 0), max(given.get("steal", 0), 0))
    assert planted.memory.status["missed_by"].tolist() == [missed if each is cause else 0 for each in CAUSES]
    others = planted.ticks[planted.ticks["missed"] == 0]
    assert not others["cause"].any() and not others["taken"].any()


def test_a_tick_that_was_woken_so_late_that_its_usual_work_was_too_much_is_named_by_that() -> None:
    planted = Planted()
    planted.solving(planted.takes(oversleep=800_000, delay=800_000), AT)
    planted.solving(planted.takes(700_000, cpu=700_000), AT + 1)
    row = planted.only_miss()
    assert (row["tick"], row["missed"], row["cause"]) == (AT + 3, 1, WOKEN_LATE)
    assert row["taken"][:2].tolist() == [700_000, 900_000]


@pytest.mark.parametrize(("more", "missed"), [(500_000, 0), (800_000, 1)])
def test_a_tick_that_begins_at_once_is_accounted_for_with_the_one_before(more: int, missed: int) -> None:
    planted = Planted()
    planted.solving(planted.takes(1_100_000, cpu=1_100_000), AT)
    planted.solving(planted.takes(more, cpu=more), AT + 1)
    ticks = planted.run().ticks
    after = ticks[ticks["tick"] > AT]
    assert after["at_once"][:3].tolist() == [1, 0, 0]
    assert (after["tick"][0], after["wakeup_ns"][0]) == (AT + 1, 200_000)
    assert (int(ticks["missed"].sum()), int(after["missed"][1])) == (missed, missed)
    if missed:
        assert (after["cause"][1], int(after["taken"][1][0])) == (COMPUTED, 1_100_000 + more)


def test_what_the_host_took_long_before_is_not_charged_to_a_miss() -> None:
    planted = Planted(ticks=150)
    planted.solving(planted.takes(steal=50 * MS), AT)
    planted.solving(planted.loop.tell, AT + 1)
    planted.solving(planted.takes(oversleep=4 * MS), AT + 5)
    row = planted.only_miss()
    assert (row["missed"], row["cause"], row["taken"][3]) == (4, WOKEN_LATE, 0)


def test_a_stall_that_frees_the_fingers_is_logged_with_its_cause() -> None:
    planted = Planted()
    planted.solving(planted.takes(oversleep=12 * MS, steal=20 * MS), AT)
    assert planted.only_miss()["safety"] & Safety.OVERRUN_STREAK
    (line,) = (line for line in planted.events if "too many late ticks in a row" in line)
    assert line.endswith(": 12 the last time, taken by the host")


@given(st.lists(st.tuples(st.integers(0, 3 * MS), st.integers(0, 2 * MS), st.integers(0, 3 * MS)), max_size=60))
@example([(MS + MS // 2, 0, 3 * MS), (0, 0, 3 * MS)])
def test_however_things_come_there_is_one_tick_a_period(steps: list[tuple[int, int, int]]) -> None:
    clock = FakeClock(0)
    loop = Deadlines(MS, clock)
    at, before, asked = loop.at, -1, 0
    for work, oversleep, after in steps:
        came, past = asked + after, asked - (before + 2) * MS
        begins_at_once = not at.at_once and 0 <= 2 * past <= MS
        clock.oversleep, clock.alarms = [oversleep], [(came, lambda: None)]
        loop.wait(lambda came=came: came if clock.now() >= came else NOTHING)
        assert (at.tick, at.at_once) == (before + 1 + at.missed, begins_at_once)
        assert at.deadline_ns == (at.tick + 1) * MS
        assert 0 <= at.early_ns <= EARLIEST * MS and 0 <= at.wakeup_ns < MS
        assert clock.now() == at.woke_ns == at.deadline_ns - at.early_ns + at.wakeup_ns
        if at.early_ns:
            assert at.woke_ns < at.deadline_ns and at.missed == at.at_once == 0
            assert asked <= at.deadline_ns - EARLIEST * MS
            assert at.deadline_ns - at.early_ns in (came, (1.0 - EARLIEST) * MS + at.deadline_ns - MS)
        before = at.tick
        clock.work(work)
        asked = clock.now()
    assert at.missed_total == before + 1 - len(steps)
