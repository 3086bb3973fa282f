"""Figures of a replay: the table that `hhsim replay` prints, with the paper's figures beside.

Some figures need further runs of the solver (trembling hold, reference optimum); times may be of repeated runs.

With frozen input the force must come to rest, which shows limit cycles but not what a user feels. The paper's 0.18 %
was measured on a live hold, so a hold with frozen input is run once more with seeded physiological tremor.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from statistics import mean, stdev
from typing import Any

import numpy as np

from hhsim import __version__
from hhsim.arrays import BoolArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.kernels.tick.block import TickRecord
from hhsim.kernels.tick.state import STATUS_INPUT_INVALID, STATUS_NO_PLACE, STATUS_START_INSIDE
from hhsim.metrics import metrics
from hhsim.metrics.mesh_penetration import MOST_CONTACT_ERROR
from hhsim.metrics.metrics import force_variation_rate, statistics
from hhsim.metrics.moving_parts import MovingParts, TouchedObject
from hhsim.metrics.run.force import TREMBLING
from hhsim.metrics.run.registry import known_figures, needed_columns, run_metrics, tick_figures
from hhsim.metrics.run_ticks import FreeRun, RunTicks
from hhsim.motion.trajectory import RigidMotion
from hhsim.motion.tremor import Disturbance
from hhsim.replay.reference import reference_excess
from hhsim.replay.stored_scene import STILL, describe_scene
from hhsim.replay.summary_table import SummaryRow, summary_rows
from hhsim.replay.tick_rows import Columns, KeptColumns
from hhsim.replay.verdict import Verdict, run_verdict
from hhsim.result.body import Body, Contacts
from hhsim.result.schema import BODIES, CONTACT, HANDS_APART, TICK
from hhsim.scene.motion_catalogue import of_the_paper
from hhsim.scene.scene import all_pairs
from hhsim.solver.method import FORCES, METHODS, PROMISES, RUNS
from hhsim.solver.options import SolverOptions
from hhsim.solver.solver import HandSolver, SceneSolver, WarmUp
from hhsim.system.counted import counted
from hhsim.trees.options import MOST_LEVEL

TREMOR = Disturbance(tremor_position=1e-4, tremor_rotation=math.radians(0.2), tremor_frequency=10.0)
"""0.1 mm and 0.2° at 10 Hz: physiological tremor of the hand is 8 to 12 Hz and 0.05 to 0.1 mm."""
ONSET = 0.1
"""First period of the tremor [s], left out: its onset is a jump."""
REFERENCE_TICKS = 16
"""Number of ticks of the hold at which the reference optimum is computed."""
HELD_OFF = 1e-6
"""Distance [m] of a driven body from its recorded place that the table tells."""

GRAPHIC_HAND = ("graphic/position", "graphic/orientation", "graphic/flexion", "graphic/abduction")
"""Datasets from which figures of further runs start."""
MORE_DIGITS = 2
"""Digits that a deviation may add to the table's tenths of a µs: a tick's time is whole nanoseconds."""


def trembling_hold(
    hand: HandModel,
    surface: Any,
    options: SolverOptions,
    haptic: HandConfiguration,
    graphic: HandConfiguration,
    rate: float,
    seed: int = 0,
    disturbance: Disturbance = TREMOR,
    sample_rate: float | None = None,
) -> tuple[TickRecord, BoolArray]:
    """Repeat a hold with a trembling hand; return its ticks, and True for those after the onset, shape (T,).

    The surface is as `HandSolver` takes it, world. `haptic` and `graphic` are the hands at each tick of the hold,
    `rate` its ticks per second [Hz]; the repetition starts from the first graphic hand. The device measures
    `sample_rate` samples per second [Hz], each held; None for a sample every tick.
    """
    time = np.arange(len(haptic.position)) / rate
    sample = np.arange(len(time)) if sample_rate is None else np.floor(time * sample_rate + 1e-9).astype(np.int64)
    taken = np.searchsorted(sample, np.arange(sample[-1] + 1))
    moved = disturbance.apply(
        seed, time[taken], haptic.position[taken], haptic.orientation[taken], haptic.flexion[taken]
    )
    position, orientation, flexion = (np.ascontiguousarray(values[sample]) for values in moved)
    solver = HandSolver(hand, surface, options)
    solver.place(*graphic.at(0))
    return solver.run(position, orientation, flexion, graphic.abduction), time >= ONSET


@dataclass(frozen=True, repr=False)
class ReplaySummary:
    """Figures and notes of a replay."""

    rows: tuple[SummaryRow, ...]  # whole table
    notes: tuple[str, ...]  # remarks for a reader, a sentence each
    ticks: int
    warm_up: WarmUp  # preparation of the kernels; no part of any tick
    method: str
    object_name: str
    motion_name: str
    surface: str = "spheres"  # that the hand touched
    promises: frozenset[str] = frozenset(PROMISES)  # of the method
    path: Path | None = None

    def __repr__(self) -> str:
        run = f"{self.object_name}, {self.motion_name}, {self.method} on {self.surface}, {self.ticks:,} ticks"
        place = f"; {self.path}" if self.path else ""
        return f"ReplaySummary({run}: {self.verdict.word}{place}; figures by name, SI: .attributes())"

    @property
    def verdict(self) -> Verdict:
        """Verdict by the default limits."""
        return run_verdict(self.rows, self.promises, self.ticks, surface=self.surface)

    def attributes(self) -> dict[str, float | int]:
        """Return the table as attributes of the result file: figures and timings by name."""
        return {"ticks": self.ticks, **{row.name: row.value for row in self.rows}}

    def to_json(self) -> dict[str, Any]:
        """Return the summary as plain values, SI."""
        return {
            "result": str(self.path) if self.path else None,
            "hhsim": __version__,
            "object": self.object_name,
            "motion": self.motion_name,
            "method": self.method,
            "surface": self.surface,
            "verdict": asdict(self.verdict),
            **self.attributes(),
            "kernels_prepared_s": self.warm_up.seconds,
            "kernels_compiled": self.warm_up.compiled,
            "notes": list(self.notes),
        }


class HandRun:
    """Part of a run that is one hand's: its figures; `described` is of the scene, as plain values."""

    def __init__(
        self, solver: SceneSolver, hand: int, bodies: Mapping[str, Body], described: Mapping[str, Any]
    ) -> None:
        self.solver, self.hand, self._first_body = solver, hand, next(iter(bodies))
        scene, options, of_hand = solver.scene, solver.options, solver.scene.hands[hand]
        self.model = of_hand.model
        self.ticks, motion, method = of_hand.ticks, of_hand.trajectory, solver.method
        of_method: dict[str, Any] = {}
        if options.method not in METHODS:
            of_method = {"gives": sorted(method.gives), "promises": sorted(method.promises)}
            of_method |= {"method_source": method.source} if method.source else {}
        self.described = {
            **scene.description,
            **described,
            "rate": scene.ticks.rate,
            "motion": motion.name,
            "motion_source": motion.source,
            **of_method,
            **describe_scene(solver.seen, self.model, options, bodies),
        }
        self._surface = solver.spaces[hand].touched
        self._series = KeptColumns((*needed_columns(), *GRAPHIC_HAND))
        self._body, self._contacts = KeptColumns(), KeptColumns()

    def keep(self, seen: Columns, tables: Mapping[str, Columns]) -> None:
        """Keep what the figures need of a block: the hand's columns as the engine sees them, and the file's tables."""
        self._series.keep(seen)
        # What one body that goes as recorded has is its poses alone, which no figure needs.
        if self.solver.seen.free is not None:
            self._body.keep(tables[f"{BODIES}/{self._first_body}/{TICK}"])
            self._contacts.keep({f"{CONTACT}/{name}": of for name, of in tables[CONTACT].items()})

    def summary(self, touched: TouchedObject) -> ReplaySummary:
        """Compute the table of the run, of datasets of /tick as the object that was touched sees them."""
        solver, seen, options, surface = self.solver, self.solver.seen, self.solver.options, self._surface
        scene, parts, free = solver.scene, seen.parts, None
        if seen.free is not None:
            contacts = Contacts(self._contacts, len(scene.hands), self.hand)
            first = STILL if seen.beside else seen.place
            properties, stiffness = seen.free.properties(scene.plane), options.stiffness.diagonal()
            of_body = properties, first, stiffness, options.offset, bool(seen.beside)
            free = FreeRun(self._body, contacts, *of_body)
        run = RunTicks(
            columns=self._series,
            ticks=scene.ticks.tick_count,
            phases=scene.ticks.phases,
            rate=scene.ticks.rate,
            fingers=len(options.fingers),
            all_pairs=all_pairs(self.model, seen.tree),
            touched=touched,
            hand=self.model,
            free=free,
            modelled=options.fingers,
            self_contact=options.self_contact,
        )
        known = known_figures(solver.method.gives)
        # What a further run of the solver would tell is of an object that stands still.
        own = self._figures_of_own_runs(run) if free is None and parts is None else {}
        figures = {name: value for name, value in {**tick_figures(run), **own}.items() if name in known}
        held_off = () if free is None or parts is None else _held_off(parts, free.moved)
        return ReplaySummary(
            rows=summary_rows(figures, of_paper=of_the_paper(self.described)),
            notes=(*self._notes(figures), *surface.notes, *held_off),
            ticks=scene.ticks.tick_count,
            warm_up=solver.prepared[self.hand],
            method=options.method,
            object_name=scene.name,
            motion_name=scene.hands[self.hand].trajectory.name,
            surface=options.surface,
            promises=solver.method.promises,
        )

    def _figures_of_own_runs(self, run: RunTicks) -> dict[str, float]:
        """Compute the figures that need further runs of the solver: the reference optimum, and a trembling hold."""
        if not run.holds:
            return {"tracking_excess": np.nan}
        hand, options, haptic = self.model, self.solver.options, self.solver.seen.haptic[self.hand]
        graphic = HandConfiguration(*(run[f"graphic/{name}"] for name in HandConfiguration._fields))
        held = np.flatnonzero(run.hold)
        chosen = np.unique(held[np.linspace(0, held.size - 1, min(REFERENCE_TICKS, held.size)).astype(int)])
        excess = reference_excess(hand, self._surface, options, haptic, graphic, chosen)
        found = {"tracking_excess": 100.0 * metrics.statistics(excess).mean}
        if not self.solver.method.gives >= {FORCES, RUNS}:
            return found
        held_haptic, held_graphic = haptic.at(run.holds[0]), graphic.at(run.holds[0])
        if all(np.all(values == values[:1]) for values in held_haptic):
            # The same hold with a trembling hand.
            record, settled = trembling_hold(hand, self._surface, options, held_haptic, held_graphic, run.rate)
            trembling = statistics(force_variation_rate(record.total), settled)
            found |= {TREMBLING: trembling.mean, f"{TREMBLING}_std": trembling.std}
        return found

    def _notes(self, figures: Mapping[str, float]) -> Iterator[str]:
        """Yield remarks on the input, on the ticks, and on spheres too coarse for what a user should feel."""
        seen, options, status = self.solver.seen, self.solver.options, self._series["status"]
        yield from (*seen.mesh.repairs, *seen.mesh.warnings)
        if np.any(status & STATUS_START_INSIDE):
            where = "one of the bodies" if seen.beside else "the object"
            where += ", or in the other hand" if self.described.get(HANDS_APART) else ""
            where += ", or in itself" if options.self_contact else ""
            yield f"the haptic hand begins inside {where}: the graphic hand began at a free place near it"
        if squeezed := int(np.sum(status & STATUS_NO_PLACE > 0)):
            ticks = counted(squeezed, "tick")
            yield f"moving parts left the hand no place in {ticks}: it is shown inside them, as little as can be"
        if held := int(np.sum(status & STATUS_INPUT_INVALID > 0)):
            yield f"{counted(held, 'tick')} had input that was not finite and used the last good one"
        if options.threads > 1:
            yield f"CPU times are those of all {options.threads} threads together, waiting for each other included"
        error = figures["contact_error_max"]
        # A hand that is as deep in the spheres is off the mesh to the inside, whatever the spheres.
        if error > max(MOST_CONTACT_ERROR, figures["penetration_max"]):
            level, way = seen.tree.depth, "replay the part that the hand touches as a mesh of its own"
            if seen.beside:
                way = "mend it with --surface mesh"
            elif level < MOST_LEVEL:
                finer = f"mend it with --level {level + 1}, or --max-error 1mm, which"
                way = f"{finer} takes the coarsest level that is enough"
            yield (
                f"the hand touches up to {1e3 * error:.2g} mm off the mesh: {seen.tree.leaf_count:,} spheres (level "
                f"{level}) are too coarse for an object of {1e3 * seen.mesh.extent.max():,.0f} mm; {way}"
            )


def _held_off(parts: MovingParts, first: RigidMotion) -> Iterator[str]:
    """Yield by how much each driven body is kept from its recorded place; `first` is the motion of the first body."""
    for name, motion in parts.driven.items():
        p, count = parts.names.index(name), len(parts.world)
        center = np.tile(parts.meshes[p].bounds.mean(axis=0), (count, 1))
        shown = RigidMotion(parts.world[:, p, 3:], parts.world[:, p, :3]).points(center)
        off = np.linalg.norm(first.points(shown) - motion.points(center), axis=1)
        if off.max() > HELD_OFF:
            ticks = counted(int((off > HELD_OFF).sum()), "tick")
            yield f"{name} is kept from where it is recorded in {ticks}, by up to {1e3 * off.max():.3g} mm"


@dataclass(frozen=True)
class RepeatedTime:
    """Mean and standard deviation (n - 1) of a figure of time over several runs, and its row in the last table."""

    row: SummaryRow
    mean: float
    deviation: float

    @property
    def shown(self) -> str:
        """Mean ± standard deviation in the table's unit, with digits enough for two of the deviation."""
        figure = self.row.figure
        figure = replace(figure, digits=digits_with(self.deviation / figure.scale, figure.digits))
        return f"{figure.shown(self.mean)} ± {figure.shown(self.deviation)}"


def digits_with(deviation: float, digits: int) -> int:
    """Return the number of decimals that show two digits of a deviation, at least `digits` and not many more."""
    if not deviation > 0.0:
        return digits
    return min(max(digits, 1 - math.floor(math.log10(deviation))), digits + MORE_DIGITS)


def repeated_document(runs: Sequence[ReplaySummary]) -> dict[str, Any]:
    """Return every figure that has noise, over at least two runs of the same replay, as plain values: SI, or %.

    Undefined figures are left out.
    """
    times = {}
    for row in runs[-1].rows:
        values = [float(other.value) for run in runs for other in run.rows if other.name == row.name]
        if run_metrics()[row.name].noise > 0.0 and all(map(math.isfinite, values)):
            times[row.name] = {"mean": mean(values), "std": stdev(values)}
    return {"runs": len(runs), "times": times}


def stored_times(repeated: Mapping[str, Any], rows: Sequence[SummaryRow]) -> list[RepeatedTime]:
    """Return the repeated times of a result (`hhsim.result.reader.Result.repeated`), in the order of its table."""
    times = repeated.get("times", {})
    return [RepeatedTime(row, times[row.name]["mean"], times[row.name]["std"]) for row in rows if row.name in times]
