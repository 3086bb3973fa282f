"""First table of the board: each method, surface and set of options over all its scenes, and the Pareto frontier."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from math import hypot

from hhsim.bench.robustness.case import DEEPEST
from hhsim.bench.speed_error_table import GAIN
from hhsim.board.entry import Board, Entry, shown_options
from hhsim.replay.verdict import MISSED, UNTOUCHED

NAN = float("nan")


@dataclass(frozen=True)
class Standing:
    """One method on one machine, over its scenes."""

    method: str
    surface: str
    options: str  # options with the names that plans give them
    machine: str
    scenes: int  # number of objects and motions
    failed: int  # number of cells that failed
    touched: int  # number of runs in which the hand touched something
    missed: int  # number of runs that missed a limit
    depth: float  # deepest in the touched surface [m]
    off_mesh: float  # largest distance of a contact from the mesh [m]
    tracking: float  # coupling energy over the local optimum, mean over scenes [%]
    stuck: int
    p50: float  # CPU time of a tick in contact, median over scenes [s]
    p99: float  # worst of the scenes [s]
    comparable: bool  # True if each of its scenes had a core of its own
    p50_std: float = NAN  # their standard deviation over the runs of these scenes [s]; NaN of one run
    p99_std: float = NAN
    # True if none of the same scenes on the same machine is faster and as good in every one of `errors`.
    first: bool = False

    @property
    def errors(self) -> tuple[float, float, float]:
        """Errors besides speed: depth of more than every method may have, contact error, energy off the optimum."""
        depth = max(self.depth, DEEPEST) if self.depth == self.depth else NAN
        return depth, self.off_mesh, abs(self.tracking)

    def gains_on(self, faster: "Standing") -> bool:
        """Return whether one of the errors is better by more than `GAIN`."""
        return any(mine < (1.0 - GAIN) * other for mine, other in zip(self.errors, faster.errors))


def standings(board: Board) -> list[Standing]:
    """Return every method by machine, with the frontier of those that did the same scenes with cores of their own."""
    groups = _groups(board.entries)
    found = [_standing(key, entries, board.failed) for key, entries in groups.items()]
    same: dict[tuple[str, frozenset[tuple[str, str]]], list[int]] = {}
    for number, (key, entries) in enumerate(groups.items()):
        # Times compare within a machine, and worst cases among the same scenes alone.
        if found[number].comparable:
            same.setdefault((key[0], frozenset(entry.scene for entry in entries)), []).append(number)
    of = list(groups.values())
    for numbers in same.values():
        kept: list[int] = []
        for number in sorted(numbers, key=lambda number: (found[number].p50, found[number].errors)):
            one = found[number]
            known = one.p50 == one.p50 and any(error == error for error in one.errors[:2])
            # The same runs under another name do not beat them.
            if known and all(one.gains_on(found[faster]) or of[number] == of[faster] for faster in kept):
                kept.append(number)
                found[number] = replace(one, first=True)
    return sorted(found, key=lambda one: (one.machine, -one.scenes, not one.first, one.p50))


def _groups(entries: Iterable[Entry]) -> dict[tuple[str, ...], list[Entry]]:
    """Return entries by machine, method, surface, and each name of their options with what these are."""
    sets = {(e.machine, e.method, e.surface, e.options): e.option_sets for e in entries if e.option_sets}
    named: dict[tuple[str, ...], list[Entry]] = {}
    for entry in entries:
        what = entry.machine, entry.method, entry.surface
        for name in entry.option_sets or sets.get((*what, entry.options), [""]):
            named.setdefault((*what, name, "" if name else entry.options), []).append(entry)
    found: dict[tuple[str, ...], list[Entry]] = {}
    for key, mine in named.items():
        # What a set changes depends on the object; of a scene that was run twice (seeds, two plans), on the run.
        twice = len({entry.scene for entry in mine}) < len(mine)
        words = ", ".join(dict.fromkeys(word for entry in mine for word in entry.options.split(", ") if word))
        for entry in mine:
            found.setdefault((*key[:4], entry.options if twice else words), []).append(entry)
    return found


def _standing(key: tuple[str, ...], entries: Sequence[Entry], failed: Iterable[Entry]) -> Standing:
    machine, method, surface, name, options = key
    times = {
        name: sorted((one.figures[name], one.deviations.get(name, NAN)) for one in entries if name in one.figures)
        for name in ("tick_cpu_p50", "tick_cpu_p99")
    }
    p50, p50_std = _mean_of(times["tick_cpu_p50"], middle=True)
    p99, p99_std = _mean_of(times["tick_cpu_p99"], middle=False)
    return Standing(
        method=method,
        surface=surface,
        options=shown_options(name, options),
        machine=machine,
        scenes=len({entry.scene for entry in entries}),
        failed=sum((one.method, one.surface, one.machine) == (method, surface, machine) for one in failed),
        touched=sum(entry.verdict != UNTOUCHED for entry in entries),
        missed=sum(entry.verdict == MISSED for entry in entries),
        depth=max(_known(entries, "penetration_max"), default=NAN),
        off_mesh=max(_known(entries, "contact_error_max"), default=NAN),
        tracking=_mean(_known(entries, "tracking_excess")),
        stuck=int(sum(_known(entries, "stuck_ticks"))),
        p50=p50,
        p99=p99,
        comparable=all(entry.own_core for entry in entries),
        p50_std=p50_std,
        p99_std=p99_std,
    )


def _mean_of(times: Sequence[tuple[float, float]], *, middle: bool) -> tuple[float, float]:
    """Return the median of times in order, or the last of them, and its deviation."""
    if not times:
        return NAN, NAN
    # Of an even number the median is the mean of two, whose deviations are independent.
    chosen = times[(len(times) - 1) // 2 : len(times) // 2 + 1] if middle else times[-1:]
    return _mean([time for time, _ in chosen]), hypot(*(std for _, std in chosen)) / len(chosen)


def _known(entries: Iterable[Entry], name: str) -> list[float]:
    return [entry.figures[name] for entry in entries if name in entry.figures]


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values) if values else NAN
