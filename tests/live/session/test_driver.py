"""The driver between a glove and the records of a session."""

from typing import Any

from live_scripted import FIST, FakeClock, Moment, ScriptedGlove

from hhsim.live.drivers.poses import FixedPose
from hhsim.live.gloves import PoseConfig
from hhsim.live.session.driver import GloveDriver
from hhsim.live.session.memory import SessionMemory

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
    driver.give()
    driver.give()
    assert [(sent.stiffness.max(), sent.force.min()) for sent in glove.commands] == [(0.2, 2.0)]


def test_a_command_that_is_being_written_waits() -> None:
    driver, glove, clock, status = opened()
    command(status, 0.3, clock.now())
    status["command_version"][0] += 1
    driver.give()
    assert glove.commands == []
    status["command_version"][0] += 1
    driver.give()
    assert len(glove.commands) == 1


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
