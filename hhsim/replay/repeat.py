"""Run the ticks of a result again, from nothing but the file, and compare every array: bits, and what is rounding."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from hhsim import __version__
from hhsim.arrays import AnyArray
from hhsim.errors import InputError
from hhsim.hand.configuration import HandConfiguration
from hhsim.kernels.free.record import ObjectRecord
from hhsim.kernels.tick.block import HapticBlock, TickRecord
from hhsim.motion.object_motion import RigidMotion
from hhsim.replay.free_ticks import as_seen, contact_rows, free_block
from hhsim.replay.stored_scene import require_whole, stored_free, stored_hand, stored_options, stored_surface
from hhsim.replay.tick_columns import TickColumns
from hhsim.result.object_frame import as_object_sees, in_the_world
from hhsim.result.reader import Result
from hhsim.result.schema import CONTACT, CONTACT_COLUMNS, FREE_COLUMNS, OBJECT_COLUMNS, TICK_COLUMNS, Column
from hhsim.solver.compile import warm_up
from hhsim.solver.free_engine import object_record, of_tick
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.known_methods import find_method
from hhsim.solver.method import METHODS
from hhsim.solver.workspace import tick_record
from hhsim.system import environment as info
from hhsim.system.deferred_sigint import interruptible_between

Progress = Callable[[str, int, int], None]

TIMINGS = "duration/"
GIVEN = ("time", "input_seq", "haptic/")
"""Columns that are the run's input."""
COMPARED_IF_FREE: tuple[Column, ...] = (*OBJECT_COLUMNS, *FREE_COLUMNS)
COMPARED: tuple[Column, ...] = tuple(column for column in TICK_COLUMNS if not column.name.startswith((TIMINGS, *GIVEN)))
"""Columns that a second run computes anew; all but the input and the timings."""
ROUNDING = {
    **dict.fromkeys(("m", "rad", "1"), 1e-12),
    **dict.fromkeys(("N", "N·m", "N,N·m", "m/s", "rad/s"), 1e-9),
    "%": 2e-5,
}
"""Largest difference that counts as rounding, by unit; integers, of whatever unit, must be equal but for `COUNTERS`.

Processors that fuse or order operations differently were seen to differ by 2e-16 m and 2e-13 N. A speed is a difference
of poses over a millisecond; the change of a force in % is that of N over the least force that has one, 0.01 N.
"""
COUNTERS = "work/"
"""Columns that count how a tick was solved. A last bit may decide that a step is taken more: where nothing but these
differs beyond rounding, the run is the same."""
IDENTICAL, WITHIN, DIFFERENT, PARTLY = "identical", "within rounding", "different", "not all ticks run"
"""What a second run can come to."""


@dataclass(frozen=True)
class ArrayComparison:
    """One array of a result beside that of the second run.

    Attributes:
        name: Of the dataset under /tick.
        identical: Bit for bit, in every tick.
        ticks: How many differ.
        first_tick: The first that differs; -1 where none does.
        largest: Largest difference, in `units`; NaN or infinite where one side alone is so.
        units: Of the dataset.
        bound: Largest difference that counts as rounding, in `units`; 0 for integers, infinite for counters of work.
        first_beyond: First tick that differs by more; -1 where none does.
    """

    name: str
    identical: bool
    ticks: int
    first_tick: int
    largest: float
    units: str
    bound: float
    first_beyond: int

    @property
    def word(self) -> str:
        """Identical, within rounding, or different."""
        return IDENTICAL if self.identical else WITHIN if self.first_beyond < 0 else DIFFERENT


@dataclass(frozen=True)
class RunAgain:
    """What a second run gave.

    Attributes:
        path: The result.
        complete: Whether the file is whole; where it is not, the ticks that it has were run.
        ticks: How many were run and compared.
        ticks_stored: How many the file has. More than `ticks` where a session lost some: what followed on those that
            were lost cannot be run.
        arrays: All that are computed.
        notes: What a reader should know besides, a sentence each.
        made_elsewhere: Whether something differs, and hhsim or the machine is not the file's: other bits are then to
            be expected.
    """

    path: Path
    complete: bool
    ticks: int
    ticks_stored: int
    arrays: tuple[ArrayComparison, ...]
    notes: tuple[str, ...]
    made_elsewhere: bool = False

    @property
    def identical(self) -> bool:
        """Whether every tick of the file was run, and every array is the same bit for bit."""
        return self.word == IDENTICAL

    @property
    def word(self) -> str:
        """The worst of the arrays' words; "not all ticks run" where those that were run do not differ."""
        words = {array.word for array in self.arrays}
        if DIFFERENT in words:
            return DIFFERENT
        if self.ticks < self.ticks_stored:
            return PARTLY
        return WITHIN if WITHIN in words else IDENTICAL

    @property
    def same(self) -> bool:
        """Whether it is identical or within rounding."""
        return self.word in (IDENTICAL, WITHIN)

    @property
    def sentence(self) -> str:
        """What it came to, and where a difference began."""
        if self.word == IDENTICAL:
            return "identical in every tick"
        if self.word == WITHIN:
            return "within rounding: no array differs by more than its bound, and integers but counts of work are equal"
        if self.word == PARTLY:
            return f"not all ticks run: {self.ticks:,} of {self.ticks_stored:,}"
        first = min((array for array in self.arrays if array.word == DIFFERENT), key=lambda array: array.first_beyond)
        begun = min(array.first_tick for array in self.arrays if not array.identical)
        return (
            f"different: beyond rounding from tick {first.first_beyond:,} on, first {first.name}; the first bits "
            f"differ in tick {begun:,}"
        )

    def to_json(self) -> dict[str, Any]:
        """All of it as plain values."""
        return {
            "result": str(self.path),
            "word": self.word,
            "identical": self.identical,
            "complete": self.complete,
            "ticks": self.ticks,
            "ticks_stored": self.ticks_stored,
            "arrays": {
                array.name: {
                    "word": array.word,
                    "identical": array.identical,
                    "ticks_that_differ": array.ticks,
                    "first_tick": array.first_tick if array.ticks else None,
                    "first_tick_beyond_rounding": array.first_beyond if array.first_beyond >= 0 else None,
                    "largest_difference": array.largest,
                    "bound": array.bound,
                    "units": array.units,
                }
                for array in self.arrays
            },
            "notes": list(self.notes),
        }


def run_again(result: Result, *, progress: Progress | None = None) -> RunAgain:
    """Run all ticks of a result again, with the hand, the tree and the options that it holds.

    Args:
        result: Complete or not; of a replay or of a live session.
        progress: Called with what is being done, how much is done and how much there is.

    Raises:
        InputError: An object, a tree or a hand that is not the one of the run; no ticks.
    """
    require_whole(result)
    if result.ticks == 0:
        raise InputError(f"{result.path} holds no ticks: there is nothing to run again")
    hand, options = stored_hand(result), stored_options(result)
    surface, free = stored_surface(result), stored_free(result)
    warm_up(hand, options, free)
    solver = HandSolver(hand, surface, options, free)
    columns = TickColumns(surface.arrays, hand, options)
    total, notes = _runnable(result)
    moving = [] if free is None else list(COMPARED_IF_FREE)
    tallies = [_Tally(column) for column in (*COMPARED, *moving)]
    contacts = [] if free is None else [_Tally(replace(c, name=f"{CONTACT}/{c.name}")) for c in CONTACT_COLUMNS]
    with interruptible_between() as check_interrupt:
        done = 0
        for stored in result.blocks([column.name for column in (*TICK_COLUMNS, *moving)]):
            if progress is not None:
                progress("ticks", done, total)
            stored = {name: values[: total - done] for name, values in stored.items()}
            here = slice(done, done + len(stored["time"]))
            if free is None:
                moved = result.moved_since_first(here) if result.driven else None
                haptic = _seen(stored, moved)
                record = _solve(solver, haptic, result.live is not None)
                block = columns.block(stored["time"], stored["input_seq"], haptic, record)
                if moved is not None:
                    block = in_the_world(block, moved)
            else:
                haptic = _seen(stored, None)
                record, ticks = _solve_free(solver, haptic, result.live is not None)
                block = columns.block(stored["time"], stored["input_seq"], as_seen(haptic, ticks), record)
                first = (result.static["object/position"], result.static["object/orientation"])
                block = free_block(block, haptic, ticks, *first)
                _compare_contacts(result, here, contact_rows(ticks, done), contacts)
            for tally in tallies:
                tally.add(stored[tally.column.name], block[tally.column.name])
            done += len(stored["time"])
            check_interrupt()
            if done == total:
                break
    if progress is not None:
        progress("ticks", total, total)
    arrays = tuple(tally.comparison() for tally in (*tallies, *contacts))
    counts = [f"{a.name} at {a.ticks:,}" for a in arrays if a.ticks and a.name.startswith(COUNTERS)]
    if counts and not any(array.word == DIFFERENT for array in arrays):
        notes.append(f"counts of work differ, which makes no run another: of {total:,} ticks {', '.join(counts)}")
    makers: list[str] = []
    if not all(array.identical for array in arrays):
        makers = _other_makers(result)
        notes += makers or [_same_makers(result)]
    return RunAgain(result.path, result.complete, total, result.ticks, arrays, tuple(notes), bool(makers))


def _seen(stored: dict[str, AnyArray], moved: RigidMotion | None) -> HandConfiguration:
    """The haptic hand of a block, as the object sees it."""
    names = {name: f"haptic/{name}" for name in HandConfiguration._fields}
    given = {name: stored[dataset] for name, dataset in names.items()}
    if moved is not None:
        given = {name: as_object_sees(names[name], values, moved) for name, values in given.items()}
    return HandConfiguration(**given)


def _compare_contacts(result: Result, ticks: slice, computed: dict[str, AnyArray], tallies: Sequence["_Tally"]) -> None:
    """Count the contacts of some ticks that differ; where there are more or fewer of them, all of them do."""
    first, last = np.searchsorted(result[f"{CONTACT}/tick"], (ticks.start, ticks.stop))
    at, other = result[f"{CONTACT}/tick"][first:last], computed["tick"]
    if len(at) != len(other):
        # From the first tick on that has another number of them.
        many = ticks.stop - ticks.start
        counts = [np.bincount(np.clip(of - ticks.start, 0, many - 1), minlength=many) for of in (at, other)]
        begun = ticks.start + int(np.argmax(counts[0] != counts[1]))
        at = np.full(max(len(at), len(other)), begun)
    for tally, again in zip(tallies, computed.values(), strict=True):
        stored = result[tally.column.name][first:last]
        if len(stored) != len(again):
            shape = (max(len(stored), len(again)), *tally.column.shape)
            stored, again = np.zeros(shape, tally.column.dtype), np.ones(shape)
        if len(stored):
            tally.add(stored, again, at)


class _Tally:
    """Counts the ticks of a column that differ."""

    def __init__(self, column: Column) -> None:
        self.column = column
        self.bound = ROUNDING[column.units] if np.dtype(column.dtype).kind == "f" else 0.0
        self.bound = np.inf if column.name.startswith(COUNTERS) else self.bound
        self._seen = self._differ = 0
        self._first = self._beyond = -1
        self._largest = 0.0

    def add(self, stored: AnyArray, computed: AnyArray, at: AnyArray | None = None) -> None:
        """Compare some rows; `at` is the tick of each where a row is not a tick."""
        again = np.ascontiguousarray(computed, dtype=self.column.dtype)
        stored = np.ascontiguousarray(stored)
        if stored.tobytes() != again.tobytes():
            rows = len(stored)
            bits = stored.reshape(rows, -1).view(np.uint8) != again.reshape(rows, -1).view(np.uint8)
            differ = np.flatnonzero(bits.any(axis=1))
            at = np.arange(self._seen, self._seen + rows) if at is None else at
            if self._first < 0:
                self._first = int(at[differ[0]])
            self._differ += len(differ)
            a, b = (values[differ].astype(np.float64).reshape(len(differ), -1) for values in (stored, again))
            with np.errstate(invalid="ignore"):
                apart = np.where((a == b) | (np.isnan(a) & np.isnan(b)), 0.0, np.abs(a - b)).max(axis=1)
            self._largest = float(np.maximum(self._largest, apart.max()))
            # Written so that NaN is beyond; integers of more than 53 bits may differ though their floats do not.
            beyond = differ[~(apart <= self.bound) | (self.bound == 0.0)]
            if self._beyond < 0 and beyond.size:
                self._beyond = int(at[beyond[0]])
        self._seen += len(stored)

    def comparison(self) -> ArrayComparison:
        column = self.column
        return ArrayComparison(
            *(column.name, self._differ == 0, self._differ, self._first, self._largest, column.units),
            *(self.bound, self._beyond),
        )


def _runnable(result: Result) -> tuple[int, list[str]]:
    """How many ticks can be run again, and what to say where it is not all of them."""
    notes = [] if result.complete else ["the file is of a run that was stopped: its ticks so far were run again"]
    if result.live is None:
        return result.ticks, notes
    record, period, missed = (result[f"live/tick/{name}"] for name in ("record", "period", "missed"))
    if record[0] != 0:
        raise InputError(
            f"{result.path} cannot be run again: the recorder lost its first {record[0]:,} ticks, and what the others "
            "began with is not known"
        )
    gaps = np.flatnonzero(np.diff(record) != 1)
    total = int(gaps[0]) + 1 if gaps.size else result.ticks
    if gaps.size:
        lost = int(record[total] - record[total - 1] - 1)
        notes.append(
            f"the recorder lost {lost:,} ticks after tick {total - 1:,}: what followed on them cannot be run again, "
            "and was not compared"
        )
    unsolved = int(np.sum(np.diff(period[:total]) - 1 - missed[1:total]))
    if unsolved:
        notes.append(
            f"ticks whose solver failed, and that are not in the file: {unsolved:,}; what follows on them may differ"
        )
    return total, notes


def _solve(solver: HandSolver, haptic: HandConfiguration, live: bool) -> TickRecord:
    """The ticks of a block; those of a session one by one, as its loop ran them."""
    if not live:
        return solver.run(*haptic)
    count = len(haptic.position)
    record, row = tick_record(count), tick_record(1)
    for i in range(count):
        # A tick whose pairs did not fit says so in its status, and the loop went on.
        solver.tick(HapticBlock(*(np.ascontiguousarray(values[i : i + 1]) for values in haptic)), row)
        for values, value in zip(record, row):
            values[i] = value[0]
    return record


def _solve_free(solver: HandSolver, haptic: HandConfiguration, live: bool) -> tuple[TickRecord, ObjectRecord]:
    """The same with a free object, and what became of it."""
    if not live:
        return solver.run(*haptic), solver.object_ticks
    count = len(haptic.position)
    record, ticks = tick_record(count), object_record(count)
    for i in range(count):
        given = HapticBlock(*(np.ascontiguousarray(values[i : i + 1]) for values in haptic))
        row: list[Any] = [values[i : i + 1] for values in record]
        solver.tick(given, TickRecord._make(row), of_tick(ticks, i))
    return record, ticks


def _same_makers(result: Result) -> str:
    """Return what to expect of the bits where nothing that is known differs."""
    same = "hhsim, packages, processor and system are those of the file"
    if result.method in METHODS:
        return f"{same}: the bits should be the same"
    return f"{same}; of the method the file of its class alone is compared, and no library or module that it loads"


def _other_makers(result: Result) -> list[str]:
    """In what hhsim, the method and the machine differ from those of the file: other bits are then to be expected."""
    version, machine, packages = __version__, asdict(info.machine()), info.package_versions()
    pairs = [("hhsim", result.hhsim_version, version)]
    pairs += [(name, result.packages.get(name, ""), packages.get(name, "")) for name in ("numpy", "numba")]
    pairs += [(name, str(result.machine.get(name, "")), str(machine[name])) for name in ("cpu", "system")]
    source = "" if result.method in METHODS else find_method(result.method).source
    found = [
        f"{name}: the file was made with {then or 'none'}, this is {now}" for name, then, now in pairs if then != now
    ]
    if result.scene.get("method_source", source) != source:
        found.append(f"the code of method {result.method} has changed since")
    return found
