"""Every missed period of a loop has one of four names, by what was measured: each cause planted."""

from collections.abc import Callable
from typing import Any

import pytest
from live_scripted import FIST, FREE, Moment, ScriptedSession

from hhsim.kernels.live.accounts import LONG_STALL_NS
from hhsim.live.session.loop import STEAL_UNREAD
from hhsim.result.miss_cause import CAUSES, MissCause, TimeTaken
from hhsim.result.safety import Safety

AT = 40
"""The tick in which something is planted, before any phase is known; the one after it has missed periods before it."""


class Planted(ScriptedSession):
    """A session in whose tick `AT` something takes time."""

    def __init__(self, ticks: int = 100) -> None:
        super().__init__([Moment(FREE + (FIST - FREE) * min(i, 60) / 60) for i in range(ticks)])

    def at(self, tick: int, action: Callable[[], None]) -> None:
        """Let something happen while a tick is solved."""
        sound = self.loop.one_tick.solve

        def solve() -> None:
            if self.loop.deadlines.at.tick == tick:
                action()
            sound()

        self.loop.one_tick.solve = solve

    def only_miss(self) -> Any:
        (row,) = self.ticks[self.ticks["missed"] > 0]
        return row


def takes(planted: Planted, wall: int, cpu: int = 0, delay: int = 0, steal: int = 0) -> Callable[[], None]:
    def happen() -> None:
        planted.clock.work(wall)
        planted.accounts.cpu += cpu
        planted.accounts.delay += delay
        planted.accounts.steal += steal

    return happen


MS = 1_000_000


@pytest.mark.parametrize(
    ("given", "cause"),
    [
        ({"wall": 5 * MS, "cpu": 5 * MS}, MissCause.COMPUTED),
        ({"wall": 5 * MS, "cpu": MS // 5, "delay": 4 * MS}, MissCause.WOKEN_LATE),
        ({"wall": 5 * MS, "cpu": MS // 5, "steal": 10 * MS}, MissCause.HOST),
        ({"wall": 5 * MS, "cpu": MS // 5}, MissCause.WOKEN_LATE),
    ],
)
def test_a_tick_that_takes_too_long_is_named(given: dict[str, int], cause: MissCause) -> None:
    planted = Planted()
    planted.at(AT, takes(planted, **given))
    row = planted.run().only_miss()
    assert (row["tick"], row["missed"], row["cause"]) == (AT + 6, 5, cause)
    assert dict(zip(TimeTaken._fields, row["taken"], strict=True)) == {
        "computed": given["cpu"],
        "kept": 5 * MS + 100_000 - given["cpu"],
        "run_delay": given.get("delay", 0),
        "steal": given.get("steal", 0),
        "device": 0,
    }
    assert planted.memory.status["missed_by"].tolist() == [5 if each is cause else 0 for each in CAUSES]
    others = planted.ticks[planted.ticks["missed"] == 0]
    assert not others["cause"].any() and not others["taken"].any()


@pytest.mark.parametrize(("steal", "cause"), [(0, MissCause.WOKEN_LATE), (10 * MS, MissCause.HOST)])
def test_a_loop_that_oversleeps_is_named(steal: int, cause: MissCause) -> None:
    planted = Planted()

    def oversleep() -> None:
        planted.clock.oversleep.append(4 * MS + 300_000)
        planted.accounts.steal += steal

    planted.at(AT, oversleep)
    row = planted.run().only_miss()
    assert (row["missed"], row["cause"]) == (4, cause)
    assert row["taken"][1] == 4 * MS + 300_000 + 100_000


def test_a_tick_that_was_woken_so_late_that_its_usual_work_was_too_much_is_named_by_that() -> None:
    planted = Planted()

    def oversleep() -> None:
        planted.clock.oversleep.append(800_000)
        planted.accounts.delay += 800_000

    planted.at(AT, oversleep)
    planted.at(AT + 1, takes(planted, 700_000, cpu=700_000))
    row = planted.run().only_miss()
    assert (row["tick"], row["missed"], row["cause"]) == (AT + 3, 1, MissCause.WOKEN_LATE)
    assert row["taken"][:2].tolist() == [700_000, 900_000]


@pytest.mark.parametrize(("more", "missed"), [(500_000, 0), (800_000, 1)])
def test_a_tick_that_begins_at_once_is_accounted_for_with_the_one_before(more: int, missed: int) -> None:
    planted = Planted()
    planted.at(AT, takes(planted, 1_100_000, cpu=1_100_000))
    planted.at(AT + 1, takes(planted, more, cpu=more))
    ticks = planted.run().ticks
    after = ticks[ticks["tick"] > AT]
    assert after["at_once"][:3].tolist() == [1, 0, 0]
    assert after["tick"][0] == AT + 1
    assert after["wakeup_ns"][0] == 200_000
    assert (int(ticks["missed"].sum()), int(after["missed"][1])) == (missed, missed)
    if missed:
        assert (after["cause"][1], int(after["taken"][1][0])) == (MissCause.COMPUTED, 1_100_000 + more)


def test_what_the_host_took_long_before_is_not_charged_to_a_miss() -> None:
    planted = Planted(ticks=150)
    planted.at(AT, takes(planted, 0, steal=50 * MS))
    planted.at(AT + 1, planted.loop.tell)
    planted.at(AT + 5, lambda: planted.clock.oversleep.append(4 * MS))
    row = planted.run().only_miss()
    assert (row["missed"], row["cause"], row["taken"][3]) == (4, MissCause.WOKEN_LATE, 0)


@pytest.mark.parametrize(("short", "reads"), [(100_000, 0), (0, 1)])
def test_what_the_host_took_is_read_in_a_tick_after_a_long_stall_alone(short: int, reads: int) -> None:
    planted = Planted()
    # Of it, 0.1 ms are the driver's, which is in step with the loop here.
    kept = LONG_STALL_NS - 100_000 - short
    planted.at(AT, takes(planted, 2 * MS + kept, cpu=2 * MS))
    read, steal_ns = [], planted.accounts.steal_ns

    def counted() -> int:
        read.append(planted.loop.deadlines.at.tick)
        return steal_ns()

    planted.accounts.steal_ns = counted  # type: ignore[method-assign]
    row = planted.run().only_miss()
    assert (row["cause"], row["taken"][1]) == (MissCause.COMPUTED, LONG_STALL_NS - short)
    assert len([tick for tick in read if tick > AT]) == reads


def test_a_system_that_says_nothing_leaves_what_the_clock_says() -> None:
    planted = Planted()
    planted.accounts.delay = planted.accounts.steal = -1
    planted.at(AT, takes(planted, 5 * MS, cpu=5 * MS))
    assert planted.run().only_miss()["cause"] == MissCause.COMPUTED


def test_accounts_that_are_slow_to_read_are_done_without() -> None:
    planted = Planted()
    reads = []

    def slow() -> int:
        reads.append(planted.clock.now())
        planted.clock.work(300_000)
        return 0

    planted.accounts.steal_ns = slow  # type: ignore[method-assign]
    planted.at(AT, takes(planted, 5 * MS))
    assert planted.run().only_miss()["cause"] == MissCause.WOKEN_LATE
    assert STEAL_UNREAD in planted.events
    assert max(reads) < planted.ticks["time_ns"][0], "it was read before the loop ran, and never again"


def test_a_stall_that_frees_the_fingers_is_logged_with_its_cause() -> None:
    planted = Planted()

    def oversleep() -> None:
        planted.clock.oversleep.append(12 * MS)
        planted.accounts.steal += 20 * MS

    planted.at(AT, oversleep)
    planted.run()
    assert planted.only_miss()["safety"] & Safety.OVERRUN_STREAK
    (line,) = (line for line in planted.events if "too many late ticks in a row" in line)
    assert line.endswith(": 12 the last time, taken by the host")
