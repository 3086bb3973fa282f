"""A live session in the terminal: its status, its keys, and its end.

The status is a panel in a terminal, a plain line now and then elsewhere.
"""

import math
import os
import re
import select
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

from hhsim.system.counted import counted
from hhsim.table.table import Table

from ..arguments.options import HANDS

if TYPE_CHECKING:
    from hhsim.live.drivers.poses import PalmKeys
    from hhsim.live.session.setup import LiveSetup
    from hhsim.live.session.statistics import LiveTally
    from hhsim.live.session.supervisor import SessionOutcome

PANEL_SECONDS = 0.25
LINE_SECONDS = 5.0
NONE = "—"
POLL = 0.02
"""Period at which the session is polled [s]."""


class LiveStatus:
    """Display of a running session; `keys` are names and effects of keys, `quiet` shows warnings and faults only."""

    def __init__(self, heading: str, keys: Sequence[tuple[str, str]] = (), *, quiet: bool = False) -> None:
        self.heading = heading
        self.keys = keys
        self.quiet = quiet
        self.panel = not quiet and sys.stderr.isatty()
        self._live: Any = None
        self._began = time.monotonic()
        self._shown = -math.inf

    @contextmanager
    def shown(self) -> Iterator[None]:
        """Show the panel while the block runs."""
        if not self.panel:
            self._shown = time.monotonic()
            yield
            return
        from rich.console import Console
        from rich.live import Live

        with Live(
            console=Console(stderr=True, highlight=False, markup=False), auto_refresh=False, transient=True
        ) as live:
            self._live = live
            try:
                yield
            finally:
                self._live = None

    def say(self, text: str, level: int = 0) -> None:
        """Print a line of the log: level 0 for information, 1 a warning, 2 a fault."""
        if self.quiet and level == 0:
            return
        line = f"hhsim: {('', 'warning: ', 'fault: ')[min(level, 2)]}{text}"
        if self._live is not None:
            from rich.text import Text

            self._live.console.print(Text(line, style=("", "yellow", "bold red")[min(level, 2)]), soft_wrap=True)
        else:
            print(line, file=sys.stderr, flush=True)

    def update(self, hands: "Sequence[tuple[Any, LiveTally]]", recording: str, palm: "PalmKeys | None" = None) -> None:
        """Update the display if its interval has passed, by each hand's record of `LIVE_STATUS` and figures.

        `recording` is a path, or "" for none; `palm` is one that keys move.
        """
        now = time.monotonic()
        if self.quiet or now - self._shown < (PANEL_SECONDS if self.panel else LINE_SECONDS):
            return
        self._shown = now
        rows = []
        for side, (status, tally) in zip(HANDS if len(hands) > 1 else ("",), hands):
            shown = status_rows(status, tally, recording, time.monotonic_ns())
            rows += [(f"{side} {name}".strip(), value) for name, value in shown]
        if self._live is None:
            text = "; ".join(f"{name}: {value}" for name, value in rows)
            print(f"hhsim: {now - self._began:,.0f} s: {text}", file=sys.stderr, flush=True)
            return
        if palm is not None:
            x, y, z = 1e3 * palm.position
            rows.append(("palm", f"{x:.1f}, {y:.1f}, {z:.1f} mm; a stroke is {1e3 * palm.step:g} mm"))
        rows.append(("keys", " · ".join(f"{keys} {what}" for keys, what in self.keys)))
        from hhsim.table.terminal import terminal_text

        minutes, seconds = divmod(now - self._began, 60.0)
        table = Table.of_cells(("", ""), rows, f"{self.heading}   {minutes:.0f}:{seconds:04.1f}")
        self._live.update(terminal_text(table, in_terminal=True), refresh=True)


def status_rows(status: Any, tally: "LiveTally", recording: str, now_ns: int) -> list[tuple[str, str]]:
    """Return names and texts of the display; arguments as of `LiveStatus.update`, and CLOCK_MONOTONIC [ns]."""
    from hhsim.hand.fingers import FINGERS
    from hhsim.result.safety import why_free

    if status["ticks"] == 0:
        return [("starting", "making the loop ready, and reaching for the glove")]
    forces = "  ".join(f"{name} {value:.2f}" for name, value in zip(FINGERS, status["force"], strict=True))
    stiff = [f"{name} {k:.2f}" for name, k in zip(FINGERS, status["command_stiffness"], strict=True) if k > 0.0]
    free = why_free(int(status["safety"]))
    battery = int(status["battery"])
    # The loop runs meanwhile: a sample may be newer than the reading of the clock.
    age = 1e-6 * max(0, now_ns - int(status["sample_ns"]))
    sample = f"last sample {f'{age:,.0f} ms' if age < 1e4 else f'{1e-3 * age:,.0f} s'} ago"
    sample = sample if status["sample_ns"] > 0 else "no sample yet"
    done, missed = int(status["ticks"]), int(status["missed"])
    rows = [
        ("rate", f"{tally.rate:,.0f} Hz, {missed:,} of {done + missed:,} ticks missed"),
        ("wake-up", _two(tally.wakeup)),
        ("latency", _two(tally.latency)),
        ("contacts", f"{int(status['contacts']):,}"),
        ("force [N]", forces),
        ("fingers", f"free: {free}" if free else f"resisting: {', '.join(stiff)}" if stiff else "nothing to resist"),
        ("glove", f"battery {f'{battery} %' if battery >= 0 else NONE}, {sample}"),
    ]
    if recording:
        lost = int(status["recorder_lost"])
        state = ", FAILED" if status["recorder_failed"] else f", {lost:,} lost" if lost else ""
        rows.append(("recording", f"{recording}, {counted(int(status['recorder_ticks']), 'tick')}{state}"))
    return rows


def _two(values: Any) -> str:
    if values.count == 0:
        return NONE
    return f"p50 {1e-3 * values.percentile(50):,.0f} µs, p99 {1e-3 * values.percentile(99):,.0f} µs"


@contextmanager
def terminal_keys() -> Iterator[Callable[[], str | None] | None]:
    """Read each key of stdin at once, without echo; yields None if stdin is not our terminal.

    What it yields returns the keys pressed since the last call, "" for none; None if the terminal is gone. Ctrl-C,
    Ctrl-Z and Ctrl-backslash stay signals. The settings are restored when the block is left, by whatever error or exit.
    """
    before = None
    with suppress(ImportError, OSError, ValueError):
        import termios
        import tty

        descriptor = sys.stdin.fileno()
        if os.isatty(descriptor) and os.tcgetpgrp(descriptor) == os.getpgrp():
            with suppress(termios.error):
                before = termios.tcgetattr(descriptor)
    if before is None:
        yield None
        return
    try:
        tty.setcbreak(descriptor, termios.TCSANOW)
        yield lambda: _keys(descriptor)
    finally:
        # A terminal that is gone cannot be restored.
        with suppress(termios.error, OSError):
            termios.tcsetattr(descriptor, termios.TCSADRAIN, before)


def _keys(descriptor: int) -> str | None:
    found = b""
    try:
        while select.select([descriptor], [], [], 0.0)[0]:
            found += (more := os.read(descriptor, 256))
            if not more:
                return None
    except OSError:
        return None
    # Without the sequences of arrow and function keys, which begin with Escape.
    return re.sub(r"\x1b[\[O][^@-~]*[@-~]?", "", found.decode("utf-8", "replace"))


def run_session(setup: "LiveSetup", heading: str, *, quiet: bool) -> "SessionOutcome":
    """Run a session to its end; its display has the title `heading`, and is warnings and faults alone if `quiet`."""
    from hhsim.live.drivers.poses import HELP, PalmKeys, write_keyboard_pose
    from hhsim.live.processes import stop_signals
    from hhsim.live.session.supervisor import Supervisor

    pose = setup.worn[0].pose
    by_keys, palm = pose.kind == "keyboard", PalmKeys(pose.position, pose.orientation)
    status = LiveStatus(heading, HELP if by_keys else (HELP[-1],), quiet=quiet)
    with (
        stop_signals() as stop_signal,
        terminal_keys() as read_keys,
        status.shown(),
        Supervisor(setup, status.say) as session,
    ):
        memory = session.memory
        before, stopping, where = time.monotonic(), False, str(setup.record or "")
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
                write_keyboard_pose(memory.status, palm.position, palm.orientation)
            before = now
            hands = [(hand.status, tally) for hand, tally in zip(memory.hands, session.tallies)]
            status.update(hands, where, palm if by_keys else None)
        return session.end()
