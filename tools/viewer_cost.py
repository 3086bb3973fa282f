"""What looking at a replay costs it: `python -m tools.viewer_cost`.

`hhsim replay` is run in pairs, with --rerun FILE.rrd and without, in turn, as whole commands. Compared are their wall
time, the CPU time of all their processes, and the CPU time of a tick, as the command's own table has it. Then
`hhsim view` writes the same result to a file once more, timed by itself. With --live, sessions of a simulated glove are
compared instead, with a viewer and without: how punctual the loop is. Needs a quiet machine with two processors.
"""

import argparse
import json
import resource
import statistics
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from hhsim.errors import HhsimError, InputError
from hhsim.gate.run import MAIN, run_python, this_python
from hhsim.gate.verdict import base_first

RATES = (1000.0, 3334.0)
"""Of the default runs [Hz]: 3,000 and 10,000 ticks of the grasp."""
PAIRS = 12
LIMIT = 0.10
"""Share by which looking may slow the whole command."""
WRITE_LIMIT = 1.0
"""Longest that 10,000 ticks may take to be written [s], rerun's import included."""

LIVE_FIGURES = ("missed", "wakeup_p50", "wakeup_p99", "latency_p99", "tick_p50", "tick_p99")
"""Of a live session: share of the periods without a tick; then times [s]."""


@dataclass(frozen=True)
class Command:
    """What one command took.

    Attributes:
        wall: From its start to its end [s].
        cpu: Of all its processes [s].
        tick: p50 of the CPU time of a tick in contact [s].
        ticks: How many it ran.
    """

    wall: float
    cpu: float
    tick: float
    ticks: int


@dataclass(frozen=True)
class ViewerCost:
    """Pairs of commands, with a viewer and without.

    Attributes:
        ticks: Of each.
        pairs: How many.
        wall, cpu, tick: Medians without a viewer [s].
        wall_ratio, cpu_ratio, tick_ratio: Median with a viewer / median without.
        wall_quartiles: Of the ratios of the pairs, lower and upper.
        write: Median time that `hhsim view` took for the same ticks [s], rerun's import included.
    """

    ticks: int
    pairs: int
    wall: float
    cpu: float
    tick: float
    wall_ratio: float
    cpu_ratio: float
    tick_ratio: float
    wall_quartiles: tuple[float, float]
    write: float

    @property
    def missed(self) -> tuple[str, ...]:
        """Which bars it misses, in words."""
        missed = []
        if self.wall_ratio > 1.0 + LIMIT:
            longer = 100.0 * (self.wall_ratio - 1.0)
            missed.append(f"the command takes {longer:.1f} % longer, allowed are {100.0 * LIMIT:g}")
        if self.write * 10_000 > WRITE_LIMIT * max(self.ticks, 10_000):
            missed.append(f"writing takes {self.write:.2f} s, allowed is {WRITE_LIMIT:g} s for 10,000 ticks")
        return tuple(missed)


def viewer_cost(without: Sequence[Command], with_: Sequence[Command], written: Sequence[float]) -> ViewerCost:
    """Compare pairs of commands.

    Args:
        without: Without a viewer, one of each pair.
        with_: With one, in the same order.
        written: Times of `hhsim view` [s].

    Raises:
        InputError: No pair, or commands that ran different numbers of ticks.
    """
    if not without or len(without) != len(with_) or not written:
        raise InputError(f"{len(without)} commands without a viewer, {len(with_)} with one: expected pairs")
    ticks = {command.ticks for command in (*without, *with_)}
    if len(ticks) > 1:
        raise InputError(f"the commands of a pair ran different numbers of ticks: {sorted(ticks)}")

    def medians(commands: Sequence[Command]) -> list[float]:
        return [statistics.median(getattr(command, name) for command in commands) for name in ("wall", "cpu", "tick")]

    before, after = medians(without), medians(with_)
    ratios = sorted(seen.wall / unseen.wall for seen, unseen in zip(with_, without))
    quarters = statistics.quantiles(ratios, n=4, method="inclusive") if len(ratios) > 1 else [ratios[0]] * 3
    return ViewerCost(
        ticks=ticks.pop(),
        pairs=len(without),
        wall=before[0],
        cpu=before[1],
        tick=before[2],
        wall_ratio=after[0] / before[0],
        cpu_ratio=after[1] / before[1],
        tick_ratio=after[2] / before[2],
        wall_quartiles=(quarters[0], quarters[2]),
        write=statistics.median(written),
    )


def live_medians(sessions: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """Medians of `LIVE_FIGURES` over sessions, each the document that `hhsim live glove --json` prints.

    Raises:
        InputError: No session, or one without a tick.
    """
    if not sessions or any(session["ticks"] == 0 for session in sessions):
        raise InputError("there is no session, or one without a tick: nothing to compare")
    shares = [{**session, "missed": session["missed"] / (session["missed"] + session["ticks"])} for session in sessions]
    return {name: statistics.median(session[name] for session in shares) for name in LIVE_FIGURES}


def main(arguments: Sequence[str]) -> int:
    """Run the command; returns 1 where a bar was missed."""
    parser = argparse.ArgumentParser(prog="python -m tools.viewer_cost", description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("object", nargs="?", default="bunny", help="bunny")
    parser.add_argument("trajectory", nargs="?", default="grasp", help="grasp")
    parser.add_argument("--pairs", type=int, default=PAIRS, metavar="N", help=f"of commands at each rate; {PAIRS}")
    parser.add_argument("--rate", type=float, nargs="+", default=RATES, metavar="HZ", help="ticks a second; 1000 3334")
    parser.add_argument("--live", type=float, metavar="S", help="compare live sessions of so many seconds instead")
    parser.add_argument("--json", action="store_true", help="print JSON")
    options = parser.parse_args(arguments)
    if options.pairs < 1:
        parser.error(f"--pairs {options.pairs}: expected 1 or more")
    found = []
    try:
        with tempfile.TemporaryDirectory(prefix="hhsim-viewer-") as place:
            if options.live is not None:
                _tell_live(*_measure_live(Path(place), options.object, options.live, options.pairs), options.json)
                return 0
            for rate in options.rate:
                scene = [options.object, options.trajectory, "--rate", f"{rate:g}"]
                found.append(_measure(Path(place), scene, options.pairs))
    except HhsimError as error:
        raise SystemExit(str(error)) from error
    if options.json:
        print(json.dumps([{**asdict(cost), "missed": cost.missed} for cost in found], indent=1))
    else:
        for cost in found:
            print(_line(cost))
    return 1 if any(cost.missed for cost in found) else 0


def _measure(folder: Path, scene: Sequence[str], pairs: int) -> ViewerCost:
    result, recording = folder / "run.h5", folder / "run.rrd"
    replay = ["replay", *scene, "--out", str(result), "--json"]
    shown = [*replay, "--rerun", str(recording)]
    # Compiled, cached and read from the disk, once, before anything is timed.
    for arguments in (replay, shown):
        _timed(arguments, folder)
    without: list[Command] = []
    with_: list[Command] = []
    written: list[float] = []
    for pair in range(pairs):
        sides = [(replay, without), (shown, with_)]
        for arguments, commands in sides if base_first(pair) else reversed(sides):
            wall, cpu, document = _timed(arguments, folder)
            commands.append(Command(wall, cpu, document["tick_cpu_p50"], document["ticks"]))
        _, _, document = _timed(["view", str(result), "--rerun", str(recording), "--json"], folder)
        written.append(document["seconds"])
        print(f"{pair + 1} of {pairs}: {without[-1].wall:.3f} s, {with_[-1].wall:.3f} s with a viewer", file=sys.stderr)
    return viewer_cost(without, with_, written)


def _measure_live(folder: Path, object_: str, seconds: float, pairs: int) -> tuple[dict[str, float], dict[str, float]]:
    session = ["live", "glove", object_, "--device", "sim", "--no-record", "--duration", f"{seconds:g}", "--json"]
    shown = [*session, "--rerun", str(folder / "live.rrd")]
    without: list[Any] = []
    with_: list[Any] = []
    for pair in range(pairs):
        sides = [(session, without), (shown, with_)]
        for arguments, sessions in sides if base_first(pair) else reversed(sides):
            sessions.append(_timed(arguments, folder)[2])
        print(f"{pair + 1} of {pairs}", file=sys.stderr)
    return live_medians(without), live_medians(with_)


def _tell_live(without: Mapping[str, float], with_: Mapping[str, float], as_json: bool) -> None:
    if as_json:
        print(json.dumps({"without": without, "with": with_}, indent=1))
        return
    print("medians of the sessions, without a viewer and with one:")
    for name in LIVE_FIGURES:
        scale, unit = (100.0, "%") if name == "missed" else (1e6, "µs")
        print(f"  {name} {scale * without[name]:.2f} {unit}, {scale * with_[name]:.2f} {unit}")


def _timed(arguments: Sequence[str], folder: Path) -> tuple[float, float, Any]:
    """Wall and CPU time [s] of a command of hhsim with all its processes, and its JSON document."""
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    answer = run_python(this_python(), MAIN, arguments, folder)
    wall, after = time.perf_counter() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
    if answer.returncode != 0:
        raise InputError(f"hhsim {' '.join(arguments)} ended with code {answer.returncode}: {answer.stderr.strip()}")
    return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, json.loads(answer.stdout)


def _line(cost: ViewerCost) -> str:
    low, high = cost.wall_quartiles
    lines = [
        f"{cost.ticks:,} ticks, {cost.pairs} pairs, with --rerun FILE.rrd / without:",
        f"  wall {cost.wall:.3f} s, ratio {cost.wall_ratio:.3f} (half of the pairs {low:.3f} to {high:.3f})",
        f"  CPU of all processes {cost.cpu:.3f} s, ratio {cost.cpu_ratio:.3f}",
        f"  tick in contact, CPU p50 {1e6 * cost.tick:.2f} µs, ratio {cost.tick_ratio:.3f}",
        f"  hhsim view writes the ticks in {cost.write:.3f} s, import of rerun included",
    ]
    return "\n".join([*lines, *(f"  missed: {sentence}" for sentence in cost.missed)])


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
