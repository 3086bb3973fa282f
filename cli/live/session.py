"""A live session in the terminal: its status, its keys, and its end."""

import time
from typing import TYPE_CHECKING

from .status_line import LiveStatus
from .terminal_keys import terminal_keys

if TYPE_CHECKING:
    from hhsim.live.ipc.config import LiveSetup
    from hhsim.live.session.supervisor import SessionOutcome

POLL = 0.02
"""Period at which the session is polled [s]."""


def run_session(setup: "LiveSetup", heading: str, *, quiet: bool) -> "tuple[SessionOutcome, str]":
    """Run a session to its end; return its outcome, and the error in a line, or "".

    `heading` is the title of the display, which is warnings and faults alone where `quiet` is set.
    """
    from hhsim.errors import HhsimError
    from hhsim.live.pose.keyboard import HELP, PalmKeys, write_keyboard_pose
    from hhsim.live.session.stop_signals import stop_signals
    from hhsim.live.session.supervisor import Supervisor

    by_keys = setup.pose.kind == "keyboard"
    palm = PalmKeys(setup.pose.position, setup.pose.orientation)
    status = LiveStatus(heading, HELP if by_keys else (HELP[-1],), quiet=quiet)
    with (
        stop_signals() as stop_signal,
        terminal_keys() as read_keys,
        status.shown(),
        Supervisor(setup, status.say) as session,
    ):
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
                write_keyboard_pose(session.memory.status_block, palm.position, palm.orientation)
            before = now
            status.update(session.memory.status, session.tally, where, palm if by_keys else None)
        outcome = session.end()
    try:
        session.check()
    except HhsimError as error:
        return outcome, str(error)
    return outcome, ""
