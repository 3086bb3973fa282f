"""Try the gate's timing on this machine: `python -m tools.gate_trials`.

The gate's comparison is repeated on identical code, where every `worse` is a false alarm, and against a python whose
hhsim does a stated share of work more in every tick, where everything else is a miss. That python takes one module from
a changed copy and all others from here; nothing in hhsim itself knows of it. Needs a quiet machine.
"""

import argparse
import importlib.util
import json
import shlex
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hhsim.errors import HhsimError, InputError
from hhsim.gate.run import Side, find_side, process_times, this_python
from hhsim.gate.suite import GateScene, default_suite
from hhsim.gate.verdict import BETTER, WORSE, TimeComparison, compare_times

BLOCK = "hhsim.kernels.tick.block"
OVERLAY = """\
import importlib.util
import sys


class Overlay:
    def find_spec(self, name, path, target=None):
        if name == {module!r}:
            return importlib.util.spec_from_file_location(name, {file!r})


sys.meta_path.insert(0, Overlay())
"""
"""Runs before anything else in the python that is made, and brings in the changed module."""
TIMED_LINE = "        status |= tick(method, hand, surface, state, qp)\n"
"""The line of `hhsim.kernels.tick.block` behind which the work is planted: between the two readings of the clock."""
PLANTED_LINES = """\
        planted = float(i)
        for _ in range({rounds}):
            planted = planted * 0.999 + 1e-9
        if planted > 1e12:
            status |= STATUS_CAPACITY_EXCEEDED
"""
"""A chain of multiplications and additions that no compiler may leave out or shorten."""
CALIBRATION_ROUNDS = 2_000
CALIBRATION_PROCESSES = 5


@dataclass(frozen=True)
class Trials:
    """What a number of repetitions gave.

    Attributes:
        name: Identical or planted.
        ratios: Head / base, each.
        verdicts: Each.
        wrong: How many were wrong.
    """

    name: str
    ratios: tuple[float, ...]
    verdicts: tuple[str, ...]
    wrong: int


def changed_python(folder: Path, module: str, edit: Callable[[str], str]) -> Path:
    """Make a python that imports the hhsim that runs now, but for one changed module.

    Args:
        folder: Where to; is made.
        module: Its full name.
        edit: Takes the module's source to the changed one.

    Returns:
        The interpreter to call: a shell script in the folder.

    Raises:
        InputError: There is no such module.
    """
    spec = importlib.util.find_spec(module)
    if spec is None or spec.origin is None:
        raise InputError(f"there is no module {module} to change")
    folder.mkdir(parents=True, exist_ok=True)
    file = (folder / Path(spec.origin).name).absolute()
    file.write_text(edit(Path(spec.origin).read_text()))
    (folder / "sitecustomize.py").write_text(OVERLAY.format(module=module, file=str(file)))
    python = folder / "python"
    called = f"PYTHONPATH={shlex.quote(str(folder.absolute()))} exec {shlex.quote(str(this_python()))}"
    python.write_text(f'#!/bin/sh\n{called} "$@"\n')
    python.chmod(0o755)
    return python


def plant_work(rounds: int) -> Callable[[str], str]:
    """An edit of `BLOCK`: so many rounds of work more in every tick, within what is timed.

    Raises:
        InputError: (when called) the tick is not where it was.
    """

    def edit(text: str) -> str:
        if text.count(TIMED_LINE) != 1:
            raise InputError(
                f"{BLOCK} has no line {TIMED_LINE.strip()!r} any more: say in TIMED_LINE where the tick is"
            )
        return text.replace(TIMED_LINE, TIMED_LINE + PLANTED_LINES.format(rounds=rounds))

    return edit


def tally(name: str, comparisons: Sequence[TimeComparison], wanted: str | None) -> Trials:
    """Count what was wrong: verdicts other than `wanted`; where it is None, every `worse` or `better`."""
    verdicts = tuple(found.verdict for found in comparisons)
    right = [verdict == wanted if wanted else verdict not in (WORSE, BETTER) for verdict in verdicts]
    return Trials(name, tuple(found.ratio for found in comparisons), verdicts, right.count(False))


def main(arguments: Sequence[str]) -> int:
    """Run the command; returns 1 where a verdict was wrong."""
    suite = default_suite()
    scenes = {scene.name: scene for scene in suite.scenes}
    parser = argparse.ArgumentParser(prog="python -m tools.gate_trials", description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("--identical", type=int, default=40, metavar="N", help="repetitions on identical code; 40")
    parser.add_argument("--planted", type=int, default=20, metavar="N", help="repetitions with more work; 20")
    parser.add_argument("--work", type=float, default=0.10, metavar="SHARE", help="how much more work; 0.10")
    parser.add_argument("--processes", type=int, default=suite.time.processes, metavar="N", help="of each side; 5")
    parser.add_argument("--limit", type=float, default=suite.time.limit, metavar="SHARE", help="of the gate; 0.05")
    parser.add_argument("--scene", default="bunny-grasp", choices=sorted(scenes), help="of the default suite")
    parser.add_argument("--json", action="store_true", help="print JSON")
    options = parser.parse_args(arguments)
    scene = scenes[options.scene]
    try:
        with tempfile.TemporaryDirectory(prefix="hhsim-trials-") as place:
            found = _run(Path(place), scene, options)
    except HhsimError as error:
        raise SystemExit(str(error)) from error
    if options.json:
        print(json.dumps({"scene": scene.name, "work": options.work, "trials": [asdict(t) for t in found]}, indent=1))
    else:
        for trials in found:
            print(_line(trials))
    return 1 if any(trials.wrong for trials in found) else 0


def _run(folder: Path, scene: GateScene, options: Any) -> list[Trials]:
    base, same = find_side("base", this_python()), find_side("head", this_python())
    found = [tally("identical code", _repeat(scene, base, same, options, options.identical, "identical"), None)]
    if options.planted:
        probe = find_side("head", changed_python(folder / "probe", BLOCK, plant_work(CALIBRATION_ROUNDS)))
        probe.figures(scene, folder)
        after, before = process_times(scene, folder, probe, base, CALIBRATION_PROCESSES)
        tick, slowed = float(np.median(before)), float(np.median(after))
        if slowed <= tick:
            raise InputError("planted work takes no time: is it in the module that is timed?")
        rounds = round(options.work * tick * CALIBRATION_ROUNDS / (slowed - tick))
        rate = f"a tick is {1e6 * tick:.2f} µs; {rounds} rounds of {1e9 * (slowed - tick) / CALIBRATION_ROUNDS:.2f} ns"
        print(f"planted: {rate} make {100.0 * options.work:g} %", file=sys.stderr)
        slower = find_side("head", changed_python(folder / "slower", BLOCK, plant_work(rounds)))
        comparisons = _repeat(scene, base, slower, options, options.planted, "planted")
        found.append(tally(f"{100.0 * options.work:g} % more work", comparisons, WORSE))
    return found


def _repeat(
    scene: GateScene, base: Side, head: Side, options: Any, repetitions: int, name: str
) -> list[TimeComparison]:
    # Compiled, once, before anything is timed.
    for side in (base, head):
        side.figures(scene, Path.cwd())
    found = []
    for i in range(repetitions):
        after, before = process_times(scene, Path.cwd(), head, base, options.processes)
        found.append(compare_times(before, after, options.limit))
        print(f"{name} {i + 1} of {repetitions}: {found[-1].ratio:.4f}, {found[-1].verdict}", file=sys.stderr)
    return found


def _line(trials: Trials) -> str:
    if not trials.ratios:
        return f"{trials.name}: none"
    ratios = np.array(trials.ratios)
    spread = f"head/base {ratios.min():.4f} to {ratios.max():.4f}, median {np.median(ratios):.4f}"
    return f"{trials.name}: {trials.wrong} of {len(ratios)} verdicts wrong; {spread}"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
