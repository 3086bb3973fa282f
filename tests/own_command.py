"""A command `hhsim` for scripts that tests run: this hhsim, whatever is on the PATH; and lines given to a shell."""

import contextlib
import fcntl
import os
import pty
import re
import select
import shlex
import subprocess
import sys
import termios
from pathlib import Path
from typing import Any

HHSIM = (sys.executable, "-P", "-c", "from hhsim.cli.main import main; main()")
"""Words that begin the command as a process of its own; the current folder is not where its modules come from (-P)."""
PATIENCE = 120.0
"""Longest wait of a test for something that a program shows at once on a quiet machine [s]."""


def hhsim_command(folder: Path) -> Path:
    """Write the command into a folder."""
    path = folder / "hhsim"
    path.write_text(f'#!/bin/sh\nexec {shlex.join(HHSIM)} "$@"\n')
    path.chmod(0o755)
    return path


def paste(commands: list[str], folder: Path, environment: dict[str, str]) -> None:
    """Give the lines to one shell, so that an activated environment stays; all have to end well."""
    script = "".join(f"echo 'PASTED {number}'\n{line}\necho \"ENDED $?\"\n" for number, line in enumerate(commands))
    answer = subprocess.run(
        ["bash", "-c", script],
        cwd=folder,
        env={**os.environ, **environment, "NO_COLOR": "1"},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    printed = answer.stdout.split("PASTED ")[1:]
    assert len(printed) == len(commands)
    for line, told in zip(commands, printed):
        assert told.endswith("ENDED 0\n") or only_late(line, told), f"{line}\n{told[-4000:]}"


def only_late(line: str, told: str) -> bool:
    """Whether a bench or the doctor ended with 1 for times alone, which say nothing on a machine that others use."""
    if line.startswith("hhsim doctor"):
        return told.endswith("ENDED 1\n") and "this machine does not keep" in told
    missed = [text for text in told.splitlines() if text.startswith("missed: ")]
    late = all(re.search(r"^missed: .*tick.*µs, bar .*µs$", text) for text in missed)
    return line.startswith("hhsim bench ") and told.endswith("ENDED 1\n") and bool(missed) and late


class Terminal:
    """A program whose terminal we hold the other end of.

    Args:
        command: Its words.
        options: Of the process.
    """

    def __init__(self, *command: str, **options: Any) -> None:
        self.end, self.line = pty.openpty()
        self.before = termios.tcgetattr(self.line)
        streams = dict.fromkeys(("stdin", "stdout", "stderr"), self.line)
        self.process = subprocess.Popen(
            command,
            start_new_session=True,
            preexec_fn=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0),
            **streams,
            **options,
        )
        self.shown = ""

    def until(self, text: str) -> str:
        """Wait until something is shown; all that was shown so far, without what moves the cursor and colours."""
        while text not in self.shown:
            assert select.select([self.end], [], [], PATIENCE)[0], f"no '{text}' in {self.shown!r}"
            shown = os.read(self.end, 65_536).decode("utf-8", "replace")
            self.shown += re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", shown)
        return self.shown

    def type(self, keys: bytes) -> None:
        """Strike keys."""
        os.write(self.end, keys)

    def close(self) -> None:
        """End the program and close both ends."""
        self.process.kill()
        self.process.wait()
        for descriptor in (self.end, self.line):
            with contextlib.suppress(OSError):
                os.close(descriptor)
