"""The loop with a scripted glove on a clock of its own: each fault frees the fingers in the tick it is seen in."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from live_scripted import CLOSING, FIST, FREE, QUICK, Moment, ScriptedSession
from numpy.typing import NDArray

from hhsim.arrays import FloatArray
from hhsim.hand.quaternion import rotation_matrix
from hhsim.kernels.live.phase import LARGEST_SHIFT
from hhsim.kernels.tick.state import STATUS_CAPACITY_EXCEEDED
from hhsim.live.device import FORCES, LIMITS, DeviceError
from hhsim.live.devices.registry import PoseConfig
from hhsim.live.drivers.poses import FixedPose, PoseSource
from hhsim.live.processes import RingReader
from hhsim.live.session.settings import SafetyLimits
from hhsim.live.session.status import Stage
from hhsim.live.session.story import BEGINS_INSIDE
from hhsim.result.safety import Safety

PERIOD = 1_000_000
HOLDING = [*CLOSING, *[Moment(FIST)] * 60]


class Session(ScriptedSession):
    """A loop that runs a script to its end."""

    def stiffness_at(self, tick: int) -> FloatArray:
        """What the glove has been told when a tick is over, shape (5,)."""
        end = self.loop.clock.now() if tick < 0 else 10**9 + (tick + 2) * PERIOD
        sent = [command for command in self.glove.commands if command.time_ns < end]
        return sent[-1].stiffness


@pytest.fixture(scope="module")
def held() -> Session:
    return Session(HOLDING).run()


def test_a_hand_that_holds_is_held_and_is_released_at_the_end(held: Session) -> None:
    ticks, status, sent = held.ticks, held.memory.status, held.glove.commands
    assert held.reason == "duration"
    assert held.stiffness_at(100).max() == 0.3
    assert ticks["safety"].tolist() == [*[0] * 120, Safety.STOPPING]
    assert (sent[-1].stiffness == 0.0).all(), "the last tick frees the fingers"
    assert len(held.glove.released) == 1
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
    assert status["force"].max() > 0.0


def early_ticks(rest: int, late: int = -1) -> list[int]:
    """How early ticks are if a glove sends 0.4 ms before a deadline, rests for so many, and is late with one sample."""
    script = [Moment(FIST, early_ns=400_000) if i % (rest + 1) == 0 else Moment() for i in range(120)]
    session = Session(script)
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


def test_ticks_begin_with_their_samples() -> None:
    assert early_ticks(0)[1:] == [400_000] * 119
    assert early_ticks(4)[1:] == ([0] * 4 + [400_000]) * 23 + [0] * 4


def test_a_sample_that_came_too_late_does_not_delay_all_others() -> None:
    early = early_ticks(0, 60)
    # It comes right after its deadline; the next tick takes it, and the one after that waits for its own sample.
    assert early[60:] == [0, 750_000, *[400_000] * 58]
    # Where no other sample follows soon, it is taken as soon as a tick can be due.
    assert early_ticks(4, 60)[58:67] == [0, 0, 0, 750_000, 0, 0, 0, 400_000, 0]


@pytest.mark.parametrize("takes", [FORCES, LIMITS])
def test_a_glove_that_takes_forces_is_told_those_of_the_tick(takes: tuple[str, ...]) -> None:
    session = Session(HOLDING, takes=takes).run()
    told = [command.force for command in session.glove.commands]
    if takes is LIMITS:
        assert not np.any(told)
        return
    turn = rotation_matrix(session.ticks["orientation"])
    share = session.ticks["command_stiffness"] / 0.3
    expected = np.einsum("tfkj,tji->tfki", session.ticks["phalanx"], turn) * share[..., None, None]
    assert np.abs(expected).max() > 0.1
    np.testing.assert_allclose(told, expected, atol=1e-12)
    assert not told[-1].any(), "the last tick frees the fingers"


def assert_freed(session: Session, first: int, last: int, bit: Safety) -> None:
    """The bit stands in the ticks first to last, and in no other, and the fingers are free in them."""
    there = (session.ticks["safety"] & bit) != 0
    ticks = session.ticks["tick"]
    np.testing.assert_array_equal(ticks[there], ticks[(ticks >= first) & (ticks <= last)])
    assert (session.ticks["command_stiffness"][there] == 0.0).all()
    assert session.ticks["command_stiffness"][ticks == first - 1].max() == 0.3, "it held before"


def test_stale_input_frees_the_fingers_until_samples_come_and_then_they_are_ramped() -> None:
    session = Session([*HOLDING, *[Moment(None)] * 60, *[Moment(FIST)] * 40]).run()
    # The last sample is in tick 119, read 0.1 ms after its deadline: 25 ms have passed when tick 145 begins.
    assert_freed(session, 145, 179, Safety.STALE_INPUT)
    np.testing.assert_allclose(session.ticks["command_stiffness"][180:190].max(axis=1), 0.03 * np.arange(1, 11))
    late = "no fresh input: the fingers are free: for more than 25 ms, as --stale says"
    assert late in session.events


@pytest.mark.parametrize(("bad", "good"), [(np.nan, False), (np.nan, True), (np.inf, True), (1e9, True)])
def test_a_bad_sample_frees_the_fingers_in_its_tick_and_is_never_used(bad: float, good: bool) -> None:
    session = Session([*HOLDING, *[Moment(bad, good=good)] * 3, *[Moment(FIST)] * 30]).run()
    assert_freed(session, 120, 122, Safety.NOT_FINITE)
    assert session.ticks["input_seq"][119:124].tolist() == [119, 119, 119, 119, 123]
    assert len(session.samples) == len(session.ticks), "it is recorded"
    assert np.abs(session.ticks["haptic_flexion"]).max() <= FIST
    rise = session.ticks["command_stiffness"][123:133].max(axis=1)
    np.testing.assert_allclose(rise, 0.3 * np.arange(1, 11) / 10)


@pytest.mark.parametrize(
    ("unit", "reading", "detail"),
    [
        ("rad", 80.2, ": bend is 80.2 rad, and 6.28 rad the most of a hand: are the angles in degrees?"),
        ("rad", 8e9, ": bend is 8e+09 rad, and 6.28 rad the most of a hand"),
        ("", -57.0, ": bend is -57, and 1.5 the most of a hand"),
        ("", 1.2, ""),
        ("", np.nan, ""),
        ("count", 3000.0, ""),
    ],
)
def test_a_reading_of_no_hand_is_named(unit: str, reading: float, detail: str) -> None:
    session = Session([Moment(FREE), Moment(FREE, good=False, reading=reading), Moment(FREE)], unit=unit).run()
    assert f"a sample that cannot be used: the fingers are free{detail}" in session.events


def test_a_channel_that_became_no_number_is_named_and_one_that_never_was_is_not() -> None:
    said = "a sample that cannot be used: the fingers are free"
    script = [Moment(FREE, reading=0.5), Moment(FREE, good=False, reading=np.nan), Moment(FREE)]
    assert f"{said}: bend is nan" in Session(script).run().events
    assert said in Session([Moment(FREE), *script[1:]]).run().events


def test_why_a_glove_stays_away_is_told_when_it_is_known() -> None:
    session = Session([Moment(FREE), Moment(gone=True), *[Moment(FREE)] * 200])
    known, connect = iter([DeviceError("it speaks another language")]), session.glove.reconnect

    def reconnect() -> bool:
        for error in known:
            raise error
        return connect()

    session.glove.reconnect = reconnect  # type: ignore[method-assign]
    session.run()
    events = [text for text in session.events if "the glove is" in text]
    assert len(events) == 3, events
    assert events[0].startswith("the glove is gone: the fingers are free")
    assert events[1:] == ["the glove is still gone: it speaks another language", "the glove is back"]


def test_a_hand_that_begins_inside_the_object_is_told_of_once(held: Session) -> None:
    session = Session([Moment(FREE)] * 5, FixedPose(PoseConfig(position=(0.0, 0.0, -0.05)))).run()
    assert [text for text in session.events if "begins inside" in text] == [BEGINS_INSIDE]
    assert BEGINS_INSIDE not in held.events


def test_a_streak_of_overruns_frees_the_fingers() -> None:
    slow = [Moment(FIST, work_ns=PERIOD + 1_000)] * 14
    session = Session([*HOLDING, *slow, *[Moment(FIST)] * 30], duration=0.17).run()
    ticks = session.ticks
    # Every second one begins at once, and a period is missed after it.
    assert ticks["missed"].sum() == 7 == ticks["at_once"].sum() == session.loop.deadlines.at.missed_total
    freed = (ticks["safety"] & Safety.OVERRUN_STREAK) != 0
    # The tenth tick in a row that misses a period or begins late, and the four after it.
    assert np.flatnonzero(freed).tolist() == [130, 131, 132, 133, 134]
    assert (ticks["command_stiffness"][freed] == 0.0).all()
    assert (np.diff(ticks["tick"])[119:] == 1 + ticks["missed"][120:]).all()


def test_a_command_that_was_long_in_the_making_frees_the_fingers() -> None:
    session = Session([*HOLDING, *[Moment(FIST)] * 20])
    solve = session.loop.one_tick.solve

    def dawdle() -> None:
        if session.loop.deadlines.at.tick == 120:
            session.clock.work(10 * PERIOD)
        solve()

    session.loop.one_tick.solve = dawdle
    session.run()
    assert session.ticks["command_stiffness"][119].max() == 0.3
    assert session.ticks["safety"][120] == Safety.OVERRUN_STREAK
    assert (session.glove.commands[120].stiffness == 0.0).all()


def test_a_glove_that_goes_is_free_when_it_comes_back() -> None:
    session = Session([*HOLDING, Moment(gone=True), *[Moment(FIST)] * 30], duration=0.17)
    tries: list[int] = []

    def reconnect() -> bool:
        tries.append(session.loop.deadlines.at.tick)
        return len(tries) == 3

    session.glove.reconnect = reconnect  # type: ignore[method-assign]
    session.run()
    assert tries == [121, 131, 141], "it is looked for again and again, but not in every tick"
    assert_freed(session, 120, 140, Safety.DEVICE_LOST)
    assert len(session.glove.commands) == 120 + 29, "nothing is sent to a glove that is gone"
    np.testing.assert_allclose(session.ticks["command_stiffness"][141:151].max(axis=1), 0.03 * np.arange(1, 11))
    assert any("the glove is gone" in text and "scripted glove is gone" in text for text in session.events)
    assert "the glove is back" in session.events


def test_a_glove_that_takes_nothing_counts_as_gone_in_the_next_tick() -> None:
    session = Session([*HOLDING, Moment(FIST, send_fails=True), *[Moment(FIST)] * 20]).run()
    assert session.ticks["safety"][120] == 0, "the command was handed over before the glove refused it"
    tick = session.ticks[121]
    assert tick["safety"] == Safety.DEVICE_LOST
    assert (tick["command_stiffness"] == 0.0).all()
    assert tick["latency_ns"] == -1
    assert session.ticks["safety"][122] == 0, "it is reached again, and ramped"
    assert session.ticks["command_stiffness"][122].max() == pytest.approx(0.03)
    assert len(session.glove.commands) == len(session.ticks) - 2, (
        "the one that it refused is not sent late, nor is one while it is gone"
    )


def test_a_driver_that_falls_silent_frees_the_fingers() -> None:
    session = Session([*HOLDING, *[Moment(FIST)] * 60])
    take = session.both.driver.take
    session.both.driver.take = lambda: None if 100 <= session.loop.deadlines.at.tick < 140 else take()  # type: ignore[method-assign]
    session.run()
    freed = session.ticks["tick"][(session.ticks["safety"] & Safety.DEVICE_LOST) != 0]
    # Its last sign of life was in tick 99, and 20 ms have passed when tick 119 begins: deadlines that go after samples
    # are a little more than a period apart.
    assert freed.tolist() == list(range(119, 140))
    assert (session.ticks["command_stiffness"][119:140] == 0.0).all()
    assert any("its driver has given no sign of life" in text for text in session.events)


def test_what_was_held_before_a_loss_never_comes_to_a_glove_that_is_back() -> None:
    session = Session([*HOLDING, Moment(FIST), *[Moment(FIST)] * 20])
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


def test_a_solver_that_raises_frees_the_fingers_and_the_loop_goes_on() -> None:
    session = Session(HOLDING)
    solve = session.loop.one_tick.solve

    def fail() -> None:
        if 100 <= session.loop.deadlines.at.tick < 103:
            raise ZeroDivisionError("on purpose")
        solve()

    session.loop.one_tick.solve = fail
    session.run()
    assert session.ticks["tick"].tolist() == [*range(100), *range(103, 121)], "there is nothing to replay in them"
    assert session.stiffness_at(99).max() == 0.3
    for tick in (100, 101, 102):
        assert (session.stiffness_at(tick) == 0.0).all()
    assert any("ZeroDivisionError: on purpose" in text for text in session.events)


def test_a_solver_that_is_full_frees_the_fingers() -> None:
    session = Session(HOLDING)
    solve = session.loop.one_tick.solve

    def overflow() -> None:
        solve()
        session.loop.one_tick.record.status[:] |= STATUS_CAPACITY_EXCEEDED

    session.loop.one_tick.solve = overflow
    session.run()
    assert ((session.ticks["safety"] & Safety.SOLVER_FAILED) != 0).all()
    assert (session.ticks["command_stiffness"] == 0.0).all()


def test_without_a_watchdog_the_fingers_are_free_and_then_ramped() -> None:
    session = Session(HOLDING, safety=SafetyLimits(watchdog=True))
    status = session.memory.status

    def arrive() -> None:
        status["watchdog_armed"] = 1
        status["watchdog_ns"] = session.clock.now()

    session.glove.at_tick[90] = arrive
    session.run()
    guarded = np.flatnonzero((session.ticks["safety"] & Safety.NO_WATCHDOG) == 0)
    assert guarded[0] == 90 or guarded[0] == 91
    assert (session.ticks["command_stiffness"][: guarded[0]] == 0.0).all()
    assert session.ticks["command_stiffness"][119].max() == 0.3


def test_a_dry_run_sends_nothing_at_all() -> None:
    session = Session(HOLDING, dry_run=True, safety=SafetyLimits()).run()
    assert session.glove.commands == []
    assert session.glove.released == []
    assert ((session.ticks["safety"] & Safety.DRY_RUN) != 0).all()
    assert (session.ticks["command_stiffness"] == 0.0).all()
    assert (session.ticks["latency_ns"] >= 0).all(), "the time to the command is known all the same"


def test_what_came_before_the_loop_is_recorded_and_not_used() -> None:
    session = Session([*[Moment(None)] * 5, *HOLDING])
    session.glove.backlog = 40
    session.run()
    assert len(session.samples) == 40 + 121
    assert session.ticks["tick"][0] == 5
    assert session.ticks["input_seq"][0] == 40


def test_nothing_is_solved_before_there_is_an_input() -> None:
    session = Session([*[Moment(None)] * 20, *HOLDING]).run()
    assert session.ticks["tick"][0] == 20
    assert session.ticks["input_seq"][0] == 0
    assert len(session.glove.commands) == 141
    assert all((command.stiffness == 0.0).all() for command in session.glove.commands[:20])


def test_a_pose_that_stops_is_stale_input() -> None:
    last = 10**9 + 101 * PERIOD

    class Silent(PoseSource):
        name = "silent"

        def read(self, now_ns: int, position_out: FloatArray, orientation_out: FloatArray) -> int:
            return min(now_ns, last) if now_ns >= 10**9 + 5 * PERIOD else -1

    session = Session([*HOLDING, *[Moment(FIST)] * 20], Silent()).run()
    assert session.ticks["tick"][0] == 4, "there is no pose before"
    stale = session.ticks["time_ns"] - last > 1e9 * SafetyLimits().stale
    assert (session.ticks["safety"][stale] & Safety.STALE_INPUT > 0).all()
    assert not (session.ticks["safety"][~stale] & Safety.STALE_INPUT).any()
    assert (session.ticks["command_stiffness"][stale] == 0.0).all()


@pytest.mark.parametrize("how", ["signal", "asked"])
def test_a_stop_frees_the_fingers_in_the_next_tick_and_releases(how: str) -> None:
    session = Session(HOLDING, duration=None)

    def stop() -> None:
        if how == "signal":
            session.loop.stop("SIGTERM")
        else:
            session.memory.status["stop_requested"] = 1

    session.glove.at_tick[100] = stop
    session.run()
    assert session.reason == ("SIGTERM" if how == "signal" else "stopped")
    assert (session.glove.commands[-1].stiffness == 0.0).all()
    assert session.glove.commands[-2].stiffness.max() == 0.3
    assert len(session.glove.commands) in (101, 102)
    assert len(session.glove.released) == 1


def test_a_fault_of_the_loop_itself_releases_the_glove() -> None:
    session = Session(HOLDING)

    def fail() -> None:
        raise RuntimeError("on purpose")

    session.glove.at_tick[100] = fail
    with pytest.raises(RuntimeError, match="on purpose"):
        session.run()
    assert len(session.glove.released) == 1
    assert (session.memory.status["command_stiffness"] == 0.0).all()


def test_a_jump_of_a_right_angle_keeps_the_fingers_free_and_is_told() -> None:
    jump = FIST - np.radians(90.0)
    session = Session([*HOLDING, *[Moment(jump)] * 2, *[Moment(FIST)] * 20]).run()
    assert (session.ticks["command_stiffness"][120:] == 0.0).all(), "the samples that follow lift no doubt"
    assert any("jumped" in text for text in session.events)


def stalled(after_stall: str, missed: int) -> tuple[Session, NDArray[Any]]:
    """A hand that is held, a stall in tick 90, and the stiffness of its stiffest finger from the tick after it on."""
    safety = SafetyLimits(watchdog=False, after_stall=after_stall)
    session = Session([*HOLDING, *[Moment(FIST)] * 200], safety=safety, output=replace(QUICK, ramp=0.05))
    session.glove.at_tick[90] = lambda: session.clock.oversleep.append(missed * PERIOD)
    session.run()
    (at,) = np.flatnonzero(session.ticks["missed"])
    assert session.ticks["missed"][at] == missed
    assert session.ticks["command_stiffness"][at - 1].max() == 0.3
    return session, session.ticks["command_stiffness"][at:-1].max(axis=1)


TICKS = np.arange(1, 301)


@pytest.mark.parametrize(
    ("after_stall", "missed", "overrun", "expected"),
    [
        *((policy, 9, 0, np.full(300, 0.3)) for policy in ("release", "ease", "hold")),
        # The watchdog may have freed the fingers in the stall.
        *((policy, 19, 1, np.minimum(0.006 * (TICKS - 1), 0.3)) for policy in ("release", "ease", "hold")),
        ("hold", 18, 0, np.full(300, 0.3)),
        ("ease", 18, 0, np.clip(np.maximum(0.3 - 0.003 * TICKS, 0.006 * TICKS), 0.0, 0.3)),
    ],
)
def test_what_becomes_of_the_stiffness_after_a_stall(
    after_stall: str, missed: int, overrun: int, expected: FloatArray
) -> None:
    session, stiffness = stalled(after_stall, missed)
    np.testing.assert_allclose(stiffness, expected[: len(stiffness)], atol=1e-12)
    assert np.count_nonzero(session.ticks["safety"] & Safety.OVERRUN_STREAK) == overrun


def test_while_the_stiffness_is_eased_a_fault_frees_the_fingers_at_once() -> None:
    safety = SafetyLimits(watchdog=False, after_stall="ease")
    session = Session([*HOLDING[:110], Moment(FIST, good=False), *HOLDING[60:]], safety=safety)
    session.glove.at_tick[100] = lambda: session.clock.oversleep.append(12 * PERIOD)
    session.run()
    stiffness = session.ticks["command_stiffness"].max(axis=1)
    (bad,) = np.flatnonzero(session.ticks["safety"] & Safety.NOT_FINITE)
    assert stiffness[bad - 1] > 0.2
    assert stiffness[bad] == 0.0
    assert (stiffness[bad + 1 : bad + 5] < 0.3 * np.arange(1, 5) / 10 + 1e-9).all()
