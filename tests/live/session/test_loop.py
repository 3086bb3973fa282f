"""The loop with a scripted glove on a clock of its own: each fault frees the fingers in the tick it is seen in."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from live_scripted import CLOSING, FIST, FREE, QUICK, FakeClock, Moment, ScriptedGlove, ScriptedSession

from hhsim.arrays import FloatArray
from hhsim.kernels.live.deadlines import LARGEST_SHIFT
from hhsim.kernels.tick.state import STATUS_CAPACITY_EXCEEDED
from hhsim.live.device import DeviceError
from hhsim.live.drivers.poses import NO_POSE, FixedPose, Pose, PoseSource
from hhsim.live.gloves import PoseConfig
from hhsim.live.processes import RingReader, Stage
from hhsim.live.session.driver import GloveDriver
from hhsim.live.session.memory import SessionMemory
from hhsim.live.session.setup import SafetyLimits
from hhsim.live.session.story import BEGINS_INSIDE
from hhsim.result.safety import Safety

PERIOD = 1_000_000
HOLDING = [*CLOSING, *[Moment(FIST)] * 60]
"""A hand that is held from tick 90 or so to tick 119."""
UNUSABLE = "a sample that cannot be used: the fingers are free"


def held_on(count: int) -> list[Moment]:
    return [Moment(FIST)] * count


@pytest.fixture(scope="module")
def held() -> ScriptedSession:
    return ScriptedSession(HOLDING).run()


def test_a_hand_that_holds_is_held_and_is_released_at_the_end(held: ScriptedSession) -> None:
    ticks, status, sent = held.ticks, held.memory.status, held.glove.commands
    assert held.reason == "duration"
    assert ticks["command_stiffness"][100].max() == 0.3
    assert ticks["safety"].tolist() == [*[0] * 120, Safety.STOPPING]
    assert (sent[-1].stiffness == 0.0).all() and len(held.glove.released) == 1
    assert not np.any([command.force for command in sent]), "it takes limits"
    assert ticks["tick"].tolist() == ticks["input_seq"].tolist() == list(range(121))
    assert np.abs(np.diff(ticks["time_ns"]) - PERIOD).max() <= LARGEST_SHIFT * PERIOD, "towards the samples"
    assert (ticks["latency_ns"] >= 0).all()
    assert len(held.samples) == 121
    # What is published is what the glove was told, and the status that of the last tick.
    np.testing.assert_array_equal(ticks["command_stiffness"], [command.stiffness for command in sent])
    np.testing.assert_array_equal(ticks["command_bend"], [command.bend for command in sent])
    assert (status["stage"], status["ticks"], status["safety"]) == (Stage.ENDING, 121, Safety.STOPPING)
    assert status["sample_ns"] == held.samples["time_ns"][-1]
    assert status["heartbeat_ns"] == ticks["time_ns"][-1] + ticks["wakeup_ns"][-1]
    assert (status["battery"], status["counters"][7], status["counters"][8]) == (-1, 121, 0)
    assert status["force"].max() > 0.0 and BEGINS_INSIDE not in held.events


def early_ticks(rest: int, late: int = -1) -> list[int]:
    """How early ticks are if a glove sends 0.4 ms before a deadline, rests for so many, and is late with one sample."""
    script = [Moment(FIST, early_ns=400_000) if i % (rest + 1) == 0 else Moment() for i in range(120)]
    session = ScriptedSession(script)
    session.both.driver.take()
    session.loop.start()
    for tick in range(len(script)):
        if tick == late:
            session.loop.wait()
            session.clock.alarms.append((session.clock.now() + 50_000, session.both.driver.take))
            session.loop.tick()
        else:
            session.both.step()
    session.loop.end()
    return [int(early) for early in RingReader(session.memory.ticks).read(10**6)[1]["early_ns"]]


def test_ticks_begin_with_their_samples_and_one_that_is_late_delays_no_others() -> None:
    assert early_ticks(0)[1:] == [400_000] * 119
    assert early_ticks(4)[1:] == ([0] * 4 + [400_000]) * 23 + [0] * 4
    # It comes right after its deadline; the next tick takes it, and the one after that waits for its own sample.
    assert early_ticks(0, 60)[60:] == [0, 750_000, *[400_000] * 58]
    # Where no other sample follows soon, it is taken as soon as a tick can be due.
    assert early_ticks(4, 60)[58:67] == [0, 0, 0, 750_000, 0, 0, 0, 400_000, 0]


class PoseUntil(PoseSource):
    """A palm whose pose comes until a time."""

    name, last = "silent", 10**9 + 121 * PERIOD

    def read(self, now_ns: int) -> Pose:
        return min(now_ns, self.last), *NO_POSE[1:]


def comes_back_third(session: ScriptedSession) -> None:
    tries: list[int] = []

    def reconnect() -> bool:
        tries.append(session.loop.deadlines.at.tick)
        # It is looked for again and again, but not in every tick.
        assert tries == [121, 131, 141][: len(tries)]
        return len(tries) == 3

    session.glove.reconnect = reconnect


def driver_rests(session: ScriptedSession) -> None:
    take, at = session.both.driver.take, session.loop.deadlines.at
    session.both.driver.take = lambda: None if 100 <= at.tick < 140 else take()


@dataclass
class Fault:
    """What happens after HOLDING; the bit stands in those ticks alone, whose fingers are free; what the log says."""

    script: list[Moment]
    bit: Safety
    ticks: Sequence[int]
    told: str
    plant: Callable[[ScriptedSession], object] = lambda session: None
    pose: PoseSource | None = None
    unsent: int = 0
    """Ticks whose command the glove never gets."""


FAULTS = {
    # The last sample is in tick 119, read 0.1 ms after its deadline: 25 ms have passed when tick 145 begins.
    "stale": Fault(
        [*[Moment(None)] * 60, *held_on(40)],
        Safety.STALE_INPUT,
        range(145, 180),
        "no fresh input: the fingers are free: for more than 25 ms, as --stale says",
    ),
    "stale pose": Fault(held_on(50), Safety.STALE_INPUT, range(145, 171), "no fresh input", pose=PoseUntil()),
    **{
        f"bad {bad} {good}": Fault(
            [*[Moment(bad, good=good)] * 3, *held_on(30)], Safety.NOT_FINITE, range(120, 123), UNUSABLE
        )
        for bad, good in ((np.nan, False), (np.nan, True), (np.inf, True), (1e9, True))
    },
    "gone": Fault(
        [Moment(gone=True), *held_on(40)],
        Safety.DEVICE_LOST,
        range(120, 141),
        "the glove is gone: the fingers are free: the scripted glove is gone",
        comes_back_third,
        unsent=21,
    ),
    # The command was handed over before the glove refused it; neither that one is sent late, nor one while it is gone.
    "refuses": Fault(
        [Moment(FIST, send_fails=True), *held_on(20)],
        Safety.DEVICE_LOST,
        range(121, 122),
        "the glove is gone: the fingers are free: the scripted glove takes nothing",
        unsent=2,
    ),
    # The driver's last sign of life is in tick 99, and 20 ms have passed when tick 119 begins: deadlines that go after
    # samples are a little more than a period apart.
    "driver silent": Fault(
        held_on(60), Safety.DEVICE_LOST, range(119, 140), "its driver has given no sign of life", driver_rests
    ),
    "long tick": Fault(
        held_on(40),
        Safety.OVERRUN_STREAK,
        (120, 131),
        "during a tick",
        lambda session: session.solving(lambda: session.clock.work(10 * PERIOD), 120),
    ),
}


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_frees_the_fingers_in_its_ticks_and_the_ramp_follows(name: str) -> None:
    fault = FAULTS[name]
    session = ScriptedSession([*HOLDING, *fault.script], fault.pose)
    fault.plant(session)
    rows, first = session.run().ticks, fault.ticks[0]
    there, ticks = (rows["safety"] & fault.bit) != 0, rows["tick"]
    np.testing.assert_array_equal(ticks[there], ticks[np.isin(ticks, fault.ticks)])
    assert (rows["command_stiffness"][there] == 0.0).all()
    assert rows["command_stiffness"][ticks == first - 1].max() == 0.3, "it held before"
    after = rows[ticks > fault.ticks[-1]]
    after = after[after["safety"] == 0][:10]
    if len(after):
        rise = after["command_stiffness"].max(axis=1)
        np.testing.assert_allclose(rise, 0.03 * np.arange(1, len(after) + 1))
    assert any(fault.told in text for text in session.events), session.events
    assert len(session.glove.commands) == len(rows) - fault.unsent
    if fault.bit is Safety.NOT_FINITE:
        assert rows["input_seq"][119:124].tolist() == [119, 119, 119, 119, 123], "it is never used"
        assert len(session.samples) == len(rows), "it is recorded"
        assert np.abs(rows["haptic_flexion"]).max() <= FIST


@pytest.mark.parametrize(
    ("unit", "reading", "detail"),
    [
        ("rad", 80.2, ": bend is 80.2 rad, and 6.28 rad the most of a hand: are the angles in degrees?"),
        ("rad", 8e9, ": bend is 8e+09 rad, and 6.28 rad the most of a hand"),
        (
            "",
            -57.0,
            ": bend is -57, and 1.5 the most of a hand: raw counts need a calibration with the readings of the open and"
            " of the closed hand",
        ),
        ("", 1.2, ""),
        ("", np.nan, ""),
        ("count", 3000.0, ""),
    ],
)
def test_a_reading_of_no_hand_is_named(unit: str, reading: float, detail: str) -> None:
    script = [Moment(FREE), Moment(FREE, good=False, reading=reading), Moment(FREE)]
    assert f"{UNUSABLE}{detail}" in ScriptedSession(script, unit=unit).run().events
    if np.isnan(reading):
        # A channel that became no number is named, and one that never was is not.
        assert f"{UNUSABLE}: bend is nan" in ScriptedSession([Moment(FREE, reading=0.5), *script[1:]]).run().events


def test_a_hand_that_begins_inside_the_object_is_told_of_once() -> None:
    session = ScriptedSession([Moment(FREE)] * 5, FixedPose(PoseConfig(position=(0.0, 0.0, -0.05)))).run()
    assert [text for text in session.events if "begins inside" in text] == [BEGINS_INSIDE]


def test_a_streak_of_overruns_frees_the_fingers() -> None:
    slow = [Moment(FIST, work_ns=PERIOD + 1_000)] * 14
    session = ScriptedSession([*HOLDING, *slow, *held_on(30)], duration=0.17).run()
    ticks = session.ticks
    # Every second one begins at once, and a period is missed after it.
    assert ticks["missed"].sum() == 7 == ticks["at_once"].sum() == session.loop.deadlines.at.missed_total
    freed = (ticks["safety"] & Safety.OVERRUN_STREAK) != 0
    # The tenth tick in a row that misses a period or begins late, and the four after it.
    assert np.flatnonzero(freed).tolist() == [130, 131, 132, 133, 134]
    assert (ticks["command_stiffness"][freed] == 0.0).all()
    assert (np.diff(ticks["tick"])[119:] == 1 + ticks["missed"][120:]).all()


def test_what_was_held_before_a_loss_never_comes_to_a_glove_that_is_back() -> None:
    session = ScriptedSession([*HOLDING, *held_on(21)])
    loop, driver, status = session.loop, session.both.driver, session.memory.status
    loop.start()
    for _ in range(100):
        session.both.step()
    held = len(session.glove.commands)
    loop.wait()
    loop.tick()
    assert status["command_stiffness"].max() == 0.3
    driver.lose(DeviceError("on purpose"))
    for _ in range(3):
        driver.take()
        driver.give()
    assert len(session.glove.commands) == held, "the loop has not freed the fingers yet"
    session.both.step()
    session.both.step()
    assert session.glove.commands[held].stiffness.max() <= 0.03 + 1e-12


def fails() -> None:
    raise ZeroDivisionError("on purpose")


def test_a_solver_that_raises_frees_the_fingers_and_the_loop_goes_on() -> None:
    session = ScriptedSession(HOLDING)
    session.solving(fails, 100, 101, 102)
    session.run()
    assert session.ticks["tick"].tolist() == [*range(100), *range(103, 121)], "there is nothing to replay in them"
    sent = [command.stiffness.max() for command in session.glove.commands]
    assert sent[99] == 0.3 and sent[100:103] == [0.0] * 3
    assert any("ZeroDivisionError: on purpose" in text for text in session.events)


def test_a_solver_that_is_full_frees_the_fingers() -> None:
    session = ScriptedSession(HOLDING)
    solve = session.loop.one_tick.solve

    def overflow() -> None:
        solve()
        session.loop.one_tick.record.status[:] |= STATUS_CAPACITY_EXCEEDED

    session.loop.one_tick.solve = overflow
    session.run()
    assert ((session.ticks["safety"] & Safety.SOLVER_FAILED) != 0).all()
    assert (session.ticks["command_stiffness"] == 0.0).all()


def test_without_a_watchdog_the_fingers_are_free_and_then_ramped() -> None:
    session = ScriptedSession(HOLDING, safety=SafetyLimits(watchdog=True))
    status = session.memory.status

    def arrive() -> None:
        status["watchdog_armed"] = 1
        status["watchdog_ns"] = session.clock.now()

    session.glove.at_tick[90] = arrive
    session.run()
    guarded = np.flatnonzero((session.ticks["safety"] & Safety.NO_WATCHDOG) == 0)
    assert guarded[0] in (90, 91)
    assert (session.ticks["command_stiffness"][: guarded[0]] == 0.0).all()
    assert session.ticks["command_stiffness"][119].max() == 0.3


def test_a_dry_run_sends_nothing_at_all() -> None:
    session = ScriptedSession(HOLDING, dry_run=True, safety=SafetyLimits()).run()
    assert session.glove.commands == session.glove.released == []
    assert ((session.ticks["safety"] & Safety.DRY_RUN) != 0).all()
    assert (session.ticks["command_stiffness"] == 0.0).all()
    assert (session.ticks["latency_ns"] >= 0).all(), "the time to the command is known all the same"


@pytest.mark.parametrize(("backlog", "silent"), [(40, 5), (0, 20)])
def test_nothing_is_solved_before_there_is_an_input_and_none_of_before_the_loop_is_used(
    backlog: int, silent: int
) -> None:
    session = ScriptedSession([*[Moment(None)] * silent, *HOLDING])
    session.glove.backlog = backlog
    session.run()
    assert len(session.samples) == backlog + 121, "it is recorded"
    assert (session.ticks["tick"][0], session.ticks["input_seq"][0]) == (silent, backlog)
    assert len(session.glove.commands) == silent + 121
    assert all((command.stiffness == 0.0).all() for command in session.glove.commands[:silent])


@pytest.mark.parametrize("reason", ["SIGTERM", "stopped"])
def test_a_stop_frees_the_fingers_in_the_next_tick_and_releases(reason: str) -> None:
    session = ScriptedSession(HOLDING, duration=None)
    status, stop = session.memory.status, session.loop.stop
    asked = {"SIGTERM": lambda: stop("SIGTERM"), "stopped": lambda: status.__setitem__("stop_requested", 1)}
    session.glove.at_tick[100] = asked[reason]
    assert session.run().reason == reason
    assert (session.glove.commands[-1].stiffness == 0.0).all()
    assert session.glove.commands[-2].stiffness.max() == 0.3
    assert len(session.glove.commands) in (101, 102) and len(session.glove.released) == 1


def test_a_fault_of_the_loop_itself_releases_the_glove() -> None:
    session = ScriptedSession(HOLDING)
    session.glove.at_tick[100] = fails
    with pytest.raises(ZeroDivisionError, match="on purpose"):
        session.run()
    assert len(session.glove.released) == 1
    assert (session.memory.status["command_stiffness"] == 0.0).all()


TICKS = np.arange(1, 101)


@pytest.mark.parametrize(
    ("after_stall", "missed", "overrun", "expected"),
    [
        *((policy, 9, 0, np.full(100, 0.3)) for policy in ("release", "ease", "hold")),
        # The watchdog may have freed the fingers in the stall.
        *((policy, 19, 1, np.minimum(0.006 * (TICKS - 1), 0.3)) for policy in ("release", "ease", "hold")),
        ("hold", 18, 0, np.full(100, 0.3)),
        ("ease", 18, 0, np.clip(np.maximum(0.3 - 0.003 * TICKS, 0.006 * TICKS), 0.0, 0.3)),
    ],
)
def test_what_becomes_of_the_stiffness_after_a_stall(
    after_stall: str, missed: int, overrun: int, expected: FloatArray
) -> None:
    """A hand that is held, a stall in tick 90, and the stiffness of its stiffest finger from the tick after it on."""
    safety = SafetyLimits(watchdog=False, after_stall=after_stall)
    session = ScriptedSession([*HOLDING, *held_on(60)], safety=safety, output=replace(QUICK, ramp=0.05))
    session.glove.at_tick[90] = lambda: session.clock.oversleep.append(missed * PERIOD)
    session.run()
    (at,) = np.flatnonzero(session.ticks["missed"])
    assert session.ticks["missed"][at] == missed
    stiffness = session.ticks["command_stiffness"].max(axis=1)
    assert stiffness[at - 1] == 0.3
    stiffness = stiffness[at:-1]
    np.testing.assert_allclose(stiffness, expected[: len(stiffness)], atol=1e-12)
    assert np.count_nonzero(session.ticks["safety"] & Safety.OVERRUN_STREAK) == overrun


def test_while_the_stiffness_is_eased_a_fault_frees_the_fingers_at_once() -> None:
    safety = SafetyLimits(watchdog=False, after_stall="ease")
    session = ScriptedSession([*HOLDING[:110], Moment(FIST, good=False), *HOLDING[60:]], safety=safety)
    session.glove.at_tick[100] = lambda: session.clock.oversleep.append(12 * PERIOD)
    session.run()
    stiffness = session.ticks["command_stiffness"].max(axis=1)
    (bad,) = np.flatnonzero(session.ticks["safety"] & Safety.NOT_FINITE)
    assert stiffness[bad - 1] > 0.2 and stiffness[bad] == 0.0
    assert (stiffness[bad + 1 : bad + 5] < 0.3 * np.arange(1, 5) / 10 + 1e-9).all()


OLDEST = 20_000_000


def opened() -> tuple[GloveDriver, ScriptedGlove, FakeClock, Any]:
    clock, memory = FakeClock(), SessionMemory.create()
    glove = ScriptedGlove(clock, [Moment(FIST)])
    driver = GloveDriver(memory, glove, FixedPose(PoseConfig()), oldest_ns=OLDEST, now=clock.now)
    driver.open()
    return driver, glove, clock, memory.status


def command(status: Any, stiffness: float, now: int) -> None:
    """As the loop hands one over, with forces ten times its stiffness."""
    status["heartbeat_ns"] = now
    status["command_stiffness"] = stiffness
    status["command_force"] = 10.0 * stiffness
    status["command_version"][0] += 2


def test_the_newest_command_is_sent_once() -> None:
    driver, glove, clock, status = opened()
    driver.give()
    assert glove.commands == [], "there is none yet"
    command(status, 0.1, clock.now())
    command(status, 0.2, clock.now())
    status["command_version"][0] += 1
    driver.give()
    assert glove.commands == [], "it is being written"
    status["command_version"][0] += 1
    driver.give()
    driver.give()
    assert [(sent.stiffness.max(), sent.force.min()) for sent in glove.commands] == [(0.2, 2.0)]


def test_a_command_of_a_loop_that_stands_still_holds_nothing() -> None:
    driver, glove, clock, status = opened()
    command(status, 0.3, clock.now())
    clock.work(OLDEST)
    driver.give()
    command(status, 0.3, clock.now())
    clock.work(OLDEST + 1)
    driver.give()
    assert [sent.stiffness.max() for sent in glove.commands] == [0.3, 0.0]
    assert [sent.force.max() for sent in glove.commands] == [3.0, 0.0]
