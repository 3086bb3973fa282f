"""The loop in compiled code, its deadlines, clocks and threads: after samples, by the system's time, all items once."""

import os
import threading
import time
from collections.abc import Callable
from typing import Any

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from live_peers import PATIENCE
from live_scripted import FIST, FREE, FakeClock, Moment, ScriptedGlove, make_setup
from numpy.typing import NDArray
from sphere_scenes import UNTIMED

from hhsim.arrays import IntArray
from hhsim.kernels.clock import await_event, monotonic_ns, thread_cpu_ns
from hhsim.kernels.live.deadlines import (
    AFTER_MEAN,
    EARLIEST,
    LARGEST_SHIFT,
    LEAST_SAMPLES,
    PASSED,
    PHASE,
    WEIGHT,
    count_phase,
    deadline_shift,
    wait_periods,
)
from hhsim.kernels.parallel.thread_team import (
    DISMISSED,
    NOTHING,
    WORDS,
    await_done,
    dismiss,
    item_done,
    post,
    rest,
    take_item,
)
from hhsim.kernels.tick.state import STATUS_START_INSIDE
from hhsim.live.drivers.poses import FixedPose
from hhsim.live.gloves import PoseConfig
from hhsim.live.processes import RingReader
from hhsim.live.session.driver import GloveDriver
from hhsim.live.session.loop import LiveLoop, deadline_record, loop_options
from hhsim.live.session.memory import SessionMemory
from hhsim.live.session.setup import OutputLimits, SafetyLimits
from hhsim.solver.solver import HandSolver
from hhsim.solver.workspace import zeroed

ENOUGH = 300
"""Ticks of a run."""
CLOSING = [Moment(FREE + (FIST - FREE) * i / 60) for i in range(61)]


class PresentClock(FakeClock):
    """The time of now, which no work adds to."""

    def now(self) -> int:
        return time.monotonic_ns()


def run(
    rate: float, script: list[Moment] = CLOSING, glove: type[ScriptedGlove] = ScriptedGlove, hertz: float = 0.0
) -> tuple[LiveLoop, SessionMemory, int, int]:
    """A hand that closes on the ball; also how often Python solved a tick, and how often it put the hand somewhere."""
    safety = SafetyLimits(watchdog=False, stale=1.0, heartbeat_stale=1.0)
    setup = make_setup(output=OutputLimits(ramp=0.01), safety=safety, rate=rate)
    memory, worn = SessionMemory.create(), glove(PresentClock(), script)
    driver = GloveDriver(memory, worn, FixedPose(PoseConfig()))
    driver.open()
    loop = LiveLoop(setup, memory, worn.info)
    loop.prepare()
    one: Any = loop.one_tick
    asked, placed, solve, begin = [], [], one.solve, one.begin

    def solved() -> None:
        asked.append(True)
        solve()

    def put(*given: Any) -> list[int]:
        placed.append(given)
        return begin(*given)

    one.solve, one.begin = solved, put

    def end() -> None:
        until = time.monotonic() + PATIENCE
        while memory.ticks.written < ENOUGH and time.monotonic() < until:
            if isinstance(worn, LineGlove):
                os.write(worn.end, b"-")
            loop.place()
            time.sleep(1.0 / hertz if hertz else 0.01)
        loop.stop("enough")

    threads = [threading.Thread(target=target) for target in (driver.carry, end)]
    for thread in threads:
        thread.start()
    try:
        assert loop.run() == "enough"
    finally:
        loop.end()
        for thread in threads:
            thread.join()
        driver.close()
    loop.story.tell()
    assert worn.commands, "the driver was woken"
    return loop, memory, len(asked), len(placed)


@pytest.mark.parametrize(("rate", "inside"), [(1000.0, False), (1000.0, True), (10_000.0, False)])
def test_ticks_of_compiled_code_are_those_of_a_replay_bit_for_bit(rate: float, inside: bool) -> None:
    loop, memory, asked, placed = run(rate, [Moment(FIST)] if inside else CLOSING)
    assert (asked, placed) == (0, 1), "Python puts the hand where it begins, and solves no tick"
    ticks = RingReader(memory.ticks).read(10**6)[1]
    period, missed = ticks["tick"], ticks["missed"]
    np.testing.assert_array_equal(np.diff(period), 1 + missed[1:])
    moved = np.diff(ticks["time_ns"] + ticks["early_ns"]) - np.diff(period) * round(1e9 / rate)
    assert np.abs(moved).max() <= LARGEST_SHIFT * round(1e9 / rate), "towards the samples"
    assert ticks["total"].any(), "the hand touches the ball"
    began_inside = (ticks["status"] & STATUS_START_INSIDE) != 0
    # On a machine that is late, the hand of the first sample has closed already.
    assert began_inside[0] or not inside
    assert not began_inside[1:].any()
    again = HandSolver(
        loop.setup.worn[0].model, loop.setup.seen.tree.arrays(), loop_options(loop.setup.options, rate)
    ).run(*(ticks[f"haptic_{name}"] for name in ("position", "orientation", "flexion", "abduction")))
    for name in UNTIMED:
        np.testing.assert_array_equal(getattr(again, name), ticks[name], err_msg=name)
    assert memory.status["missed"] == sum(memory.status["missed_by"])


class LineGlove(ScriptedGlove):
    """Has a sample whenever something is written to its line."""

    def open(self, timeout: float = 5.0) -> None:
        self.line, self.end = os.pipe2(os.O_NONBLOCK)

    def descriptors(self) -> tuple[int, ...]:
        return (self.line,)

    def read(self, samples_out: NDArray[np.void]) -> int:
        try:
            os.read(self.line, 64)
        except BlockingIOError:
            return 0
        return super().read(samples_out)

    def close(self) -> None:
        os.close(self.line)
        os.close(self.end)


def test_a_tick_begins_with_the_sample_that_comes_while_the_loop_waits() -> None:
    # At 290 Hz samples come everywhere in the loop's period.
    _, memory, _, _ = run(1000.0, glove=LineGlove, hertz=290.0)
    ticks, samples = RingReader(memory.ticks).read(10**6)[1], RingReader(memory.samples).read(10**6)[1]
    early = np.flatnonzero(ticks["early_ns"] > 0)
    assert len(early) > 0
    assert ticks["early_ns"].max() <= EARLIEST * 1_000_000
    assert (ticks["wakeup_ns"][early] < ticks["early_ns"][early]).all() and (ticks["wakeup_ns"] >= 0).all()
    handed = samples["handed_ns"][np.searchsorted(samples["seq"], ticks["input_seq"][early])]
    at_the_earliest = ticks["early_ns"][early] == EARLIEST * 1_000_000
    assert ((handed == ticks["time_ns"][early]) | (at_the_earliest & (handed < ticks["time_ns"][early]))).all()
    assert (np.diff(ticks["tick"]) == 1 + ticks["missed"][1:]).all(), "one tick a period all the same"


def test_no_deadline_is_left_early() -> None:
    late = np.full(20, -7, np.int64)
    deadlines = deadline_record(1_000_000, time.monotonic_ns())[0]
    wait_periods(deadlines, np.zeros(1, np.int64))
    began = time.monotonic_ns()
    missed = wait_periods(deadlines, late)
    took = time.monotonic_ns() - began
    assert (late >= PASSED).all()
    assert np.count_nonzero(late == PASSED) <= missed
    assert took >= 20 * 1_000_000 + max(0, late[-1])


PERIOD = 1_000_000
LONG_AGO = 7_000_000_000_123


def follow(sent: NDArray[np.int64], begin: int) -> tuple[list[int], list[int]]:
    """Of a loop that begins then: how long before its deadline each sample came, and how far deadlines moved [ns]."""
    phase = zeroed(PHASE)[0]
    deadline, at, ahead, moved = begin, 0, [], []
    while at < len(sent):
        newest = int(np.searchsorted(sent, deadline, "right"))
        if newest > at:
            ahead.append(deadline - int(sent[newest - 1]))
            count_phase(phase, int(sent[newest - 1]), PERIOD)
            at = newest
        moved.append(deadline_shift(phase, deadline, PERIOD, PERIOD))
        deadline += PERIOD + moved[-1]
    return ahead, moved


@settings(max_examples=15)
@given(
    offset=st.integers(0, PERIOD - 1),
    every=st.sampled_from([1, 2, 4, 5, 10]),
    jitter=st.floats(0.0, 0.03),
    parts_per_million=st.integers(-50, 50),
)
def test_samples_come_where_ticks_can_begin_with_them(
    offset: int, every: int, jitter: float, parts_per_million: int
) -> None:
    rng = np.random.default_rng(offset)
    # Half a period is the longest way, and jitter and a clock that runs away make it longer.
    count = LEAST_SAMPLES + int(0.8 / LARGEST_SHIFT) // every + 400
    steady = np.arange(count) * every * PERIOD * (1.0 + 1e-6 * parts_per_million)
    sent = LONG_AGO + np.sort(steady + rng.normal(0.0, jitter * PERIOD, count)).astype(np.int64)
    ahead, moved = follow(sent, LONG_AGO - offset)
    before = np.array(ahead[-300:]) / PERIOD
    assert np.abs(moved).max() <= LARGEST_SHIFT * PERIOD
    # A clock that goes faster or slower leads the running mean by what it gains in as many samples as that weighs.
    leads = every * 1e-6 * abs(parts_per_million) / WEIGHT
    assert abs(np.median(before) - AFTER_MEAN) <= leads + 0.5 * jitter + 1e-3
    assert 0.0 < np.percentile(before, 2.0) <= np.percentile(before, 98.0) < EARLIEST


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


MOST = 6
"""Items of the largest task."""


@numba.njit(nogil=True)  # type: ignore[untyped-decorator]
def work_until_dismissed(word: IntArray, taken: IntArray, mine: IntArray) -> None:
    looks, item = 0, 0
    while item != DISMISSED:
        item = take_item(word)
        if item >= 0:
            looks = 0
            taken[item] += 1
            mine[0] += 1
            item_done(word)
        else:
            rest(looks)
            looks += 1


@numba.njit(nogil=True)  # type: ignore[untyped-decorator]
def lead(word: IntArray, taken: IntArray, tasks: int) -> int:
    wrong = 0
    for number in range(tasks):
        items = 1 + number % MOST
        taken[:] = 0
        post(word, items)
        # Every now and then the helpers must do all of it: on a busy machine they might else never get to anything.
        while number % 200 != 0:
            item = take_item(word)
            if item == NOTHING:
                break
            taken[item] += 1
            item_done(word)
        await_done(word, items)
        for i in range(MOST):
            wrong += taken[i] != (1 if i < items else 0)
    dismiss(word)
    return wrong


@pytest.mark.parametrize("helpers", [1, 2, 3])
def test_every_item_of_every_task_is_done_once(helpers: int) -> None:
    word, taken = np.zeros(WORDS, np.int64), np.zeros(MOST, np.int64)
    mine = np.zeros((helpers, 16), np.int64)
    assert lead(word, taken, 0) == 0
    work_until_dismissed(word, taken, mine[0])
    post(word, 0)
    threads = [threading.Thread(target=work_until_dismissed, args=(word, taken, own)) for own in mine]
    for thread in threads:
        thread.start()
    assert lead(word, taken, 20_000) == 0
    for thread in threads:
        thread.join()
    assert mine.sum() >= sum(1 + number % MOST for number in range(0, 20_000, 200))
