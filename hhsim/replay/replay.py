"""Main loop: run a hand through a motion in compiled blocks; measure and write each one outside of the timed ticks.

Two hands keep out of each other. On an object that stands still or moves as recorded each hand's ticks are those that
it has alone, side by side on two threads, where the hands cannot meet. Elsewhere, and with a free object, both have
one program.
"""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from hhsim.arrays import AnyArray, FloatArray
from hhsim.errors import HhsimError, InputError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.forward_kinematics import PlacedHand, forward_kinematics
from hhsim.kernels.free.record import ObjectRecord
from hhsim.kernels.tick.block import TickRecord
from hhsim.metrics.metrics import distance_of_hands
from hhsim.metrics.run.registry import needed_columns, run_metrics
from hhsim.replay.moving_object import part_rows, scene_frames, stored_contacts, thing_rows
from hhsim.replay.stored_scene import describe_scene, hand_arrays, one_body, several_bodies
from hhsim.replay.summary import GRAPHIC_HAND, ReplaySummary, summarise
from hhsim.replay.tick_columns import KeptColumns, TickColumns
from hhsim.result.reader import CHUNK_TICKS
from hhsim.result.schema import (
    BETWEEN_COLUMNS,
    BODIES,
    CONTACT,
    CONTACT_COLUMNS,
    FRAME,
    FREE_COLUMNS,
    HANDS,
    HANDS_APART,
    MOTION_COLUMNS,
    OF_BODIES,
    POSE_COLUMNS,
    SIDES,
    TICK,
    hand_tables,
)
from hhsim.result.writer import BodyPart, HandPart, ResultWriter
from hhsim.scene.free_object import FreeObject
from hhsim.scene.motion_catalogue import of_the_paper
from hhsim.scene.scene import Scene
from hhsim.solver.free_engine import Thing
from hhsim.solver.hand_solver import HandSolver, warm_up
from hhsim.solver.known_methods import find_method
from hhsim.solver.linearising_engine import require_jointed
from hhsim.solver.method import METHODS, Method
from hhsim.solver.options import SolverOptions
from hhsim.solver.two_hands import SideBySideSolver, TwoHandedSolver, keeps_hands_apart
from hhsim.system.deferred_sigint import interruptible_between
from hhsim.system.progress import Progress, silent
from hhsim.trees.contact_surface import contact_surface


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
    run, report = Replay([scene], options, description), progress or silent
    with run.writer(Path(output_path), command):
        if before_ticks is not None:
            before_ticks()
        run.go(report)
        (summary,) = run.finish()
        return summary


class HandRun:
    """Run of one hand: its solver, and what is written of each block of ticks.

    `alone` is False for one of two hands that move a free object together: `solver` then only places the hand.
    """

    def __init__(self, scene: Scene, options: SolverOptions, described: Mapping[str, Any], *, alone: bool) -> None:
        self.scene = scene
        self._options, free, parts = options.at_rate(scene.ticks.rate), scene.free, scene.parts
        kind = self._options.surface
        jointed = parts if not scene.others else None
        if jointed is not None and not find_method(self._options.method).beside_parts:
            require_jointed(self._options)
        moved_alone = free if alone else None
        kinds: dict[str, Any] = {"jointed": jointed is not None, "others": len(scene.others)}
        self._prepared = warm_up(scene.hand, self._options, moved_alone, **kinds)
        self._surface = contact_surface(kind, scene.mesh, scene.tree) if jointed is None else jointed.surface(kind)
        self.others = [
            Thing(contact_surface(kind, other.mesh, other.tree), other.free, other.fixed, other.name, driven)
            for other in scene.others
            for driven in [parts.driven.get(other.name) if parts else None]
        ]
        self.solver = HandSolver(scene.hand, self._surface, self._options, moved_alone, self.others)
        self.engine: Any = self.solver.engine
        self.object_ticks: Callable[[], ObjectRecord] = lambda: self.solver.object_ticks
        motion, self.bodies = scene.trajectory, scene_bodies(scene)
        self.described = {
            **scene.description,
            **described,
            "rate": scene.ticks.rate,
            "motion": motion.name,
            "motion_source": motion.source,
            **_of_outside_method(self._options.method, self.solver.method),
            **describe_scene(scene.mesh, scene.tree, scene.hand, self._options, self.bodies, free),
        }
        self._series = KeptColumns((*needed_columns(), *GRAPHIC_HAND))
        of_body = (*POSE_COLUMNS, *MOTION_COLUMNS, *FREE_COLUMNS, *((OF_BODIES,) if scene.others else ()))
        self._body = KeptColumns(column.name for column in (of_body if free else ()))
        of_contacts = ("body", *(column.name for column in CONTACT_COLUMNS if column.name not in ("a", "b")))
        self._contacts = KeptColumns(of_contacts if free else ())
        self._columns = TickColumns(self._surface.arrays, scene.hand, self._options, parts)
        self._frame_of = scene_frames(scene, lambda: self.object_ticks())
        self.haptic = HandConfiguration.of(scene.ticks)

    @property
    def part(self) -> HandPart:
        """Hand of the run's file."""
        return HandPart(self.described, hand_arrays(self.scene.hand))

    def rows(self, ticks: slice, record: TickRecord, hands: int) -> dict[str, dict[str, AnyArray]]:
        """Return the rows of the file of ticks that were solved last, world, of a file of one hand or two."""
        if not np.isfinite(record.joints).all():
            raise HhsimError(f"the graphic hand is not finite after tick {ticks.start}: please report the command")
        given, frame, parts = self.scene.ticks, self._frame_of(ticks), self.scene.parts
        own = frame.body()
        if parts is None:
            (name,) = self.bodies
            of_bodies = {f"{BODIES}/{name}/{TICK}": own}
        elif self.others:
            of_bodies = thing_rows(parts, self.engine.all_ticks, ticks, own)
            own = of_bodies[f"{BODIES}/{parts.names[0]}/{TICK}"]
        else:
            of_bodies = part_rows(parts, ticks, own)
        block = self._columns.block(given.time[ticks], given.input_seq[ticks], frame.haptic, record)
        contacts = frame.contacts(ticks.start)
        self._body.keep(own)
        self._contacts.keep(contacts)
        self._series.keep(block)
        tables = hand_tables(self.scene.hand.side, frame.world(block))
        tables[TICK] |= of_bodies.pop(TICK, {})
        return {**tables, **of_bodies, CONTACT: stored_contacts(contacts, hands)}

    def summary(self) -> ReplaySummary:
        """Compute the table."""
        shown, apart = of_the_paper(self.described), bool(self.described.get(HANDS_APART))
        kept = self._series, self._prepared, self._body, self._contacts
        return summarise(self.scene, self._surface, self._options, *kept, of_paper=shown, hands_apart=apart)


def scene_bodies(scene: Scene) -> dict[str, BodyPart]:
    """Return the bodies of a scene's file by their names."""
    parts, free = scene.parts, scene.free
    if parts is None:
        pose = scene.trajectory.object_position, scene.trajectory.object_orientation
        return one_body(scene.mesh, scene.tree, *pose, driven=scene.driven is not None, free=free)
    others = [] if free is None else [(free, False), *((one.free, one.fixed) for one in scene.others)]
    return several_bodies(parts, others)


class Replay:
    """Run of one hand, or of the right and the left one, and its file; arguments as of `replay_scene`."""

    def __init__(
        self, scenes: Sequence[Scene], options: SolverOptions, description: Mapping[str, Any] | None = None
    ) -> None:
        if not isinstance(options, SolverOptions):
            raise InputError(f"options: expected SolverOptions, found {options!r}")
        self.free, described = scenes[0].free, dict(description or {})
        if len(scenes) > 1:
            described[HANDS_APART] = self.keeps_apart = self.free is not None or keeps_hands_apart(options)
        self.total = scenes[0].ticks.tick_count
        alone = self.free is None or len(scenes) == 1
        self.runs = [HandRun(scene, options, described, alone=alone) for scene in scenes]
        self._models, self.graphic = [scene.hand for scene in scenes], list[FloatArray]()
        self.duration = list[AnyArray]()

    def writer(self, path: Path, command: Sequence[str]) -> ResultWriter:
        """Return the writer of the run's file, to be entered before the first tick."""
        scenes = [run.scene for run in self.runs]
        self.haptic = distance_of_hands(self._models, _haptic_hands(scenes)) if len(scenes) > 1 else np.zeros(0)
        carried = scenes[0].parts is not None and scenes[0].driven is not None
        frame = [replace(column, name=f"{FRAME.partition('/')[2]}/{column.name}") for column in POSE_COLUMNS]
        self._writer = ResultWriter(
            path,
            hands={run.scene.hand.side: run.part for run in self.runs},
            bodies=self.runs[0].bodies,
            columns=(*(BETWEEN_COLUMNS if len(scenes) > 1 else ()), *(frame if carried else ())),
            phases=scenes[0].ticks.phases,
            command=command,
        )
        return self._writer

    def go(self, progress: Progress) -> None:
        """Solve and write all ticks."""
        with ExitStack() as stack:
            solver = self._solver(stack)
            check_interrupt = stack.enter_context(interruptible_between())
            for first in range(0, self.total, CHUNK_TICKS):
                progress("ticks", first, self.total)
                ticks = slice(first, min(first + CHUNK_TICKS, self.total))
                records = solver(*(run.haptic.at(ticks) for run in self.runs))
                self._write(ticks, records)
                check_interrupt()
            progress("ticks", self.total, self.total)

    def _solver(self, stack: ExitStack) -> Callable[..., Sequence[TickRecord]]:
        solvers = [run.solver for run in self.runs]
        if len(solvers) == 1:
            return lambda haptic: [solvers[0].run(*haptic)]
        if self.free is not None:
            return _together(self.runs, self.free).run
        # Each hand on a thread of its own where they cannot meet.
        return SideBySideSolver(solvers, stack.enter_context(ThreadPoolExecutor(len(solvers)))).run

    def _write(self, ticks: slice, records: Sequence[TickRecord]) -> None:
        """Write the ticks that were solved last: what both hands say of bodies and contacts once."""
        of_hands = [run.rows(ticks, record, len(self.runs)) for run, record in zip(self.runs, records)]
        tables = {group: rows for tables in reversed(of_hands) for group, rows in tables.items()}
        if len(of_hands) > 1:
            placed = [
                PlacedHand(*(of[f"graphic/{name}"] for name in ("joints", "position", "orientation")))
                for of in (tables[f"{HANDS}/{run.scene.hand.side}/{TICK}"] for run in self.runs)
            ]
            self.graphic.append(distance_of_hands(self._models, placed))
            self.duration.append(np.maximum(*(record.duration_total for record in records)))
            between = self.haptic[ticks], self.graphic[-1]
            tables[TICK] |= {column.name: values for column, values in zip(BETWEEN_COLUMNS, between, strict=True)}
        self._writer.append(tables)

    def finish(self) -> tuple[ReplaySummary, ...]:
        """Compute the tables, write them, and complete the file."""
        summaries = {run.scene.hand.side: run.summary() for run in self.runs}
        of_hands = {side: summary.attributes() for side, summary in summaries.items()}
        shared = {name: value for of in of_hands.values() for name, value in of.items() if not _is_of_hand(name)}
        own: dict[str, dict[str, float | int]] = {}
        for side, of in of_hands.items():
            own[side] = {name: value for name, value in of.items() if name not in shared}
        path = self._writer.finish(own, shared)
        return tuple(replace(summary, path=path) for summary in summaries.values())


def _is_of_hand(figure: str) -> bool:
    """Return False for the number of ticks, and for a figure of a body."""
    return figure in run_metrics() and not run_metrics()[figure].of_body


def _haptic_hands(scenes: Sequence[Scene]) -> list[PlacedHand]:
    return [forward_kinematics(scene.hand, *HandConfiguration.of(scene.driven or scene.ticks)) for scene in scenes]


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
    scenes: Sequence[Scene],
    options: SolverOptions,
    output_path: str | Path,
    *,
    command: Sequence[str] = (),
    progress: Progress = silent,
) -> TwoHandedReplay:
    """Replay the scenes of the right and the left hand, which have the object and its motion in common.

    Other arguments and errors are those of `hhsim.replay.replay.replay_scene`; raises InputError, too, for scenes not
    of one object and time.
    """
    _check(scenes)
    run = Replay(scenes, options)
    with run.writer(Path(output_path), command) as writer:
        run.go(progress)
        right, left = run.finish()
    times = 1e-9 * np.concatenate(run.duration)
    p50, p99 = (float(np.quantile(times, share)) for share in (0.5, 0.99))
    haptic_distance, graphic_distance = (float(np.min(values)) for values in (run.haptic, np.concatenate(run.graphic)))
    both = (right, left), p50, p99, haptic_distance, graphic_distance
    return TwoHandedReplay(writer.path, *both, together=run.free is not None, keeps_apart=run.keeps_apart)


def _together(runs: Sequence[HandRun], free: FreeObject) -> TwoHandedSolver:
    """Return what runs the next ticks of both hands and of the free object, by one program."""
    solver = TwoHandedSolver([run.solver for run in runs], free, runs[0].others)
    for hand, run in enumerate(runs):
        run.engine = solver.engine
        run.object_ticks = partial(solver.object_ticks, hand)
    return solver


def _check(scenes: Sequence[Scene]) -> None:
    right, left = scenes
    if [scene.hand.side for scene in scenes] != list(SIDES):
        raise InputError(f"hands {right.hand.side} and {left.hand.side}: expected {' and '.join(SIDES)}")
    same: Mapping[str, bool] = {
        "object": np.array_equal(right.mesh.vertices, left.mesh.vertices),
        "number of ticks": right.ticks.tick_count == left.ticks.tick_count,
        "motion of the object": (right.driven is None) == (left.driven is None) and right.free == left.free,
    }
    for what, equal in same.items():
        if not equal:
            raise InputError(f"the two hands' recordings have not the same {what}")
