"""Repetition of a hold with tremor: the second measure of force variation.

With frozen input the force must come to rest, which shows limit cycles but not what a user feels. The paper's 0.18 %
was measured on a live hold, so a hold with frozen input is run once more with seeded physiological tremor.
"""

import math
from typing import Any

import numpy as np

from hhsim.arrays import BoolArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.kernels.tick.block import TickRecord
from hhsim.metrics.metrics import Statistics, force_variation_rate, statistics
from hhsim.motion.tremor import Disturbance
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.options import SolverOptions

TREMOR = Disturbance(tremor_position=1e-4, tremor_rotation=math.radians(0.2), tremor_frequency=10.0)
"""0.1 mm and 0.2° at 10 Hz: physiological tremor of the hand is 8 to 12 Hz and 0.05 to 0.1 mm."""
ONSET = 0.1
"""First period of the tremor [s], left out: its onset is a jump."""


def tremor_variation(
    hand: HandModel,
    surface: Any,
    options: SolverOptions,
    haptic: HandConfiguration,
    graphic: HandConfiguration,
    rate: float,
    seed: int = 0,
) -> Statistics | None:
    """Compute mean, spread and maximum of the force variation rate [%] of a hold repeated with tremor.

    Undefined where the hold is no longer than the onset; None where its input moves. Arguments as for `trembling_hold`.
    """
    if any(np.any(values != values[:1]) for values in haptic):
        return None
    record, settled = trembling_hold(hand, surface, options, haptic, graphic, rate, seed)
    return statistics(force_variation_rate(record.total), settled)


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
