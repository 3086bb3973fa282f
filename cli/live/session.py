"""A live session in the terminal: its status, its keys, and its end."""

import time
from collections.abc import Sequence
from typing import TYPE_CHECKING

from .status_line import LiveStatus
from .terminal_keys import terminal_keys

if TYPE_CHECKING:
    from hhsim.live.ipc.config import LiveSetup
    from hhsim.live.session.supervisor import SessionOutcome

POLL = 0.02
"""Period at which the session is polled [s]."""


def run_session(setups: "Sequence[LiveSetup]", heading: str, *, quiet: bool) -> "tuple[list[SessionOutcome], str]":
    """Run a session to its end; return the outcome of each hand, and the error in a line, or "".

    `heading` is the title of the display, which is warnings and faults alone where `quiet` is set.
    """
    from hhsim.errors import HhsimError
    from hhsim.live.pose.keyboard import HELP, PalmKeys, write_keyboard_pose
    from hhsim.live.session.supervisor import Supervisor, stop_signals
    from hhsim.live.session.two_gloves import TwoGloves

    setup = setups[0]
    by_keys = setup.pose.kind == "keyboard"
    palm = PalmKeys(setup.pose.position, setup.pose.orientation)
    status = LiveStatus(heading, HELP if by_keys else (HELP[-1],), quiet=quiet)
    with (
        stop_signals() as stop_signal,
        terminal_keys() as read_keys,
        status.shown(),
        Supervisor(setup, status.say) if len(setups) == 1 else TwoGloves(setups, status.say) as session,
    ):
        hands = session.hands if isinstance(session, TwoGloves) else (session,)
        before = time.monotonic()
        stopping = False
        where = str(setup.record or "")
        while session.poll():
            time.sleep(POLL)
            now = time.monotonic()
            keys = read_keys() if read_keys is not None else ""
            reason = stop_signal() or ("the terminal is gone" if keys is None else "")
            reason = reason or ("a key" if palm.press(keys or "") else "")
            if reason and not stopping:
                stopping = True
                session.request_stop(reason)
            if by_keys and palm.advance(now - before):
                write_keyboard_pose(hands[0].memory.status_block, palm.position, palm.orientation)
            before = now
            status.update([(hand.memory.status, hand.tally) for hand in hands], where, palm if by_keys else None)
        ended = session.end()
        outcomes = list(ended) if isinstance(ended, tuple) else [ended]
    try:
        session.check()
    except HhsimError as error:
        return outcomes, str(error)
    return outcomes, ""
