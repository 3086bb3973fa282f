"""A short live session that nothing goes wrong in, recorded without a glove."""

import os
from pathlib import Path

from live_rings import ended
from live_scripted import FIST, FREE, FakeAccounts, FakeClock, InStep, Moment, ScriptedGlove, make_setup

from hhsim.live.session.memory import SessionMemory
from hhsim.live.session.recorder import Recorder
from hhsim.live.session.settings import OutputLimits, SafetyLimits


def write_session(path: Path) -> None:
    """A glove that closes on a ball and holds it; nothing goes wrong."""
    script = [*(Moment(FREE + (FIST - FREE) * i / 80) for i in range(80)), *[Moment(FIST)] * 120]
    setup = make_setup(
        record=path,
        output=OutputLimits(ramp=0.02),
        safety=SafetyLimits(watchdog=False),
        duration=1e-3 * (len(script) + 1),
    )
    memory, clock = SessionMemory.create(), FakeClock()
    InStep(setup, memory, ScriptedGlove(clock, script, {}), clock, accounts=FakeAccounts()).run()
    ended(memory, os.getpid())
    Recorder(setup, memory).run()
