"""A command `hhsim` for scripts that tests run: this hhsim, whatever is on the PATH."""

import shlex
import sys
from pathlib import Path


def hhsim_command(folder: Path) -> Path:
    """Write the command into a folder; the current folder is not where its modules come from (-P)."""
    path = folder / "hhsim"
    code = "from hhsim.cli.main import main; main()"
    path.write_text(f'#!/bin/sh\nexec {shlex.quote(sys.executable)} -P -c {shlex.quote(code)} "$@"\n')
    path.chmod(0o755)
    return path
