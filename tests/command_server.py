"""Commands of hhsim, run one after the other in a child process that is ended where one does not end by itself."""

import contextlib
import gc
import io
import json
import os
import resource
import select
import subprocess
import sys
import traceback
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple, Self

CRASHED = 70
"""Exit code of a command that raised something, whose traceback is then its `err`."""
COLLECTED_EVERY = 8
"""Commands from one collection of garbage to the next: it takes as long as half of a command."""


class Served(NamedTuple):
    """What a command gave back; `code` None where it did not end in time, negative where it took the process down."""

    code: int | None
    out: str
    err: str
    seconds: float = 0.0
    """Of the processor's time, with that of its children."""


class CommandServer:
    """Runs commands in a folder; what they import and compile is there for the next one.

    Args:
        folder: That they run in.
        seconds: That each of them may take.
    """

    def __init__(self, folder: Path, seconds: float) -> None:
        self.folder, self._seconds = folder, seconds
        self._process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._end()

    def run(self, *arguments: str) -> Served:
        """Run `hhsim` with these arguments."""
        if self._process is None:
            self._process = subprocess.Popen(
                [sys.executable, __file__], stdin=subprocess.PIPE, stdout=subprocess.PIPE, cwd=self.folder
            )
        server = self._process
        server.stdin.write(json.dumps(arguments).encode() + b"\n")
        server.stdin.flush()
        if not select.select([server.stdout], [], [], self._seconds)[0]:
            self._end()
            return Served(None, "", f"not done after {self._seconds} s")
        answer = server.stdout.readline()
        if not answer:
            code = server.wait()
            self._end()
            return Served(code, "", f"the process ended with {code}")
        return Served(**json.loads(answer))

    def _end(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.communicate()
            self._process = None


def _serve() -> None:
    import importlib

    main = importlib.import_module("hhsim.cli.main").main

    # Whatever the commands print, the answers alone go to the pipe.
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    for number, line in enumerate(sys.stdin, start=1):
        out, err = _Text(), _Text()
        sys.argv = ["hhsim", *json.loads(line)]
        before = _seconds()
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            try:
                main()
                code: Any = 0
            except SystemExit as exit_:
                code = exit_.code
            except BaseException:
                code = CRASHED
                err.write(traceback.format_exc())
        # A command leaves what it has to the end of its process, which here does not come: 100 MB a report.
        if number % COLLECTED_EVERY == 0:
            gc.unfreeze()
            gc.collect()
        answer = {"code": code, "out": out.getvalue(), "err": err.getvalue(), "seconds": _seconds() - before}
        answers.write(json.dumps(answer) + "\n")
        answers.flush()


def _seconds() -> float:
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in used)


class _Text(io.StringIO):
    """A stream that the command line can prepare as it does those of a terminal."""

    def reconfigure(self, **options: Any) -> None:
        """Text has no encoding to change."""

    def fileno(self) -> int:
        """Where a C library would write."""
        return 1


if __name__ == "__main__":
    _serve()
