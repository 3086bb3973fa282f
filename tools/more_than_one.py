"""CPU time of ticks of two hands, of fingers that meet and of parts on hinges, beside one hand on one rigid object.

    python -m tools.more_than_one --runs 5 --out FILE.md

Each pair of replays is run in turns. Of each tick in which the first of a pair is in contact the least time of its runs
counts, which no interruption makes longer. Two hands side by side are two threads: the longer tick of the two counts.
Run it on a machine with two cores that does nothing else.
"""

import argparse
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.kernels.tick.block import TickRecord
from hhsim.result.reader import hand_paths, load_result
from hhsim.scene.motion_catalogue import resolve_trajectory
from hhsim.scene.scene import open_scene
from hhsim.scene.script import Script
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.options import SolverOptions
from hhsim.solver.scene_solver import seen_scene
from hhsim.trees.contact_surface import contact_surface

Times = NDArray[np.float64]
OPEN = 1.92
"""Angle of the lid that stands still [rad]."""
PAIRS: tuple[tuple[str, str, str, str, float | None], ...] = (
    ("two hands, side by side", "cube grasp", "cube grasp --hands both", "longer", 1.3),
    ("fingers that meet: bunny grasp", "bunny grasp", "bunny grasp --self-contact on", "cpu", 1.1),
    ("fingers that meet: cube grasp", "cube grasp", "cube grasp --self-contact on", "cpu", 1.1),
    ("fingers that meet: cylinder grasp", "cylinder grasp", "cylinder grasp --self-contact on", "cpu", 1.1),
    ("two hands, one free object", "cube lift --free", "cube lift-both --hands both --free", "longer", None),
)
"""Name, words of both replays, which time of the second one counts, and the ratio that is aimed at."""


def replayed(words: str, folder: Path) -> list[dict[str, Times]]:
    """Replay, and return the times of each hand's ticks [µs] and whether they are in contact."""
    path = folder / "run.h5"
    hhsim = str(Path(sys.executable).with_name("hhsim"))
    command = [hhsim, "replay", *words.split(), "--out", str(path), "--quiet"]
    # 1 says that a limit was missed: the ticks are those of the table all the same.
    if subprocess.run(command, check=False, stdout=subprocess.DEVNULL).returncode not in {0, 1}:
        raise RuntimeError(f"hhsim replay {words} failed")
    found = []
    for hand in hand_paths(path):
        result = load_result(hand)
        force = np.linalg.norm(result["force/phalanx"], axis=3).sum(axis=(1, 2))
        cpu, total = (1e-3 * np.asarray(result[f"duration/{name}"]) for name in ("total_cpu", "total"))
        found.append({"cpu": cpu, "total": total, "contact": np.asarray(force > 0.0, np.float64)})
    path.unlink()
    return found


def of_pair(first: str, second: str, which: str, folder: Path) -> tuple[Times, Times, Times]:
    """Return the times of a pair of replays [µs], and where the first is in contact."""
    alone, other = replayed(first, folder)[0], replayed(second, folder)
    if which == "longer":
        return alone["total"], np.max([hand["total"] for hand in other], axis=0), alone["contact"]
    return alone["cpu"], other[0]["cpu"], alone["contact"]


def times_of(record: TickRecord) -> Times:
    """Return the CPU time of ticks [µs]."""
    return np.asarray(1e-3 * record.duration_cpu, np.float64)


def touching(record: TickRecord) -> Times:
    """Return 1 for ticks in contact, 0 for others."""
    return np.asarray(np.linalg.norm(record.total, axis=1) > 0.0, np.float64)


def of_mirror_images() -> tuple[Times, Times, Times]:
    """Return the times of a hand that grasps the cube, and of it and its mirror image at the mirrored cube [µs].

    A left hand that finds its place beside a right one touches the cube elsewhere, and does other work.
    """
    scene, flip = open_scene("cube", "grasp", hand="right"), np.diag([-1.0, 1.0, 1.0])
    right = HandConfiguration.of(scene.hands[0].ticks)
    turned = right.orientation * [1.0, 1.0, -1.0, -1.0]
    left = HandConfiguration(right.position @ flip, turned, right.flexion, right.abduction)
    other = scene.solids[0].placed_tree.transformed(flip, np.zeros(3))
    pairs = [(scene.hands[0].model, scene.solids[0].placed_tree, right), (HandModel.default("left"), other, left)]
    alone, *both = (
        HandSolver(hand, tree.arrays(), SolverOptions()).run(*motion) for hand, tree, motion in [pairs[0], *pairs]
    )
    return times_of(alone), np.sum([times_of(one) for one in both], axis=0), touching(alone)


def of_laptop(surface: str) -> tuple[Times, Times, Times]:
    """Return the times of a laptop's rigid twin, and of the laptop whose lid stands still [µs]."""
    motion = resolve_trajectory("close")
    assert isinstance(motion, Script)
    still = replace(motion, joints=(("lid", ((0.0, OPEN),)),))
    scene = open_scene("laptop", still, solid=surface == "spheres", level=3)
    seen, options = seen_scene(scene), SolverOptions(surface=surface)
    hand, haptic = scene.hands[0].model, seen.haptic[0]

    twin = HandSolver(hand, contact_surface(surface, seen.mesh, seen.tree), options).run(*haptic)
    parts = HandSolver(hand, seen.surface(surface), options).run(*haptic)
    return times_of(twin), times_of(parts), touching(twin)


def row(name: str, runs: Sequence[tuple[Times, Times, Times]], aim: float | None) -> str:
    """Return a line of the table."""
    in_contact = runs[0][2] > 0.0
    first, second = (np.min([run[k] for run in runs], axis=0) for k in (0, 1))
    if len(first) == len(second):
        first, second = first[in_contact], second[in_contact]
    quantiles = [np.percentile(times, share) for times in (first, second) for share in (50.0, 99.0)]
    ratios = quantiles[2] / quantiles[0], quantiles[3] / quantiles[1]
    values = " | ".join(f"{value:.1f}" for value in quantiles)
    return f"| {name} | {values} | {ratios[0]:.2f} | {ratios[1]:.2f} | {'' if aim is None else f'{aim:.2f}'} |"


def main(words: Sequence[str]) -> None:
    """Run all pairs, and write the table."""
    parser = argparse.ArgumentParser(prog="python -m tools.more_than_one", description=__doc__.split("\n\n")[0])
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--out", type=Path, help="file of the table")
    chosen = parser.parse_args(words)
    lines = ["| | one: p50 | p99 [µs] | more: p50 | p99 [µs] | ratio of p50 | of p99 | aim |", "|---" * 8 + "|"]
    with tempfile.TemporaryDirectory() as name:
        measured: list[tuple[str, Callable[[], tuple[Times, Times, Times]], float | None]] = [
            ("two hands, one after the other", of_mirror_images, 2.2),
            *((what, partial(of_pair, one, more, which, Path(name)), aim) for what, one, more, which, aim in PAIRS),
            *((f"laptop, {surface}", partial(of_laptop, surface), 1.3) for surface in ("mesh", "spheres")),
        ]
        for what, run, aim in measured:
            lines.append(row(what, [run() for _ in range(chosen.runs)], aim))
            print(lines[-1], flush=True)
    if chosen.out is not None:
        chosen.out.write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main(sys.argv[1:])
