"""What is judged of every hard case alike: penetration, finite numbers, joint limits, stuck ticks.

Nothing of it is the solver's word but the bit that says a tick was stuck: penetration is recomputed from the recorded
poses, and a stuck tick is explained only where a second solver, with many times the budget, finds no way either.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hhsim.hand import HandModel
from hhsim.haptic_motion import HapticMotion
from hhsim.hard_case import DEEPEST, Figure, Outcome
from hhsim.kernels.block import TickRecord
from hhsim.kernels.pose import is_finite_configuration
from hhsim.kernels.tick_state import STATUS_HELD, STATUS_STUCK
from hhsim.kernels.tree import TreeArrays
from hhsim.metrics import hand_clearance, penetration
from hhsim.solver import HandSolver
from hhsim.solver_options import SolverOptions

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

TIMINGS = ("duration", "duration_total", "duration_cpu")
"""What of a record is no result: it differs from run to run."""

LEAST_MOTION = 0.1
"""A hand that can come nearer to the user's by less than this share of the margin (0.1 mm) may stand still."""

REFERENCE_LINEARISATIONS = 400
REFERENCE_SETTLED = 1e-5
"""Of the reference that looks for a way from a stuck tick: its budget, and the step that ends it as share of the margin
(10 nm); as in `tracking_reference`."""

MOST_CHECKS = 300
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


def worst_penetration(hand: HandModel, tree: TreeArrays, record: TickRecord) -> float:
    """Deepest penetration of the recorded hands [m], by `metrics.penetration`; NaN where one is nowhere."""
    depth = penetration(
        tree,
        hand.radius,
        hand.palm_tree.leaf_center,
        hand.palm_tree.leaf_radius,
        record.joints,
        record.position,
        record.orientation,
    ).depth
    return float(depth.max()) if len(depth) else 0.0


def least_clearance(hand: HandModel, tree: TreeArrays, record: TickRecord, limit: float) -> Array:
    """Least signed distance of hand and object at every tick [m], shape (T,); `limit` stands for all above it."""
    palm, finger = hand_clearance(
        tree,
        hand.radius,
        hand.palm_tree.leaf_center,
        hand.palm_tree.leaf_radius,
        record.joints,
        record.position,
        record.orientation,
        limit,
    )
    least: Array = np.minimum(palm, finger.min(axis=1))
    return least


def pose_clearance(hand: HandModel, tree: TreeArrays, pose: HapticMotion, limit: float) -> float:
    """Least signed distance [m] of object and hand at the first configuration of a motion, at most `limit`."""
    position, orientation, flexion, abduction = (values[0] for values in pose)
    joints = hand.joints(position, orientation, flexion, abduction)
    palm, finger = hand_clearance(
        tree,
        hand.radius,
        hand.palm_tree.leaf_center,
        hand.palm_tree.leaf_radius,
        joints[None],
        position[None],
        orientation[None],
        limit,
    )
    return float(min(palm[0], finger.min()))


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


def shown_points(record: TickRecord) -> Array:
    """Joints and palm of the shown hand [m], shape (T, 21, 3): where it is, in one kind of number."""
    joints = record.joints.reshape(len(record.joints), -1, 3)
    return np.concatenate([joints, record.position[:, None]], axis=1)


def motion_difference(first: TickRecord, second: TickRecord) -> float:
    """How far a joint or the palm of one record is from the other's at most [m]."""
    return float(np.linalg.norm(shown_points(first) - shown_points(second), axis=-1).max())


def unexplained_stuck(
    hand: HandModel, tree: TreeArrays, options: SolverOptions, motion: HapticMotion, record: TickRecord
) -> int:
    """Stuck ticks from where the hand could have moved.

    From the hand that the tick showed, the coupled reference (400 linearisations, settled at 10 nm) goes to the user's
    hand. The tick is explained where that reference itself accepts a step and yet moves no joint and no part of the
    palm by more than 0.1 mm: then the hand shown is the best one nearby. A reference that is stuck explains nothing.

    Args:
        hand: The hand.
        tree: The object, world.
        options: Of the method; lengths and stiffness are kept.
        motion: The haptic input, samples that are not finite included.
        record: What the method made of it, the same ticks.
    """
    stuck = np.flatnonzero(record.status & STATUS_STUCK)
    if len(stuck) == 0:
        return 0
    newest = newest_sound_sample(motion)
    reference = HandSolver(
        hand,
        tree,
        replace(
            options,
            method="coupled",
            qp="active-set",
            linearisations=REFERENCE_LINEARISATIONS,
            settled=REFERENCE_SETTLED * options.margin,
        ),
    )
    shown = shown_points(record)
    verdicts: dict[bytes, bool] = {}
    unexplained = 0
    for tick in stuck:
        pose = [values[tick] for values in (record.position, record.orientation, record.flexion, record.abduction)]
        if newest[tick] < 0:
            unexplained += 1
            continue
        wanted = motion.part(newest[tick], newest[tick] + 1)
        key = b"".join(np.ascontiguousarray(values).tobytes() for values in (*pose, *wanted))
        if key not in verdicts:
            if len(verdicts) >= MOST_CHECKS:
                unexplained += 1
                continue
            reference.place(*pose)
            best = reference.run(*wanted)
            moved = float(np.linalg.norm(shown_points(best)[0] - shown[tick], axis=1).max())
            verdicts[key] = not best.status[0] & STATUS_STUCK and moved <= LEAST_MOTION * options.margin
        unexplained += not verdicts[key]
    return unexplained


def newest_sound_sample(motion: HapticMotion) -> Indices:
    """Of each tick, the newest sample that the method could use, -1 where none has come; shape (T,).

    From the input itself, not from what the method says of it.
    """
    sound = np.array([is_finite_configuration(*sample) for sample in zip(*motion, strict=True)])
    return np.asarray(np.maximum.accumulate(np.where(sound, np.arange(len(sound)), -1)), dtype=np.int64)


def held(record: TickRecord) -> NDArray[np.bool_]:
    """Ticks that say that their input was unusable, shape (T,)."""
    flags: NDArray[np.bool_] = (record.status & STATUS_HELD) > 0
    return flags
