"""What is judged of every hard case alike: penetration, finite numbers, joint limits, stuck ticks.

Nothing of it is the solver's word but the bit that says a tick was stuck: penetration is recomputed from the recorded
poses, and a stuck tick is explained only where `hhsim.bench.robustness.local_optimality`, which shares nothing with a
tick, finds no way either.
"""

from typing import Any

import numpy as np

from hhsim.arrays import BoolArray, FloatArray
from hhsim.bench.robustness.case import DEEPEST, Figure, Outcome
from hhsim.bench.robustness.failure import recorded_penetration
from hhsim.bench.robustness.local_optimality import way_out
from hhsim.bench.robustness.pieces import Pieces
from hhsim.bench.run_errors import placed_of
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.forward_kinematics import PlacedHand, hand_shape
from hhsim.hand.model import HandModel
from hhsim.kernels.hand.pose import is_finite_configuration
from hhsim.kernels.tick.block import TickRecord
from hhsim.kernels.tick.state import STATUS_INPUT_INVALID, STATUS_STUCK
from hhsim.metrics.metrics import hand_clearance
from hhsim.motion.tick_motion import hold_readings
from hhsim.solver.options import SolverOptions

TIMINGS = ("duration", "duration_total", "duration_cpu")
"""What of a record is no result: it differs from run to run."""

MOST_CHECKS = 40
"""Different stuck ticks of a run that are looked at; those beyond count as unexplained."""

LIMIT_TOLERANCE = 1e-9
"""A joint may be beyond its limit by this [rad]: rounding."""


def common_figures(outcomes: list[Outcome]) -> list[Figure]:
    """The figures of every case, over all of its runs.

    A penetration up to 1 µm is allowed, and nothing else; a run that was refused has none of it.
    """
    return [
        Figure(
            "penetration",
            float(np.max([outcome.penetration / outcome.run.scale for outcome in outcomes])),
            DEEPEST,
            "m",
        ),
        Figure("numbers that are not finite", sum(outcome.nonfinite for outcome in outcomes), 0),
        Figure("joint beyond its limit", max(outcome.limit_excess for outcome in outcomes), LIMIT_TOLERANCE, "rad"),
        Figure("stuck ticks that nothing explains", sum(outcome.unexplained for outcome in outcomes), 0),
    ]


def worst_penetration(hand: HandModel, surface: Any, record: TickRecord) -> float:
    """Deepest penetration of the recorded hands [m], by `recorded_penetration`; NaN where one is nowhere."""
    depth = recorded_penetration(hand, surface, record).depth
    return float(depth.max()) if len(depth) else 0.0


def least_clearance(hand: HandModel, surface: Any, placed: PlacedHand, limit: float) -> FloatArray:
    """Least signed distance of hand and object at every tick [m], shape (T,); `limit` stands for all above it."""
    palm, finger = hand_clearance(surface, *hand_shape(hand), *placed, limit=limit)
    least: FloatArray = np.minimum(palm, finger.min(axis=1))
    return least


def part_of(record: TickRecord, first: int | None, last: int | None = None) -> TickRecord:
    """Ticks first to last - 1 of a record; negative ones count from the end."""
    return TickRecord._make(values[first:last] for values in record)


def count_nonfinite(record: TickRecord) -> int:
    """Numbers of the record, timings apart, that are NaN or infinite."""
    return sum(int((~np.isfinite(values)).sum()) for name, values in record._asdict().items() if name not in TIMINGS)


def limit_excess(hand: HandModel, record: TickRecord) -> float:
    """How far a joint is beyond its limit at most [rad]; NaN where an angle is."""
    low = hand.flexion_min - record.flexion
    high = record.flexion - hand.flexion_max
    return float(max(0.0, np.max(low), np.max(high))) if np.isfinite(record.flexion).all() else float("nan")


def shown_points(record: TickRecord) -> FloatArray:
    """Joints and palm of the shown hand [m], shape (T, 21, 3): where it is, in one kind of number."""
    return placed_of(record).points


def motion_difference(first: TickRecord, second: TickRecord) -> float:
    """How far a joint or the palm of one record is from the other's at most [m]."""
    return float(np.linalg.norm(shown_points(first) - shown_points(second), axis=-1).max())


def unexplained_stuck(
    hand: HandModel, pieces: Pieces, options: SolverOptions, motion: HandConfiguration, record: TickRecord
) -> int:
    """Stuck ticks from where the hand could have moved.

    A tick is explained where `way_out` finds no step from the hand shown towards the last sample that could be
    used: by distances and derivatives of its own, and by the distances at the step's end.

    Args:
        pieces: Of the object, world.
        options: Of the method; lengths and stiffness count.
        motion: The haptic input, samples that are not finite included.
        record: What the method made of it, the same ticks.
    """
    stuck = np.flatnonzero(record.status & STATUS_STUCK)
    if len(stuck) == 0:
        return 0
    wanted = hold_readings(motion)
    shown = HandConfiguration.of(record)
    verdicts: dict[bytes, bool] = {}
    unexplained = 0
    for tick in stuck.tolist():
        here, goal = shown.part(tick, tick + 1), wanted.part(tick, tick + 1)
        key = b"".join(np.ascontiguousarray(values).tobytes() for values in (*here, *goal))
        if key not in verdicts:
            if len(verdicts) >= MOST_CHECKS:
                unexplained += 1
                continue
            verdicts[key] = way_out(hand, pieces, options, here, goal) > 0.0
        unexplained += verdicts[key]
    return unexplained


def sound_samples(motion: HandConfiguration) -> BoolArray:
    """Samples that are a hand's, shape (T,): from the input itself, not from what a method says of it."""
    return np.array([is_finite_configuration(*sample) for sample in zip(*motion, strict=True)], dtype=bool)


def held(record: TickRecord) -> BoolArray:
    """Ticks that say that their input was unusable, shape (T,)."""
    flags: BoolArray = (record.status & STATUS_INPUT_INVALID) > 0
    return flags
