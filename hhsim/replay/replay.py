"""Main loop: run a hand through a motion in compiled blocks; measure and write each one outside of the timed ticks.

Two hands keep out of each other. On an object that stands still or moves as recorded each hand's ticks are those that
it has alone, side by side on two threads, where the hands cannot meet. Elsewhere, and with a free object, both have
one program.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from hhsim.arrays import AnyArray, FloatArray
from hhsim.errors import HhsimError, InputError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.forward_kinematics import PlacedHand, forward_kinematics
from hhsim.kernels.tick.block import TickRecord
from hhsim.metrics.metrics import distance_of_hands
from hhsim.metrics.run.registry import needed_columns
from hhsim.replay.moving_object import part_rows, scene_frames, thing_rows
from hhsim.replay.stored_scene import describe_scene, part_arrays, part_tables, static_arrays
from hhsim.replay.summary import GRAPHIC_HAND, ReplaySummary, summarise
from hhsim.replay.tick_columns import KeptColumns, TickColumns
from hhsim.result.reader import CHUNK_TICKS, check_result_path
from hhsim.result.schema import CONTACT, CONTACT_COLUMNS, FREE_COLUMNS, HANDS_APART, OBJECT_COLUMNS, SIDES, TWO_HANDED
from hhsim.result.two_handed_file import BETWEEN_COLUMNS, join_hands, partial_of
from hhsim.result.writer import ResultWriter
from hhsim.scene.motion_catalogue import of_the_paper
from hhsim.scene.scene import Scene
from hhsim.solver.method import METHODS, Method
from hhsim.solver.options import SolverOptions
from hhsim.solver.scene_solver import SceneSolver
from hhsim.solver.two_hands import keeps_hands_apart
from hhsim.system.deferred_sigint import interruptible_between
from hhsim.system.output_path import free_name
from hhsim.system.progress import Progress, silent

OF_FREE_OBJECT = (
    *(column.name for column in (*OBJECT_COLUMNS, *FREE_COLUMNS)),
    *(f"{CONTACT}/{column.name}" for column in CONTACT_COLUMNS),
)
"""Datasets of a free object that the table needs."""


def replay_scene(
    scene: Scene,
    options: SolverOptions,
    output_path: str | Path,
    *,
    description: Mapping[str, Any] | None = None,
    command: Sequence[str] = (),
    before_ticks: Callable[[], None] | None = None,
    progress: Progress | None = None,
) -> ReplaySummary:
    """Replay the scene's motion, write a result file, and return the figures of the table.

    An existing file is replaced when the new one is complete. `description` is further description as plain values,
    over the scene's own; `command` the command line for the file to record, empty in a program. `before_ticks` is
    called once before the first tick: the place to wait for disturbances to end; `progress` with the stage, how much is
    done and how much there is.

    Raises InputError for invalid options, or a method that lacks what it needs, OutputError where the file cannot be
    written, and HhsimError where more pairs were near than the solver holds.
    """
    solver, report = SceneSolver(scene, _checked(options)), progress or silent
    run = Replay(solver, description)
    with run.writer(Path(output_path), command):
        if before_ticks is not None:
            before_ticks()
        with interruptible_between() as check_interrupt:
            for part in run.blocks():
                report("ticks", part.start, run.total)
                run.write(part, run.judged(part, *solver.run(part)))
                check_interrupt()
        report("ticks", run.total, run.total)
        return run.finish()


def _checked(options: SolverOptions) -> SolverOptions:
    if not isinstance(options, SolverOptions):
        raise InputError(f"options: expected SolverOptions, found {options!r}")
    return options


class Replay:
    """Result of one hand of a run, block by block; `hand` is its number, `description` as of `replay_scene`."""

    def __init__(self, solver: SceneSolver, description: Mapping[str, Any] | None = None, hand: int = 0) -> None:
        scene, seen, options = solver.scene, solver.seen, solver.options
        self.solver, self.hand, self.total = solver, hand, scene.ticks.tick_count
        model, motion, parts = scene.hands[hand].model, scene.hands[hand].trajectory, seen.parts
        self._static = static_arrays(seen.mesh, seen.tree, model, *seen.place)
        self._parts = part_arrays(parts)
        of_parts = {f"{part}/{name}": array for part, its in self._parts.items() for name, array in its.items()}
        self._described = {
            **scene.description,
            **(description or {}),
            "rate": scene.ticks.rate,
            "motion": motion.name,
            "motion_source": motion.source,
            **_of_outside_method(options.method, solver.hands[hand].method),
            **describe_scene(seen.mesh, seen.tree, model, options, self._static | of_parts, seen.free),
            **({} if parts is None else {"thing": {"name": parts.name, "parts": list(parts.names)}}),
            **(
                {"others": [{"fixed": fixed, **free.to_json()} for free, fixed, _ in seen.others]}
                if seen.others
                else {}
            ),
        }
        self._series = KeptColumns((*needed_columns(), *GRAPHIC_HAND))
        self._kept = KeptColumns(OF_FREE_OBJECT if seen.free else ())
        self._columns = TickColumns(solver.surfaces[hand].arrays, model, options, parts)
        given = HandConfiguration.of(scene.hands[hand].ticks)
        self._frame_of = scene_frames(seen, given, lambda: solver.object_ticks(hand))

    def writer(self, path: Path, command: Sequence[str]) -> ResultWriter:
        """Return the writer of the run's file, to be entered before the first tick."""
        seen, phases = self.solver.seen, self.solver.scene.ticks.phases
        moves: dict[str, Any] = {"driven": seen.carrier is not None, "free": seen.free is not None}
        if seen.parts is not None:
            moves |= {"tables": part_tables(seen.parts), "parts": self._parts}
        about: dict[str, Any] = {"scene": self._described, "static": self._static, "phases": phases}
        self._writer = ResultWriter(path, **about, command=command, **moves)
        return self._writer

    def blocks(self) -> Iterator[slice]:
        """Yield the blocks of ticks in their order."""
        for first in range(0, self.total, CHUNK_TICKS):
            yield slice(first, min(first + CHUNK_TICKS, self.total))

    @staticmethod
    def judged(part: slice, record: TickRecord) -> TickRecord:
        """Return the record of some ticks; HhsimError if the graphic hand is not finite."""
        if not np.isfinite(record.joints).all():
            raise HhsimError(f"the graphic hand is not finite after tick {part.start}: please report the command")
        return record

    def write(self, part: slice, record: TickRecord) -> dict[str, AnyArray]:
        """Write the ticks that were solved last; returns their columns, world."""
        ticks, frame, parts = self.solver.scene.hands[self.hand].ticks, self._frame_of(part), self.solver.seen.parts
        many = self.solver.all_ticks
        rows = part_rows(parts, part) if many is None or parts is None else thing_rows(parts, many, part)
        block = self._columns.block(ticks.time[part], ticks.input_seq[part], frame.haptic, record)
        whole, contacts = frame.world(block), frame.contacts(part.start)
        self._writer.append(whole, {CONTACT: contacts, **rows})
        self._kept.keep(whole | {f"{CONTACT}/{name}": rows for name, rows in contacts.items()})
        self._series.keep(block)
        return whole

    def finish(self) -> ReplaySummary:
        """Compute the table, write it, and complete the file."""
        shown = of_the_paper(self._described)
        apart = bool(self._described.get(HANDS_APART))
        kept = self._series, self._kept
        summary = summarise(self.solver, *kept, hand=self.hand, of_paper=shown, hands_apart=apart)
        path = self._writer.finish(summary.attributes())
        return replace(summary, path=path)


def _of_outside_method(name: str, method: Method) -> dict[str, Any]:
    if name in METHODS:
        return {}
    known = {"gives": sorted(method.gives), "promises": sorted(method.promises)}
    return {**known, "method_source": method.source} if method.source else known


@dataclass(frozen=True)
class TwoHandedReplay:
    """Outcome of a replay of two hands."""

    path: Path  # result file of both
    hands: tuple[ReplaySummary, ReplaySummary]  # tables of the right and of the left hand
    tick_p50: float  # time of a tick of both, side by side the longer one's [s]
    tick_p99: float
    haptic_distance: float  # least distance between the haptic hands [m], negative where one is in the other
    graphic_distance: float  # the same between the graphic hands
    together: bool = False  # True if both have one program, with a free object
    keeps_apart: bool = False  # True if the graphic hands keep out of each other

    @property
    def note(self) -> str:
        """Sentence on both hands together."""
        nearest = f"{1e3 * self.graphic_distance:.3g} mm"
        how = "in one program" if self.together else "side by side"
        met = f"; the haptic hands enter each other by {-1e3 * self.haptic_distance:.2g} mm"
        if self.keeps_apart:
            met += f", the graphic ones by {1e3 * max(0.0, -self.graphic_distance):.2g} mm"
        return (
            f"a tick of both hands, {how}: p50 {1e6 * self.tick_p50:.3g} µs, p99 {1e6 * self.tick_p99:.3g} µs; "
            f"the graphic hands come within {nearest} of each other{met if self.haptic_distance < 0.0 else ''}"
        )

    def to_json(self) -> dict[str, Any]:
        """Return plain values, SI."""
        hands = {side: one.to_json() for side, one in zip(SIDES, self.hands)}
        names = ("tick_p50", "tick_p99", "haptic_distance", "graphic_distance")
        return {"result": str(self.path), "hands": hands, **{name: getattr(self, name) for name in names}}


def replay_two_hands(
    scene: Scene,
    options: SolverOptions,
    output_path: str | Path,
    *,
    command: Sequence[str] = (),
    progress: Progress = silent,
) -> TwoHandedReplay:
    """Replay a scene of two hands.

    Until both are complete, each hand has a result file of its own beside `output_path`. Other arguments and errors are
    those of `hhsim.replay.replay.replay_scene`; raises InputError, too, for a scene of one hand.
    """
    if len(scene.hands) != len(SIDES):
        raise InputError(f"{scene!r}: expected {' and '.join(SIDES)} hand")
    path = Path(output_path)
    check_result_path(path)
    with ExitStack() as stack:
        solver = stack.enter_context(SceneSolver(scene, _checked(options)))
        together = solver.seen.free is not None
        keeps_apart = together or keeps_hands_apart(options)
        described = {TWO_HANDED: True, HANDS_APART: keeps_apart}
        runs = [Replay(solver, described, hand) for hand in range(len(scene.hands))]
        parts = [free_name(partial_of(path, side)) for side in SIDES]
        models, graphic = [hand.model for hand in scene.hands], list[FloatArray]()
        duration: list[AnyArray] = []
        for run, own in zip(runs, parts):
            stack.enter_context(run.writer(own, command))
        check_interrupt = stack.enter_context(interruptible_between())
        for part in runs[0].blocks():
            progress("ticks", part.start, runs[0].total)
            records = [run.judged(part, each) for run, each in zip(runs, solver.run(part))]
            blocks = [run.write(part, record) for run, record in zip(runs, records)]
            placed = [
                PlacedHand(*(block[f"graphic/{name}"] for name in ("joints", "position", "orientation")))
                for block in blocks
            ]
            graphic.append(distance_of_hands(models, placed))
            duration.append(np.maximum(*(record.duration_total for record in records)))
            check_interrupt()
        progress("ticks", runs[0].total, runs[0].total)
        hands = tuple(run.finish() for run in runs)
    haptic = [forward_kinematics(hand.model, *HandConfiguration.of(hand.ticks)) for hand in scene.hands]
    distances = (distance_of_hands(models, haptic), np.concatenate(graphic))
    join_hands(parts, dict(zip((column.name for column in BETWEEN_COLUMNS), distances)), path)
    times = 1e-9 * np.concatenate(duration)
    p50, p99 = (float(np.quantile(times, share)) for share in (0.5, 0.99))
    haptic_distance, graphic_distance = (float(np.min(values)) for values in distances)
    both = (hands[0], hands[1]), p50, p99, haptic_distance, graphic_distance
    return TwoHandedReplay(path, *both, together=together, keeps_apart=keeps_apart)
