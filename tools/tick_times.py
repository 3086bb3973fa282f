"""CPU times of ticks by several revisions of hhsim, in turns: medians and tails of many scenes, and their ratios.

    python -m tools.tick_times before=../before/.venv/bin/python after=.venv/bin/python --out times.json

Each revision is a Python that has it installed, and one process of it runs all scenes. A scene is run by each
revision in turn, `--runs` times; of each tick in contact the least CPU time counts, which no interruption makes
longer. The first revision is what the others are compared with.
"""

import argparse
import itertools
import json
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

WORKER = """
import json, os, sys
from hhsim.cli.main import main
answers = os.fdopen(os.dup(1), "w")
os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
for line in sys.stdin:
    sys.argv = ["hhsim", *json.loads(line)]
    try:
        code = main()
    except SystemExit as left:
        code = left.code
    print(json.dumps(code or 0), file=answers, flush=True)
"""
"""Program of a revision's process: runs a command a line, and answers with its exit code."""
OBJECTS = (
    *("sphere", "cylinder", "triangular-prism", "cube", "hexagonal-prism"),
    *("rock", "shamrock", "cup", "teapot", "bunny"),
)
MOTIONS = ("touch", "pinch", "grasp", "whole-hand", "slide")
METHODS = ("coupled", "progressive")
SURFACES: Mapping[str, Sequence[str]] = {
    "mesh": ("--surface", "mesh"),
    "level 4": ("--level", "4"),
    "level 5": ("--level", "5"),
}
TAIL = 3.0
"""A scene has a long tail if its p99 is more than this many times its p50."""
Times = NDArray[np.float64]


class Revision:
    """A revision of hhsim, in a process that runs one command after another."""

    def __init__(self, python: str) -> None:
        self._process = subprocess.Popen(
            [python, "-P", "-c", WORKER],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )

    def times(self, command: Sequence[str], path: Path) -> Times:
        """Run a replay; return the CPU time of each tick [µs], NaN out of contact."""
        assert self._process.stdin is not None and self._process.stdout is not None
        path.unlink(missing_ok=True)
        self._process.stdin.write(json.dumps([*command, "--quiet", "--out", str(path)]) + "\n")
        self._process.stdin.flush()
        answer = self._process.stdout.readline()
        if answer.strip() != "0":
            raise RuntimeError(f"{' '.join(command)}: exit code {answer.strip() or 'none'}")
        with h5py.File(path) as file:
            times = 1e-3 * np.asarray(file["tick/duration/total_cpu"], float)
            return np.where(np.asarray(file["tick/contacts/touching"]) > 0, times, np.nan)

    def close(self) -> None:
        """End the process."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait()


def figures(runs: Sequence[Times]) -> dict[str, float]:
    """Return p50 and p99 [µs] of the ticks in contact, of each the least time of the runs, and their number."""
    least = np.min(runs, axis=0)
    least = least[np.isfinite(least)]
    return {"p50": float(np.percentile(least, 50)), "p99": float(np.percentile(least, 99)), "ticks": float(len(least))}


def summary(rows: Sequence[Mapping[str, dict[str, float]]], names: Sequence[str]) -> list[str]:
    """Return lines about the scenes of one surface and method: medians, ratios to the first revision, long tails."""
    lines = []
    for name in names:
        p50, p99 = (np.array([row[name][key] for row in rows]) for key in ("p50", "p99"))
        first50, first99 = (np.array([row[names[0]][key] for row in rows]) for key in ("p50", "p99"))
        lines.append(
            f"  {name:12s} p50 {np.median(p50):6.2f}  p99 {np.median(p99):6.2f} µs   "
            f"ratios p50 {np.median(p50 / first50):.3f}  p99 {np.median(p99 / first99):.3f}   "
            f"p99/p50 {np.median(p99 / p50):.2f}, most {np.max(p99 / p50):.1f}, "
            f"above {TAIL:g}: {int(np.sum(p99 > TAIL * p50))} of {len(rows)}"
        )
    return lines


def main(words: Sequence[str]) -> None:
    """Run the scenes, print a summary of each surface and method, and keep all figures."""
    parser = argparse.ArgumentParser(prog="python -m tools.tick_times", description=__doc__.split("\n\n")[0])
    parser.add_argument("revisions", nargs="+", metavar="NAME=PYTHON")
    parser.add_argument("--surface", nargs="+", choices=list(SURFACES), default=list(SURFACES))
    parser.add_argument("--method", nargs="+", choices=METHODS, default=list(METHODS))
    parser.add_argument("--object", nargs="+", choices=OBJECTS, default=list(OBJECTS))
    parser.add_argument("--motion", nargs="+", choices=MOTIONS, default=list(MOTIONS))
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--out", type=Path, required=True, help="JSON file of every scene's figures")
    chosen = parser.parse_args(words)
    revisions = {name: Revision(python) for name, _, python in (word.partition("=") for word in chosen.revisions)}
    names, found = list(revisions), []
    with tempfile.TemporaryDirectory() as folder:
        for surface, method in itertools.product(chosen.surface, chosen.method):
            rows = []
            for object_, motion in itertools.product(chosen.object, chosen.motion):
                command = ["replay", object_, motion, "--method", method, *SURFACES[surface]]
                runs: dict[str, list[Times]] = {name: [] for name in names}
                for _ in range(chosen.runs):
                    for name, revision in revisions.items():
                        runs[name].append(revision.times(command, Path(folder) / "run.h5"))
                rows.append({name: figures(of) for name, of in runs.items()})
                scene = {"surface": surface, "method": method, "object": object_, "motion": motion}
                found.append({**scene, **rows[-1]})
                chosen.out.write_text(json.dumps(found, indent=1) + "\n")
            print(f"{surface}, {method}", *summary(rows, names), sep="\n", flush=True)
    for revision in revisions.values():
        revision.close()


if __name__ == "__main__":
    main(sys.argv[1:])
