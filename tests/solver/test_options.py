"""Options are told of by every command and process: to import them brings in no solver."""

import subprocess
import sys

MOST_MODULES = 15
"""Of hhsim that a process loads to name a method or a stiffness."""


def test_importing_the_options_loads_few_modules() -> None:
    script = "import sys, hhsim.solver.options; print(*(name for name in sys.modules if name.split('.')[0] == 'hhsim'))"
    loaded = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout.split()
    assert "hhsim.solver.options" in loaded
    assert len(loaded) <= MOST_MODULES, sorted(loaded)
