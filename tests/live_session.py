"""A short live session that nothing goes wrong in, recorded without a glove."""

from pathlib import Path

from live_scripted import FIST, FREE, Moment, ScriptedSession

from hhsim.live.session.setup import OutputLimits


def write_session(path: Path) -> None:
    """A glove that closes on a ball and holds it; nothing goes wrong."""
    script = [*(Moment(FREE + (FIST - FREE) * i / 80) for i in range(80)), *[Moment(FIST)] * 120]
    ScriptedSession(script, record=path, output=OutputLimits(ramp=0.02)).run().recorded()
