"""Viewer process that gets ready while the replay is at work.

Importing the viewer takes longer than showing thousands of ticks, so a second process does it while this one loads its
kernels. `settle` waits until that process is idle, so that it disturbs no timed tick.
"""

import signal
import sys
import warnings
from contextlib import suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any, Literal, Self

from hhsim.errors import HhsimError, InputError, OutputError
from hhsim.result.reader import load_result
from hhsim.solver.hand_solver import start_numba
from hhsim.system.progress import Progress, silent
from hhsim.view.sink import RerunTarget

if TYPE_CHECKING:
    from hhsim.view.viewer import Viewed

Word = Literal["ready", "progress", "viewed", "refused"]

LAST_WORD_SECONDS = 10.0
"""Time that the viewer process has to end and to remove a half-written file."""


def can_fork() -> bool:
    """Return whether the viewer process can be a fork, which spares it imports but loses threads such as rerun's."""
    return sys.platform == "linux" and "rerun" not in sys.modules


class ViewAhead:
    """Shows one result that does not exist yet; use it in a `with`, before any thread is started.

    Where no process can be forked, `show` does all of it.
    """

    def __init__(self, target: RerunTarget) -> None:
        """Start to get ready."""
        self._target = target
        self._ready = False
        self._channel: Any = None
        if can_fork():
            # Before the fork, so that it is done once.
            start_numba()
            fork: Any = get_context("fork")
            self._channel, theirs = fork.Pipe()
            self._process = fork.Process(target=_serve, args=(theirs, self._channel, target), daemon=True)
            with warnings.catch_warnings():
                # Python warns of threads: numpy's are idle here, and survive a fork.
                warnings.simplefilter("ignore", DeprecationWarning)
                self._process.start()
            # The end of the process shows here only where nobody else holds its end of the pipe.
            theirs.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """End the viewer process; its half-written file goes."""
        if self._channel is None:
            return
        self._channel.close()
        if kind is not None:
            self._process.terminate()
        self._process.join(LAST_WORD_SECONDS)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()

    def settle(self) -> None:
        """Wait until the viewer process is idle until `show`; raise HhsimError if it cannot get ready."""
        if self._channel is not None and not self._ready:
            self._answer("ready", silent)
            self._ready = True

    def show(self, path: Path, progress: Progress = silent) -> "Viewed":
        """Show a result; errors as `load_result` and `view_result`, HhsimError if the viewer process ended."""
        if self._channel is None:
            from hhsim.view.viewer import view_result

            return view_result(load_result(path), self._target, progress=progress)
        self.settle()
        # Where it has died, the answer says so.
        with suppress(OSError):
            self._channel.send(path)
        viewed: Viewed = self._answer("viewed", progress)
        return viewed

    def _answer(self, wanted: Word, progress: Progress) -> Any:
        assert self._channel is not None
        while True:
            try:
                word, value = self._channel.recv()
            except (EOFError, OSError):
                self._process.join(LAST_WORD_SECONDS)
                how = f"ended with code {self._process.exitcode}"
                raise HhsimError(f"nothing went to {self._target}: the process that shows it {how}") from None
            if word == wanted:
                return value
            if word == "refused":
                kind, text = value
                raise kind(text)
            progress(*value)


def _serve(channel: "Connection[Any, Any]", parents: "Connection[Any, Any]", target: RerunTarget) -> None:
    """Get ready, wait for a result, and show it: the viewer process."""
    parents.close()
    # Ctrl-C is for the replay, which then ends this process too.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _leave)

    def progress(what: str, done: int, total: int) -> None:
        channel.send(("progress", (what, done, total)))

    try:
        # Imported here, where it costs the replay no time.
        from hhsim.view.viewer import get_ready, view_result

        get_ready()
        channel.send(("ready", None))
        path = channel.recv()
        channel.send(("viewed", view_result(load_result(path), target, progress=progress)))
    except HhsimError as error:
        # By its plain kind: an error that is made from more than its text cannot be sent.
        kind = OutputError if isinstance(error, OutputError) else InputError
        channel.send(("refused", (kind, str(error))))
    except (EOFError, OSError):
        # The replay came to no end: there is nothing to show.
        return


def _leave(number: int, frame: FrameType | None) -> None:
    # Through every `finally`, so that no half-written file stays.
    raise SystemExit(1)
