"""Replay of two hands on one object, and one file of both.

The hands keep out of each other. On an object that stands still or moves as recorded each hand's ticks are those that
it has alone, side by side on two threads, where the hands cannot meet. Elsewhere, and with a free object, both have
one program.
"""

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from hhsim.arrays import AnyArray, FloatArray
from hhsim.errors import InputError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.forward_kinematics import PlacedHand, forward_kinematics
from hhsim.metrics.metrics import distance_of_hands
from hhsim.replay.replay import Replay
from hhsim.replay.summary import ReplaySummary
from hhsim.result.reader import check_result_path
from hhsim.result.schema import HANDS_APART, SIDES, TWO_HANDED
from hhsim.result.two_handed_file import BETWEEN_COLUMNS, join_hands
from hhsim.scene.free_object import FreeObject
from hhsim.scene.scene import Scene
from hhsim.solver.options import SolverOptions
from hhsim.solver.two_hands import SideBySideSolver, TwoHandedSolver, keeps_hands_apart
from hhsim.system.deferred_sigint import interruptible_between
from hhsim.system.output_path import free_name
from hhsim.system.progress import Progress, silent


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

    Until both are complete, each hand has a result file of its own beside `output_path`. Other arguments and errors are
    those of `hhsim.replay.replay.replay_scene`; raises InputError, too, for scenes not of one object and time.
    """
    _check(scenes)
    path = Path(output_path)
    check_result_path(path)
    free, jointed = scenes[0].free, scenes[0].parts is not None
    keeps_apart = free is not None or keeps_hands_apart(options, jointed=jointed)
    described = {TWO_HANDED: True, HANDS_APART: keeps_apart}
    runs = [Replay(scene, options, described, alone=free is None) for scene in scenes]
    parts = [free_name(path.with_name(f"{path.stem}.{side}.partial{path.suffix}")) for side in SIDES]
    models, graphic = [scene.hand for scene in scenes], list[FloatArray]()
    duration: list[AnyArray] = []
    with ExitStack() as stack:
        for run, own in zip(runs, parts):
            stack.enter_context(run.writer(own, command))
        solver = _together(runs, free) if free is not None else _side_by_side(runs, stack)
        check_interrupt = stack.enter_context(interruptible_between())
        for part in runs[0].blocks():
            progress("ticks", part.start, runs[0].total)
            records = [
                run.judged(part, each) for run, each in zip(runs, solver.run(*(r.haptic.at(part) for r in runs)))
            ]
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
    haptic = [forward_kinematics(scene.hand, *HandConfiguration.of(scene.driven or scene.ticks)) for scene in scenes]
    distances = (distance_of_hands(models, haptic), np.concatenate(graphic))
    join_hands(parts, dict(zip((column.name for column in BETWEEN_COLUMNS), distances)), path)
    times = 1e-9 * np.concatenate(duration)
    p50, p99 = (float(np.quantile(times, share)) for share in (0.5, 0.99))
    haptic_distance, graphic_distance = (float(np.min(values)) for values in distances)
    both = (hands[0], hands[1]), p50, p99, haptic_distance, graphic_distance
    return TwoHandedReplay(path, *both, together=free is not None, keeps_apart=keeps_apart)


def _side_by_side(runs: Sequence[Replay], stack: ExitStack) -> SideBySideSolver:
    """Return what runs the next ticks of both hands, each on a thread of its own where they cannot meet."""
    return SideBySideSolver([run.solver for run in runs], stack.enter_context(ThreadPoolExecutor(len(runs))))


def _together(runs: Sequence[Replay], free: FreeObject) -> TwoHandedSolver:
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
