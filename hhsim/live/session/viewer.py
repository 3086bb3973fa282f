"""Process that shows a session in the rerun viewer: `python -m hhsim.live.session.viewer --setup FD`.

It runs below ordinary priority, only reads the rings, and sends about thirty frames a second: the newest tick, with
plots that show the worst of the ticks since the frame before. It does not affect the loop: it ends when the viewer is
closed, drops frames while the viewer takes nothing, and ends after `LONGEST_STALL` of that. A window that it opened
stays open after the session.

Exit codes: 0 the session has ended or the viewer was closed (the last line on stderr says which); 1 a fault of hhsim's
own; 2 there is no viewer, or its file cannot be written.
"""

import os
import signal
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from types import FrameType
from typing import TYPE_CHECKING, Any

import numpy as np

from hhsim.errors import OutputError
from hhsim.hand.fingers import FINGERS
from hhsim.live.processes import RingReader, Stage, exit_code, process_setup
from hhsim.live.real_time import keep_off
from hhsim.live.session.memory import SessionMemory, TickReader
from hhsim.live.session.recorder import SessionRows
from hhsim.live.session.setup import LiveSetup
from hhsim.result.safety import why_free_or_held
from hhsim.result.schema import HANDS, TICK
from hhsim.view.plots import GLOVE, LIVE_PLOTS, LOOP, blueprint, loop_values, shown_ticks
from hhsim.view.scene_log import APPLICATION, EVENT_LEVELS, RerunScene, ShownScene, status_words
from hhsim.view.sink import parse_target, rerun_stream

if TYPE_CHECKING:
    import rerun as rr


FRAME = 1.0 / 30.0
"""Time between two frames [s]."""
PATIENCE = 0.25
"""Longest time to take a frame [s]."""
LONGEST_STALL = 10.0
"""Longest time in which a viewer may take nothing [s]."""
NICENESS = 10
HAND_MARGIN = 0.16
"""Margin for the hand around the object in the picture [m]."""


class ViewerGoneError(Exception):
    """Error of a viewer that was closed or takes no more data."""


class LiveViewer:
    """Shows one session and writes `viewer_ns` of its status; `stop` is a signal handler."""

    def __init__(self, setup: LiveSetup, memory: SessionMemory) -> None:
        assert setup.rerun is not None
        self._target = parse_target(setup.rerun)
        self._setup = setup
        self._memory = memory
        self._ticks = TickReader(memory)
        self._events = RingReader(memory.events)
        self._rows = SessionRows(setup, setup.options, hands=1)
        self._parent = os.getppid()
        self._stop = False
        self._begin_ns = -1
        self._lanes: dict[str, str] = {}
        self._stalled = -1.0

    def stop(self, number: int, frame: FrameType | None) -> None:
        """Request `run` to end."""
        self._stop = True

    def run(self) -> None:
        """Show the session until it has ended; ViewerGoneError if it was closed, others as `rerun_stream`."""
        setup = self._setup
        scene = ShownScene(
            mesh=setup.seen.mesh,
            tree=setup.seen.tree,
            hand=setup.worn[0].model,
            fingers=np.array([finger in setup.options.fingers for finger in FINGERS]),
            touch=setup.options.touch,
            surface=setup.options.surface,
            parts=self._rows.parts,
            text=f"# Live session\n\n`{' '.join(setup.command)}`\n",
        )
        extent = float(np.linalg.norm(setup.seen.mesh.extent + HAND_MARGIN))
        middle = setup.seen.mesh.bounds.mean(axis=0)
        arrangement = blueprint(middle, extent, "graphic hand, haptic hand (blue), forces (red)", LIVE_PLOTS, live=True)
        with rerun_stream(self._target, APPLICATION, arrangement) as stream:
            stream.send_recording_name(f"live {time.strftime('%Y-%m-%d %H:%M:%S')}")
            viewer = RerunScene(stream, scene)
            viewer.log_static(LIVE_PLOTS)
            due = time.monotonic()
            while True:
                # Read before the rings: all ticks before the end are shown after it.
                # The supervisor of a loop that was killed sets the stage; without a supervisor the loop ends by itself.
                ended = self._memory.status["stage"] == Stage.ENDED or os.getppid() != self._parent
                over = self._stop or ended
                if self._taken(stream):
                    self._show(viewer)
                self._memory.status["viewer_ns"] = time.monotonic_ns()
                if over:
                    return
                due = max(due + FRAME, time.monotonic())
                time.sleep(max(0.0, due - time.monotonic()))

    def _taken(self, stream: "rr.RecordingStream") -> bool:
        """Return True if the viewer has taken all frames; raises ViewerGoneError if it is closed or stalls too long."""
        try:
            stream.flush(timeout_sec=PATIENCE)
        except (RuntimeError, ValueError) as error:
            if self._target.kind == "file":
                raise OutputError(f"cannot write {self._target.path}: {error}; is the disk full?") from error
            if "timed out" not in str(error):
                raise ViewerGoneError("the viewer was closed") from error
            now = time.monotonic()
            self._stalled = now if self._stalled < 0.0 else self._stalled
            if now - self._stalled > LONGEST_STALL:
                raise ViewerGoneError(f"the viewer has taken nothing for {LONGEST_STALL:g} s") from error
            return False
        self._stalled = -1.0
        return True

    def _show(self, viewer: RerunScene) -> None:
        _, events = self._events.read(self._memory.events.capacity)
        first, (records, *_) = self._ticks.read_hands(self._memory.ticks.capacity)
        if len(records) > 0:
            if self._begin_ns < 0:
                self._begin_ns = int(records["time_ns"][0])
            # The newest tick, with plots of all of them.
            tables = self._rows.block(first, first, [records], self._begin_ns)
            block = tables[TICK] | tables[f"{HANDS}/{self._setup.worn[0].model.side}/{TICK}"]
            loop = loop_values(records["wakeup_ns"], records["latency_ns"])
            more, last = {GLOVE: records["command_stiffness"], LOOP: loop}, [len(records) - 1]
            moved = self._rows.moved(records)
            viewer.log_ticks(shown_ticks(block.__getitem__, records["tick"], last, [0], more, moved))
            newest = records[-1]
            tick, seconds = int(newest["tick"]), self._seconds(newest["time_ns"])
            # Over all ticks since the frame before: shorter events show too.
            safety, status = (int(np.bitwise_or.reduce(records[name])) for name in ("safety", "status"))
            self._lane(viewer, "fingers", tick, seconds, why_free_or_held(safety))
            self._lane(viewer, "ticks", tick, seconds, status_words(status))
        if self._begin_ns >= 0:
            for event in events:
                text = bytes(event["text"]).decode("utf-8", "replace")
                viewer.log_event(self._seconds(event["time_ns"]), EVENT_LEVELS[int(event["level"])], text)

    def _lane(self, viewer: RerunScene, lane: str, tick: int, seconds: float, state: str) -> None:
        if self._lanes.get(lane) != state:
            self._lanes[lane] = state
            viewer.log_states(lane, [tick], [seconds], [state])

    def _seconds(self, time_ns: Any) -> float:
        return 1e-9 * (int(time_ns) - self._begin_ns)


def main(arguments: Sequence[str] | None = None) -> int:
    """Show a session; returns the exit code."""
    setup, memory = process_setup("viewer", arguments)
    with suppress(OSError):
        os.nice(NICENESS)
    keep_off(setup.real_time.loop_cpu)
    return exit_code(lambda: show(setup, memory))


def show(setup: LiveSetup, memory: SessionMemory) -> None:
    """Show a session in this process; ends it at once if the viewer is gone."""
    viewer = LiveViewer(setup, memory)
    # Ctrl-C is for the session: its end is shown too.
    for number in (signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, viewer.stop)
    try:
        viewer.run()
    except ViewerGoneError as gone:
        print(f"hhsim: {gone}", file=sys.stderr, flush=True)
        # The interpreter's own exit waits until a stalled viewer takes what is left.
        os._exit(0)


if __name__ == "__main__":
    sys.exit(main())
