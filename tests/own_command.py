"""A command `hhsim` for scripts that tests run: this hhsim, whatever is on the PATH; and lines given to a shell."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

HHSIM = (sys.executable, "-P", "-c", "from hhsim.cli.main import main; main()")
"""Words that begin the command as a process of its own; the current folder is not where its modules come from (-P)."""


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
