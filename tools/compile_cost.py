"""Tell which kernels a command compiles, and the CPU seconds of each.

    python -m tools.compile_cost -- replay cube lift-both --hands both --free

runs `hhsim` with these words in this process, from an empty cache of kernels; with `--after WORDS` (as one text, any
number of times) other commands fill it first. A function's own seconds are those between numba's events of its
compilation, less those of what it compiles meanwhile; optimisation to machine code is in them.
"""

import argparse
import contextlib
import importlib
import io
import os
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from pathlib import Path
from typing import Any

from numba.core import event

SHOWN = 25
TELL = "--tell"
"""First word of the process that runs one command."""


class Costs(event.Listener):  # type: ignore[misc]
    """Listener of numba's compilations that keeps each function's own CPU seconds."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = defaultdict(float)
        self.times: dict[str, int] = defaultdict(int)
        self._running: list[list[float]] = []

    def on_start(self, event: Any) -> None:
        """Take the start of a compilation."""
        self._running.append([time.thread_time(), 0.0])

    def on_end(self, event: Any) -> None:
        """Take the end of a compilation."""
        began, inner = self._running.pop()
        took = time.thread_time() - began
        function = event.data["dispatcher"].py_func
        name = f"{function.__module__.removeprefix('hhsim.')}.{function.__qualname__}"
        self.seconds[name] += took - inner
        self.times[name] += 1
        if self._running:
            self._running[-1][1] += took


def cache_size() -> tuple[int, int]:
    """Return number and bytes of the files in the cache of kernels."""
    from hhsim.kernels.kernel_cache import KERNEL_CACHE

    files = [path for path in KERNEL_CACHE.rglob("*") if path.is_file()]
    return len(files), sum(path.stat().st_size for path in files)


def run(words: list[str]) -> Costs:
    """Run a command in this process; its own output is dropped, its errors are not."""
    costs = Costs()
    sys.argv = ["hhsim", *words]
    listening, silent = event.install_listener("numba:compile", costs), contextlib.redirect_stdout(io.StringIO())
    with listening, silent, contextlib.suppress(SystemExit):
        importlib.import_module("hhsim.cli.main").main()
    return costs


def tell(words: list[str]) -> None:
    """Run a command and print the table of what it compiled."""
    before, began = cache_size(), time.process_time()
    costs = run(words)
    spent, after = time.process_time() - began, cache_size()
    for name in sorted(costs.seconds, key=costs.seconds.__getitem__, reverse=True)[:SHOWN]:
        print(f"{costs.seconds[name]:8.2f} s {costs.times[name]:4d} × {name}")
    print(f"{sum(costs.seconds.values()):8.2f} s in {sum(costs.times.values())} compilations of {len(costs.times)}")
    print(f"{spent:8.2f} s CPU of the whole command")
    print(f"{(after[1] - before[1]) / 1e6:8.2f} MB in {after[0] - before[0]} files added to the cache")


def main() -> None:
    """Fill an empty cache by the commands of --after, each in a process of its own, and tell of the last one."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--after", action="append", default=[], metavar="WORDS", help="A command that runs before.")
    parser.add_argument("words", nargs="+", metavar="WORD", help="The command, behind --.")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, "HHSIM_CACHE_DIR": str(Path(folder) / "cache")}
        program = [sys.executable, "-m", "tools.compile_cost", TELL]
        for words in (*(before.split() for before in given.after), given.words):
            out = None if words is given.words else subprocess.DEVNULL
            subprocess.run([*program, *words], env=environment, stdout=out, check=True)


if __name__ == "__main__":
    if sys.argv[1:2] == [TELL]:
        tell(sys.argv[2:])
    else:
        main()
