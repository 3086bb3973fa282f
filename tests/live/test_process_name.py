"""Each process of a session has a name of its own where processes are listed."""

import subprocess
import sys

import pytest

from hhsim.live.session.supervisor import MODULES

NAMES = """
import contextlib, importlib, io, sys
from pathlib import Path
for module in sys.argv[1:]:
    with contextlib.suppress(SystemExit), contextlib.redirect_stdout(io.StringIO()):
        importlib.import_module(module).main(["--help"])
    print(Path("/proc/self/comm").read_text().strip())
"""


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux names processes so")
def test_the_processes_of_a_session_are_told_apart() -> None:
    answer = subprocess.run([sys.executable, "-P", "-c", NAMES, *MODULES.values()], capture_output=True, text=True)
    assert answer.stdout.split() == [f"hhsim-{name}" for name in MODULES], answer.stderr
