"""CPU times of ticks by several revisions of hhsim, in turns: medians and tails of many scenes, and their ratios.

    python -m tools.tick_times before=../before/.venv/bin/python after=.venv/bin/python --out times.json

Each revision is a Python that has it installed, and one process of it runs all scenes by the library. A scene is run
by each revision in turn, `--runs` times; of each tick in contact the least CPU time counts, which no interruption makes
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

import numpy as np
from numpy.typing import NDArray

WORKER = """
import json, os, sys
import numpy as np
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.kernels.tick.state import WORK_TOUCHING
from hhsim.mesh.catalogue import load_object
from hhsim.scene.motion_catalogue import load_script
from hhsim.scene.scene import make_scene
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.options import SolverOptions
from hhsim.trees.cache import cached_sphere_tree
from hhsim.trees.contact_surface import contact_surface
from hhsim.trees.options import TreeOptions
answers = os.fdopen(os.dup(1), "w")
os.dup2(2, 1)
made = {}
for line in sys.stdin:
    object_, motion, surface, level, method, path = json.loads(line)
    key = object_, motion, surface, level
    if key not in made:
        made.clear()
        mesh = load_object(object_).mesh
        tree = cached_sphere_tree(mesh, TreeOptions(level=level))
        made[key] = make_scene(mesh, tree, HandModel.default(), load_script(motion))
    scene = made[key]
    arrays = contact_surface(surface, scene.solids[0].placed_mesh, scene.solids[0].placed_tree).arrays
    solver = HandSolver(scene.hands[0].model, arrays, SolverOptions(method=method, surface=surface))
    record = solver.run(*HandConfiguration.of(scene.hands[0].ticks))
    np.save(path, np.where(record.work[:, WORK_TOUCHING] > 0, 1e-3 * record.duration_cpu, np.nan))
    print("done", file=answers, flush=True)
"""
"""Program of a revision's process: for each line of JSON, runs the ticks of a scene and saves their times [µs]."""
OBJECTS = (
    *("sphere", "cylinder", "triangular-prism", "cube", "hexagonal-prism"),
    *("rock", "shamrock", "cup", "teapot", "bunny"),
)
MOTIONS = ("touch", "pinch", "grasp", "whole-hand", "slide")
METHODS = ("coupled", "progressive")
SURFACES: Mapping[str, tuple[str, int]] = {"mesh": ("mesh", 4), "level 4": ("spheres", 4), "level 5": ("spheres", 5)}
"""Surface and tree level of the solver by what the table calls them."""
TAIL = 3.0
"""A scene has a long tail if its p99 is more than this many times its p50."""
Times = NDArray[np.float64]


class Revision:
    """A revision of hhsim, in a process that runs one command after another."""

    def __init__(self, python: str) -> None:
        # -P: hhsim is that of the Python, and not of the current folder.
        self._process = subprocess.Popen(
            [python, "-P", "-c", WORKER], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    def times(self, scene: Sequence[str | int], path: Path) -> Times:
        """Run the ticks of a scene; return the CPU time of each [µs], NaN out of contact."""
        assert self._process.stdin is not None and self._process.stdout is not None
        self._process.stdin.write(json.dumps([*scene, str(path)]) + "\n")
        self._process.stdin.flush()
        if self._process.stdout.readline().strip() != "done":
            raise RuntimeError(f"{scene}: a revision failed")
        times: Times = np.load(path)
        return times

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
            rows: list[dict[str, dict[str, float]]] = []
            for object_, motion in itertools.product(chosen.object, chosen.motion):
                of_scene = object_, motion, *SURFACES[surface], method
                runs: dict[str, list[Times]] = {name: [] for name in names}
                for _ in range(chosen.runs):
                    for name, revision in revisions.items():
                        runs[name].append(revision.times(of_scene, Path(folder) / "times.npy"))
                rows.append({name: figures(of) for name, of in runs.items()})
                scene = {"surface": surface, "method": method, "object": object_, "motion": motion}
                found.append({**scene, **rows[-1]})
                chosen.out.write_text(json.dumps(found, indent=1) + "\n")
            print(f"{surface}, {method}", *summary(rows, names), sep="\n", flush=True)
    for revision in revisions.values():
        revision.close()


if __name__ == "__main__":
    main(sys.argv[1:])
