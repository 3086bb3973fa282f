"""Deadlines: a tick begins in its period, late or in time, or the period is missed and never made up for."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from live_scripted import Deadlines, FakeClock

from hhsim.kernels.live.deadlines import EARLIEST, NOTHING

PERIOD = 1_000_000


def started() -> tuple[FakeClock, Deadlines]:
    clock = FakeClock(0)
    return clock, Deadlines(PERIOD, clock)


@pytest.mark.parametrize("past", [0, 1, PERIOD // 2])
def test_work_that_ends_in_the_next_period_is_followed_at_once(past: int) -> None:
    clock, deadlines = started()
    deadlines.wait()
    clock.work(PERIOD + past)
    deadlines.wait()
    at = deadlines.at
    assert (at.tick, at.missed, at.at_once, at.deadline_ns) == (1, 0, 1, 2 * PERIOD)
    assert (at.wakeup_ns, at.late_ns, at.woke_ns) == (past, past, clock.now())
    assert clock.slept == [PERIOD]
    deadlines.wait()
    assert (at.tick, at.missed, at.at_once, clock.slept[-1]) == (2, 0, 0, 3 * PERIOD)


def wait_for(clock: FakeClock, deadlines: Deadlines, came: int) -> Deadlines:
    """Wait for the next tick, when something comes at a time [ns]."""
    clock.alarms.append((came, lambda: None))
    deadlines.wait(lambda: came if clock.now() >= came else NOTHING)
    clock.alarms.clear()
    return deadlines


@given(
    st.lists(st.tuples(st.integers(0, 3 * PERIOD), st.integers(0, 2 * PERIOD), st.integers(0, 3 * PERIOD)), max_size=60)
)
def test_however_things_come_there_is_one_tick_a_period(steps: list[tuple[int, int, int]]) -> None:
    clock, deadlines = started()
    at, before, asked = deadlines.at, -1, 0
    for work, oversleep, after in steps:
        clock.oversleep = [oversleep]
        wait_for(clock, deadlines, asked + after)
        assert at.tick == before + 1 + at.missed
        assert at.deadline_ns == (at.tick + 1) * PERIOD
        assert 0 <= at.early_ns <= EARLIEST * PERIOD and 0 <= at.wakeup_ns < PERIOD
        assert clock.now() == at.woke_ns == at.deadline_ns - at.early_ns + at.wakeup_ns
        if at.early_ns:
            assert at.woke_ns < at.deadline_ns and at.missed == at.at_once == 0
            assert asked <= at.deadline_ns - EARLIEST * PERIOD
            assert at.deadline_ns - at.early_ns in (asked + after, (1.0 - EARLIEST) * PERIOD + at.deadline_ns - PERIOD)
        before = at.tick
        clock.work(work)
        asked = clock.now()
    assert at.missed_total == before + 1 - len(steps)
