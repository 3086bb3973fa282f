"""Replay of two hands on one object, and one file of both.

An object that stands still or moves as recorded has a program for each hand, side by side on two threads: each hand's
ticks are those that it has alone. A free object and both hands have one program. How near the hands come to each other
is measured, not prevented.
"""

from collections.abc import Callable, Mapping, Sequence
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
from hhsim.kernels.tick.block import TickRecord
from hhsim.metrics.metrics import distance_of_hands
from hhsim.replay.replay import Replay
from hhsim.replay.summary import ReplaySummary
from hhsim.result.reader import check_result_path
from hhsim.result.schema import SIDES, TWO_HANDED
from hhsim.result.two_handed_file import BETWEEN_COLUMNS, join_hands
from hhsim.scene.free_object import FreeObject
from hhsim.scene.scene import Scene
from hhsim.solver.options import SolverOptions
from hhsim.solver.two_hands import TwoHandedSolver
from hhsim.system.deferred_sigint import interruptible_between
from hhsim.system.output_path import free_name
from hhsim.system.progress import Progress, silent


@dataclass(frozen=True)
class TwoHandedReplay:
    """Outcome of a replay of two hands.

    Attributes:
        path: Result file of both.
        hands: Table of the right and of the left hand.
        tick_p50, tick_p99: Time of a tick of both, side by side the longer one's [s].
        together: True if both have one program, with a free object.
        haptic_distance, graphic_distance: Least distance between the haptic and between the graphic hands [m],
            negative where one is in the other.
    """

    path: Path
    hands: tuple[ReplaySummary, ReplaySummary]
    tick_p50: float
    tick_p99: float
    haptic_distance: float
    graphic_distance: float
    together: bool = False

    @property
    def note(self) -> str:
        """Sentence on both hands together."""
        nearest = f"{1e3 * self.graphic_distance:.3g} mm"
        how = "in one program" if self.together else "side by side"
        met = f"; the haptic hands enter each other by {-1e3 * self.haptic_distance:.2g} mm"
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
    those of `hhsim.replay.replay.replay_scene`.

    Raises:
        InputError: Scenes that are not of one object and time.
    """
    _check(scenes)
    path = Path(output_path)
    check_result_path(path)
    free = scenes[0].free
    runs = [Replay(scene, options, {TWO_HANDED: True}, alone=free is None) for scene in scenes]
    parts = [free_name(path.with_name(f"{path.stem}.{side}.partial{path.suffix}")) for side in SIDES]
    models, graphic = [scene.hand for scene in scenes], list[FloatArray]()
    duration: list[AnyArray] = []
    with ExitStack() as stack:
        for run, own in zip(runs, parts):
            stack.enter_context(run.writer(own, command))
        solve = _together(runs, free) if free is not None else _side_by_side(runs, stack)
        check_interrupt = stack.enter_context(interruptible_between())
        for part in runs[0].blocks():
            progress("ticks", part.start, runs[0].total)
            records = solve(part)
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
    hands = (hands[0], hands[1])
    return TwoHandedReplay(path, hands, p50, p99, haptic_distance, graphic_distance, together=free is not None)


def _side_by_side(runs: Sequence[Replay], stack: ExitStack) -> Callable[[slice], list[TickRecord]]:
    """Return what runs the next ticks of each hand, each on a thread of its own."""
    threads = stack.enter_context(ThreadPoolExecutor(len(runs)))
    return lambda part: list(threads.map(lambda run: run.solve(part), runs))


def _together(runs: Sequence[Replay], free: FreeObject) -> Callable[[slice], list[TickRecord]]:
    """Return what runs the next ticks of both hands and of the free object, by one program."""
    solver = TwoHandedSolver([run.solver for run in runs], free)
    for hand, run in enumerate(runs):
        run.object_ticks = partial(solver.object_ticks, hand)
    return lambda part: [
        run.judged(part, each) for run, each in zip(runs, solver.run(*(r.haptic.at(part) for r in runs)))
    ]


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
