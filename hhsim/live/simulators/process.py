"""A fake glove's program as another process: started, given orders, killed."""

import contextlib
import subprocess
import sys
from pathlib import Path
from types import TracebackType
from typing import Self

from hhsim.live.simulators.peer import PeerRecord, read_peer_log


class FakeProcess:
    """`python -m MODULE --log FILE …` while the block runs; a context. It may be started again after `kill`.

    The program prints a line when it can be reached, "WORD WHERE", obeys a line of its standard input with "ok", and
    ends with that input.

    Args:
        module: Such as `hhsim.live.simulators.udp_sender`.
        log: Its log; a process that is started again goes on with it.
        arguments: More of the command line.
        ready: The word.

    Attributes:
        where: What it says of where it can be reached: a port, or the path of a serial line.
    """

    where: str

    def __init__(self, module: str, log: Path, *arguments: object, ready: str = "ready") -> None:
        """Nothing runs yet."""
        self.module, self.log = module, log
        self._arguments, self._ready = tuple(map(str, arguments)), ready
        self._process: subprocess.Popen[str] | None = None

    def start(self) -> None:
        """Start the process, and wait until it can be reached.

        Raises:
            RuntimeError: It ended instead.
        """
        self._process = subprocess.Popen(
            [sys.executable, "-m", self.module, "--log", str(self.log), *self._arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        word, _, self.where = self._answer().partition(" ")
        if word != self._ready:
            raise RuntimeError(f"{self.module} did not start")

    @property
    def pid(self) -> int:
        """Its number, while it runs."""
        assert self._process is not None
        return self._process.pid

    def order(self, text: str) -> None:
        """Give an order, and wait until it is obeyed.

        Raises:
            RuntimeError: There is no such order, or the process ended.
        """
        assert self._process is not None and self._process.stdin is not None
        self._process.stdin.write(text + "\n")
        self._process.stdin.flush()
        if self._answer() != "ok":
            raise RuntimeError(f"{self.module} did not obey '{text}'")

    def kill(self) -> None:
        """Kill the process (SIGKILL), as a crash would."""
        assert self._process is not None
        self._process.kill()
        self.end()

    def end(self) -> None:
        """End the process in good order, if it runs."""
        if self._process is not None:
            assert self._process.stdin is not None and self._process.stdout is not None
            with contextlib.suppress(OSError):
                self._process.stdin.close()
            self._process.wait()
            self._process.stdout.close()
            self._process = None

    def _answer(self) -> str:
        assert self._process is not None and self._process.stdout is not None
        return self._process.stdout.readline().strip()

    def __enter__(self) -> Self:
        """Start."""
        self.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        """End."""
        self.end()


class FakePeerProcess(FakeProcess):
    """A program whose log is that of `hhsim.live.simulators.peer`."""

    def record(self) -> PeerRecord:
        """What it wrote down so far."""
        return read_peer_log(self.log)
