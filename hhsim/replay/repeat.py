"""Second run of a result's ticks, from nothing but the file, and comparison of every array: bits, and rounding."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from hhsim import __version__
from hhsim.arrays import AnyArray
from hhsim.errors import InputError
from hhsim.hand.configuration import HandConfiguration
from hhsim.kernels.tick.block import HapticBlock, TickRecord
from hhsim.replay.stored_scene import result_scene, stored_options
from hhsim.replay.tick_rows import SceneRows
from hhsim.result import schema
from hhsim.result.reader import CHUNK_TICKS, Result
from hhsim.scene.engine_scene import seen_hand
from hhsim.solver.method import METHODS, find_method
from hhsim.solver.solver import OneTick, SceneSolver, bodies_ticks
from hhsim.solver.workspace import of_hands, tick_record, zeroed
from hhsim.system import environment as info
from hhsim.system.deferred_sigint import interruptible_between
from hhsim.system.progress import Progress, silent

TIMINGS = "duration/"
GIVEN = ("time", "input_seq", "haptic/")
"""Columns that are the run's input."""
COMPARED: tuple[schema.Column, ...] = tuple(
    column for column in schema.TICK_COLUMNS if not column.name.startswith((TIMINGS, *GIVEN))
)
"""Columns that a second run computes anew; all but the input and the timings."""
ROUNDING = {
    **dict.fromkeys(("m", "rad", "rad,m", "1"), 1e-12),
    **dict.fromkeys(("N", "N·m", "N,N·m", "m/s", "rad/s", "s"), 1e-9),
    "%": 2e-5,
}
"""Largest difference that counts as rounding, by unit; integers must be equal but for `COUNTERS`.

Processors that fuse or order operations differently differed by 2e-16 m and 2e-13 N. A speed is a difference of poses
over a millisecond; the change of a force in % is that of N over the least force that has one, 0.01 N."""
COUNTERS = "work/"
"""Columns that count how a tick was solved. A last bit may decide on one more step: where nothing but these differs
beyond rounding, the run is the same."""
IDENTICAL, WITHIN, DIFFERENT, PARTLY = "identical", "within rounding", "different", "not all ticks run"
"""Outcomes of a second run."""


class ArrayComparison:
    """One dataset of a result beside that of the second run, compared block by block.

    Its name begins with `prefix`. `bound` is the largest difference that counts as rounding, in `units`: 0 for
    integers, infinite for counters of work. `ticks` is the number of rows that differ: ticks, or contacts of /contact;
    `beyond` of those beyond the bound; `largest` the largest difference, NaN or infinite where one side alone is so;
    `first_tick` is the first that differs, `first_beyond` the first beyond the bound, -1 if none.
    """

    def __init__(self, column: schema.Column, prefix: str = "") -> None:
        self.column, self.name, self.units = column, prefix + column.name, column.units
        exact = np.dtype(column.dtype).kind != "f"
        self.bound = np.inf if column.name.startswith(COUNTERS) else 0.0 if exact else ROUNDING[self.units]
        self.ticks, self.beyond, self.largest = 0, 0, 0.0
        self.first_tick = self.first_beyond = -1
        self._rows = 0

    def add(self, stored: AnyArray, computed: AnyArray, at: AnyArray | None = None) -> None:
        """Compare the next rows; `at` is the tick of each where a row is not a tick."""
        again = np.ascontiguousarray(computed, dtype=self.column.dtype)
        stored, rows = np.ascontiguousarray(stored, dtype=self.column.dtype), len(stored)
        if stored.tobytes() != again.tobytes():
            bits = stored.reshape(rows, -1).view(np.uint8) != again.reshape(rows, -1).view(np.uint8)
            differ = np.flatnonzero(bits.any(axis=1))
            at = np.arange(self._rows, self._rows + rows) if at is None else at
            if self.first_tick < 0:
                self.first_tick = int(at[differ[0]])
            self.ticks += len(differ)
            a, b = (values[differ].astype(np.float64).reshape(len(differ), -1) for values in (stored, again))
            with np.errstate(invalid="ignore"):
                apart = np.where((a == b) | (np.isnan(a) & np.isnan(b)), 0.0, np.abs(a - b)).max(axis=1)
            self.largest = float(np.maximum(self.largest, apart.max()))
            # Written so that NaN is beyond; integers of more than 53 bits may differ though their floats do not.
            beyond = differ[~(apart <= self.bound) | (self.bound == 0.0)]
            self.beyond += len(beyond)
            if self.first_beyond < 0 and beyond.size:
                self.first_beyond = int(at[beyond[0]])
        self._rows += rows

    @property
    def identical(self) -> bool:
        """True if every tick is the same bit for bit."""
        return self.ticks == 0

    @property
    def word(self) -> str:
        """Identical, within rounding, or different."""
        return IDENTICAL if self.identical else WITHIN if self.first_beyond < 0 else DIFFERENT


@dataclass(frozen=True)
class RunAgain:
    """Outcome of a second run."""

    path: Path  # of the result
    complete: bool  # True if the file is whole; otherwise its ticks were run
    ticks: int  # number that was run and compared
    ticks_stored: int  # more than `ticks` where a session lost some, whose successors cannot be run
    arrays: tuple[ArrayComparison, ...]  # all computed arrays
    notes: tuple[str, ...]  # remarks for a reader, a sentence each
    made_elsewhere: bool = False  # True if something differs, as expected of another hhsim or machine

    @property
    def identical(self) -> bool:
        """True if every tick of the file was run, and every array is the same bit for bit."""
        return self.word == IDENTICAL

    @property
    def word(self) -> str:
        """Worst of the arrays' words; "not all ticks run" if those that were run do not differ."""
        words = {array.word for array in self.arrays}
        if DIFFERENT in words:
            return DIFFERENT
        if self.ticks < self.ticks_stored:
            return PARTLY
        return WITHIN if WITHIN in words else IDENTICAL

    @property
    def same(self) -> bool:
        """True if it is identical or within rounding."""
        return self.word in (IDENTICAL, WITHIN)

    @property
    def sentence(self) -> str:
        """Outcome, and where a difference began."""
        if self.word == IDENTICAL:
            return "identical in every tick"
        if self.word == WITHIN:
            return "within rounding: no array differs by more than its bound, and integers but counts of work are equal"
        if self.word == PARTLY:
            return f"not all ticks run: {self.ticks:,} of {self.ticks_stored:,}"
        first = min((array for array in self.arrays if array.word == DIFFERENT), key=lambda array: array.first_beyond)
        begun = min(array.first_tick for array in self.arrays if not array.identical)
        beyond = f"beyond rounding from tick {first.first_beyond:,} on, first {first.name}"
        return f"different: {beyond}; the first bits differ in tick {begun:,}"

    def to_json(self) -> dict[str, Any]:
        """Return all of it as plain values."""
        return {
            "result": str(self.path),
            **{name: getattr(self, name) for name in ("word", "identical", "complete", "ticks", "ticks_stored")},
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


def run_again(result: Result, *, trust: bool = False, progress: Progress | None = None) -> RunAgain:
    """Run all ticks of a result again, complete or not, as the scene and with the options that it holds.

    Of a result of two hands, as `Result.hands` has them, one's arrays are compared, of the result as a whole both's.
    `trust` imports and runs the code of a method that the file names as `package.module:Class`. `progress` is called
    with the stage, how much is done and how much there is. Raises InputError for a body, a tree or a hand that is not
    the run's, for a result without ticks, and for such a method without `trust`.
    """
    shown, hands = [result] if result.name else list(result.hands.values()), list(result.hands.values())
    if result.ticks == 0:
        raise InputError(f"{shown[0].label} holds no ticks: there is nothing to run again")
    options, report = stored_options(result, trust), progress or silent
    runnable = [_runnable(hand) for hand in hands]
    total, notes = min(ticks for ticks, _ in runnable), [note for _, of in runnable for note in of]
    arrays = _arrays(result, shown)
    names = [column.name for column in schema.TICK_COLUMNS]
    of_bodies = [array.name for group, of in arrays.items() if group.startswith(schema.BODIES) for array in of]
    # Hands are given block by block. A body that is fixed, or free, needs no stored poses: the scene may have the
    # first block's ticks alone, since all might not fit in memory.
    needs_no_poses = [body.kind for body in result.bodies.values()] in (["fixed"], ["free"])
    solver = SceneSolver(result_scene(hands, CHUNK_TICKS if needs_no_poses else None), options)
    with interruptible_between() as check_interrupt:
        models = [hand.model for hand in solver.scene.hands]
        rows = SceneRows(solver.seen, models, solver.options, list(result.bodies))
        every = zip(hands[0].blocks(of_bodies), *(hand.blocks(names) for hand in hands))
        # A session's ticks were solved one by one: where the pairs of one did not fit, the loop went on.
        run = solver.solve if hands[0].live is None else partial(_one_by_one, OneTick(solver))
        for first, blocks in zip(range(0, total, CHUNK_TICKS), every):
            report("ticks", first, total)
            bodies, *given = ({name: values[: total - first] for name, values in block.items()} for block in blocks)
            ticks = slice(first, first + len(given[0]["time"]))
            haptic = [
                HandConfiguration(*(block[f"haptic/{name}"] for name in HandConfiguration._fields)) for block in given
            ]
            records = run(*(seen_hand(hand, rows.carried(ticks)) for hand in haptic))
            numbers = [block["input_seq"] for block in given]
            of_hands = [*zip(numbers, haptic, records, strict=True)]
            computed = rows.block(ticks, given[0]["time"], of_hands, solver.all_ticks, first)[1]
            stored = {f"{schema.HANDS}/{hand.side}/{schema.TICK}": block for hand, block in zip(models, given)}
            for group, compared in arrays.items():
                if group == schema.CONTACT:
                    _compare_contacts(result, ticks, computed[group], compared)
                    continue
                for array in compared:
                    values = bodies[array.name] if array.name in bodies else stored[group][array.column.name]
                    array.add(values, computed[group][array.column.name])
            check_interrupt()
    report("ticks", total, total)
    found = [array for of in arrays.values() for array in of]
    counts = [f"{a.name} at {a.ticks:,}" for a in found if a.ticks and a.column.name.startswith(COUNTERS)]
    if counts and not any(array.word == DIFFERENT for array in found):
        notes.append(f"counts of work differ, which makes no run another: of {total:,} ticks {', '.join(counts)}")
    makers: list[str] = []
    if not all(array.identical for array in found):
        makers = other_makers(hands[0])
        outside = "of the method the file of its class alone is compared"
        expected = "the bits should be the same" if result.method in METHODS else outside
        notes += makers or [f"hhsim, packages, processor and system are those of the file: {expected}"]
    shared = tuple(dict.fromkeys(notes))
    return RunAgain(result.path, result.complete, total, result.ticks, tuple(found), shared, bool(makers))


def _one_by_one(one: OneTick, *haptic: HandConfiguration) -> tuple[TickRecord, ...]:
    """Solve ticks as `Solver.solve`, but go on where the pairs of one did not fit."""
    given = HapticBlock(*(np.stack(values) for values in zip(*haptic)))
    count = given.position.shape[1]
    record, rows = tick_record(len(haptic), count), zeroed(one.row.dtype, count)
    for i in range(count):
        for values, of in zip(one.haptic, given):
            values[:, 0] = of[:, i]
        one.solve()
        for written, found in zip(record, one.record):
            written[:, i] = found[:, 0]
        rows[i] = one.row[0]
    one.solver.all_ticks = bodies_ticks(rows) if one.solver.bodies else None
    return tuple(of_hands(record, h) for h in range(len(haptic)))


def _arrays(result: Result, shown: Sequence[Result]) -> dict[str, list[ArrayComparison]]:
    """Return the datasets that a second run gives by their groups: of hands, and of bodies if one is free."""
    tables: dict[str, Sequence[schema.Column]] = {}
    if any(body.is_free for body in result.bodies.values()):
        for body in result.bodies.values():
            made = [column for column in body.columns if column not in schema.DRIVEN_COLUMNS]
            tables[f"{body.group}/{schema.TICK}"] = made
        tables[schema.CONTACT] = schema.CONTACT_COLUMNS
    arrays: dict[str, list[ArrayComparison]] = {}
    for hand in shown:
        prefix = "" if len(shown) == 1 else f"{hand.name}/"
        group = f"{schema.HANDS}/{hand.name}/{schema.TICK}"
        arrays[group] = [ArrayComparison(column, prefix) for column in COMPARED]
    return arrays | {group: [ArrayComparison(column, f"{group}/") for column in of] for group, of in tables.items()}


def _compare_contacts(
    result: Result, ticks: slice, computed: dict[str, AnyArray], arrays: Sequence[ArrayComparison]
) -> None:
    """Count the contacts of some ticks that differ; all of them do where their number differs."""
    first, last = np.searchsorted(result[f"{schema.CONTACT}/tick"], (ticks.start, ticks.stop))
    at, other = result[f"{schema.CONTACT}/tick"][first:last], computed["tick"]
    if len(at) != len(other):
        # From the first tick on that has another number of them.
        many = ticks.stop - ticks.start
        counts = [np.bincount(np.clip(of - ticks.start, 0, many - 1), minlength=many) for of in (at, other)]
        begun = ticks.start + int(np.argmax(counts[0] != counts[1]))
        at = np.full(max(len(at), len(other)), begun)
    for array, again in zip(arrays, computed.values(), strict=True):
        stored = result[array.name][first:last]
        if len(stored) != len(again):
            stored, again = np.zeros(len(at), array.column.dtype), np.ones(len(at))
        if len(at):
            array.add(stored, again, at)


def _runnable(result: Result) -> tuple[int, list[str]]:
    """Number of ticks that can be run again, and notes on the others."""
    notes = [] if result.complete else ["the file is of a run that was stopped: its ticks so far were run again"]
    if result.live is None:
        return result.ticks, notes
    record, period, missed = (result[f"live/tick/{name}"] for name in ("record", "period", "missed"))
    if record[0] != 0:
        raise InputError(f"{result.path} cannot be run again: the recorder lost its first {record[0]:,} ticks")
    gaps = np.flatnonzero(np.diff(record) != 1)
    total = int(gaps[0]) + 1 if gaps.size else result.ticks
    if gaps.size:
        lost = int(record[total] - record[total - 1] - 1)
        gap = f"the recorder lost {lost:,} ticks after tick {total - 1:,}"
        notes.append(f"{gap}: what followed on them cannot be run again, and was not compared")
    unsolved = int(np.sum(np.diff(period[:total]) - 1 - missed[1:total]))
    if unsolved:
        failed = "ticks whose solver failed, and that are not in the file"
        notes.append(f"{failed}: {unsolved:,}; what follows on them may differ")
    return total, notes


def other_makers(result: Result) -> list[str]:
    """Return how hhsim, method and machine differ from those of the file, a text each: other bits are then expected."""
    version, machine, packages = __version__, info.machine(), info.package_versions()
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
