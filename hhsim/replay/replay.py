"""Main loop: solve a scene's ticks in compiled blocks; between blocks, measure and write them.

Two hands keep out of each other beside a free object, and elsewhere with methods that can (`keeps_hands_apart`).
Without a free object each hand is solved as if it were alone in ticks in which the hands cannot meet. All other ticks
of two such hands, and all beside a free object, are one program of both.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from hhsim.arrays import AnyArray
from hhsim.errors import HhsimError, InputError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import SIDES
from hhsim.kernels.tick.block import TickRecord
from hhsim.metrics.run.registry import run_metrics
from hhsim.replay.stored_scene import body_parts, hand_arrays
from hhsim.replay.summary import HandRun, ReplaySummary
from hhsim.replay.tick_rows import KeptColumns, SceneRows
from hhsim.result import schema
from hhsim.result.reader import CHUNK_TICKS
from hhsim.result.writer import HandPart, ResultWriter
from hhsim.scene.scene import Scene
from hhsim.solver.options import SolverOptions
from hhsim.solver.solver import SceneSolver, keeps_hands_apart
from hhsim.system.deferred_sigint import interruptible_between
from hhsim.system.progress import Progress, silent


def replay_scene(
    scene: Scene,
    options: SolverOptions,
    output_path: str | Path,
    *,
    description: Mapping[str, Any] | None = None,
    command: Sequence[str] = (),
    progress: Progress | None = None,
) -> ReplaySummary:
    """Replay a scene of one hand (of two: `Replay`), write a result file, and return the table's figures.

    An existing file is replaced when the new one is complete. `description` is further description as plain values,
    over the scene's own; `command` the command line for the file to record, empty in a program. `progress` is called
    with the stage, how much is done and how much there is.

    Raises InputError for invalid options, or a method that lacks what it needs, OutputError where the file cannot be
    written, and HhsimError where more pairs were near than the solver holds.
    """
    if not isinstance(options, SolverOptions):
        raise InputError(f"options: expected SolverOptions, found {options!r}")
    return Replay(SceneSolver(scene, options), description).into(Path(output_path), command, progress)[0]


class Replay:
    """Run of all hands of a scene, and its file; arguments and errors are those of `replay_scene`."""

    def __init__(self, solver: SceneSolver, description: Mapping[str, Any] | None = None) -> None:
        scene, described = solver.scene, dict(description or {})
        self.solver, self._together = solver, solver.seen.free is not None
        if len(scene.hands) > 1:
            described[schema.HANDS_APART] = self._keeps_apart = self._together or keeps_hands_apart(solver.options)
        self.bodies = body_parts(scene, solver.seen)
        self.runs = [HandRun(solver, hand, self.bodies, described) for hand in range(len(scene.hands))]
        self._rows = SceneRows(solver.seen, [run.model for run in self.runs], solver.options, list(self.bodies))
        self._between, self._durations = KeptColumns(column.name for column in schema.BETWEEN_COLUMNS), list[AnyArray]()

    def into(
        self, path: Path, command: Sequence[str] = (), progress: Progress | None = None
    ) -> tuple[ReplaySummary, ...]:
        """Solve all ticks, write the file, and return the table of each hand."""
        scene, seen, both, report = self.solver.scene, self.solver.seen, len(self.runs) > 1, progress or silent
        total = scene.ticks.tick_count
        carried = seen.parts is not None and seen.carrier is not None
        frame = [
            replace(column, name=f"{schema.FRAME.partition('/')[2]}/{column.name}") for column in schema.POSE_COLUMNS
        ]
        with ResultWriter(
            path,
            hands={run.model.side: HandPart(run.described, hand_arrays(run.model)) for run in self.runs},
            bodies=self.bodies,
            columns=(*(schema.BETWEEN_COLUMNS if both else ()), *(frame if carried else ())),
            phases=scene.ticks.phases,
            command=command,
        ) as writer:
            with interruptible_between() as check_interrupt:
                for first in range(0, total, CHUNK_TICKS):
                    report("ticks", first, total)
                    ticks = slice(first, min(first + CHUNK_TICKS, total))
                    writer.append(self._tables(ticks, self.solver.solve(*(hand.at(ticks) for hand in seen.haptic))))
                    check_interrupt()
                report("ticks", total, total)
            return self._finish(writer)

    def _tables(self, ticks: slice, records: Sequence[TickRecord]) -> dict[str, dict[str, AnyArray]]:
        """Return the rows of the ticks that were solved last, and keep what the figures need of them."""
        if not all(np.isfinite(record.joints).all() for record in records):
            raise HhsimError(f"the graphic hand is not finite after tick {ticks.start}: please report the command")
        own = [run.ticks for run in self.runs]
        given = [(of.input_seq[ticks], HandConfiguration.of(of).at(ticks), record) for of, record in zip(own, records)]
        seen, tables = self._rows.block(ticks, own[0].time[ticks], given, self.solver.all_ticks, ticks.start)
        for run, columns in zip(self.runs, seen):
            run.keep(columns, tables)
        if len(records) > 1:
            self._between.keep(tables[schema.TICK])
            self._durations.append(np.maximum(*(record.duration_total for record in records)))
        return tables

    def _finish(self, writer: ResultWriter) -> tuple[ReplaySummary, ...]:
        """Compute the tables, write them, and complete the file."""
        summaries = {run.model.side: run.summary(of) for run, of in zip(self.runs, self._rows.touched)}
        of_hands = {side: summary.attributes() for side, summary in summaries.items()}
        shared = {name: value for of in of_hands.values() for name, value in of.items() if not _is_of_hand(name)}
        own: dict[str, dict[str, float | int]] = {
            side: {name: value for name, value in of.items() if _is_of_hand(name)} for side, of in of_hands.items()
        }
        path = writer.finish(own, shared)
        self.hands = tuple(replace(summary, path=path) for summary in summaries.values())
        return self.hands

    @cached_property
    def of_both(self) -> dict[str, float]:
        """Figures of two hands that have been run.

        Times of a tick of both, side by side the longer one's [s], and least distances of the haptic and of the graphic
        hands from each other [m], negative where one is in the other.
        """
        times = 1e-9 * np.concatenate(self._durations)
        p50, p99 = (float(np.quantile(times, share)) for share in (0.5, 0.99))
        haptic, graphic = (float(np.min(self._between[column.name])) for column in schema.BETWEEN_COLUMNS)
        return {"tick_p50": p50, "tick_p99": p99, "haptic_distance": haptic, "graphic_distance": graphic}

    @property
    def note(self) -> str:
        """Sentence on two hands together."""
        p50, p99, haptic, graphic = self.of_both.values()
        how = "in one program" if self._together else "side by side"
        met = f"; the haptic hands enter each other by {-1e3 * haptic:.2g} mm"
        if self._keeps_apart:
            met += f", the graphic ones by {1e3 * max(0.0, -graphic):.2g} mm"
        return (
            f"a tick of both hands, {how}: p50 {1e6 * p50:.3g} µs, p99 {1e6 * p99:.3g} µs; the graphic hands come "
            f"within {1e3 * graphic:.3g} mm of each other{met if haptic < 0.0 else ''}"
        )

    def to_json(self) -> dict[str, Any]:
        """Return the outcome of two hands as plain values, SI."""
        hands = {side: one.to_json() for side, one in zip(SIDES, self.hands)}
        return {"result": str(self.hands[0].path), "hands": hands, **self.of_both}


def _is_of_hand(figure: str) -> bool:
    """Return True for a figure of one hand; the number of ticks and figures of bodies are of all hands."""
    return figure in run_metrics() and not run_metrics()[figure].of_body
