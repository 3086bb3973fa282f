"""Step of a program: the contacts that bear it, and the share of it that the known pairs allow."""

import numpy as np

from hhsim.kernels.clock import monotonic_ns
from hhsim.kernels.contact.linearise import LIMIT_ROWS, limit_start
from hhsim.kernels.hand.kinematics import (
    BODY_COUNT,
    DOF,
    FINGER_COUNT,
    PALM_BODY,
    PHALANX_COUNT,
    HandArrays,
    motion_bounds,
)
from hhsim.kernels.hand.pose import copy_configuration, farthest_joint, move, update_kinematics
from hhsim.kernels.jit import Indices, Record, as_int64, jit, jit_inline
from hhsim.kernels.qp.active_set import QpWork
from hhsim.kernels.tick.options import TickOptions

ACTIVE_CAPACITY = 64

DURATION_DETECT = 0
DURATION_PALM = 1
DURATION_FINGERS = 2
DURATION_FORCE = 3
"""Places in `duration`; the one QP of the coupled method counts as the palm's."""


STEP = np.dtype(
    [
        ("delta", np.float64, (DOF,)),  # (δp, δφ, δθ) [m, rad, rad]
        ("row", np.int64, (ACTIVE_CAPACITY,)),  # rows with a multiplier; a row may stand more than once
        ("multiplier", np.float64, (ACTIVE_CAPACITY,)),  # λ >= 0 [N], [N·m] for joint limits
        ("count", np.int64),  # number of these
        ("iterations", np.int64),  # QP iterations of this tick, added to
        ("duration", np.int64, (4,)),  # wall time of this tick [ns]: detection, palm QP, finger QPs, forces; added to
        ("lap", np.int64),  # time up to which that is known [ns]
    ],
    align=True,
)
"""A proposed step and the multipliers that hold it."""

ACTIVE_CONTACTS = np.dtype(
    [
        ("key", np.int64, (ACTIVE_CAPACITY,)),  # as in the contact records; -1 - i for joint limit i
        ("body", np.int64, (ACTIVE_CAPACITY,)),  # 0 to 15, -1 for a joint limit
        ("point", np.float64, (3, ACTIVE_CAPACITY)),  # [m], in the frame of the pose
        ("normal", np.float64, (3, ACTIVE_CAPACITY)),  # from the object to the hand
        ("multiplier", np.float64, (ACTIVE_CAPACITY,)),  # [N], [N·m] for joint limits
        ("count", np.int64),  # how many
    ],
    align=True,
)
"""Contacts with a multiplier at some step."""


@jit_inline
def lap(stage: int, state: Record) -> None:
    """Add the time since the last lap to a stage of the tick: a look at the clock takes as long as some stages."""
    step, now = state.step, monotonic_ns()
    step.duration[stage] += now - step.lap
    step.lap = now


@jit_inline
def take_multipliers(qp: QpWork, solution: Record) -> None:
    """Write a solved program's active rows and their multipliers to a step, or to a finger's part of one."""
    count = qp.counts[0]
    for i in range(count):
        solution.row[i] = qp.active[i]
        solution.multiplier[i] = qp.multiplier[i]
    solution.count = count


@jit
def store_active_contacts(contacts: Record, first: int, last: int, loaded: Record, active: Record) -> None:
    """Store the contacts of rows `first` to `last` that have a multiplier, and the joint limits behind them."""
    count = as_int64(0)
    for i in range(loaded.count):
        row = loaded.row[i]
        if not first <= row < last + LIMIT_ROWS:
            continue
        touches = row < last
        active.key[count] = contacts.key[row] if touches else last - row - 1
        active.body[count] = contacts.body[row] % BODY_COUNT if touches else -1
        active.multiplier[count] = loaded.multiplier[i]
        for j in range(3):
            active.point[j, count] = contacts.point[j, row] if touches else 0.0
            active.normal[j, count] = contacts.normal[j, row] if touches else 0.0
        count += 1
    active.count = count


@jit_inline
def copy_active(source: Record, target: Record) -> None:
    """Copy a set of active contacts."""
    count = source.count
    target.count = count
    for i in range(count):
        target.key[i] = source.key[i]
        target.body[i] = source.body[i]
        target.multiplier[i] = source.multiplier[i]
        for j in range(3):
            target.point[j, i] = source.point[j, i]
            target.normal[j, i] = source.normal[j, i]


@jit_inline
def guess_rows(contacts: Record, active: Record, group: int, guess_out: Indices, filled: int) -> int:
    """Append the rows of `group` (0 palm, 1 to 5 fingers with limits) that carried force; return the new count."""
    start, stop = contacts.start[group], contacts.start[group + 1]
    finger = group - 1
    limits = limit_start(contacts, as_int64(0))
    for i in range(active.count):
        key = active.key[i]
        if filled >= guess_out.shape[0]:
            break
        if key < 0:
            limit = -1 - key
            if finger >= 0 and limit // (LIMIT_ROWS // FINGER_COUNT) == finger:
                guess_out[filled] = limits + limit
                filled += 1
            continue
        body = active.body[i]
        owner = 0 if body == PALM_BODY else 1 + body // PHALANX_COUNT
        if owner != group:
            continue
        for row in range(start, stop):
            if contacts.key[row] == key:
                guess_out[filled] = row
                filled += 1
                break
    return filled


CLEAR = 0.8
"""Share of the offset that a hand must be away from the object to go a part of a step."""
LEAST_SHARE = 0.05
"""Least share of a step that such a hand goes; below it the target is brought nearer."""
FALLS, FASTEST, LONG_SNAP = 32.0, 1.8, 96.0
"""A hand that has snapped for n ticks goes 1 + (n / FALLS)² times as far in a tick, at most `FASTEST` times, so that no
tick is a jump; with ((n - LONG_SNAP) / FALLS)² times in addition the snap of a hand far inside ends, too."""
IN_THE_AIR = 0.1
"""Share of the way left that a hand goes in a tick which has snapped and comes free."""
LEAST_STEP = 0.25
"""Way of a step that a hand at its bound still has, as a share of the snap step."""

WHOLE_TARGET = -1.0
"""Stands for the motion of the whole step where the program has the true target."""


@jit_inline
def allowed_fraction(hand: HandArrays, options: TickOptions, state: Record) -> tuple[float, float]:
    """Compute the share of the step that the listed pairs allow, and a bound of its longest motion.

    Returns the share, 0 to 1, and how far the farthest point of the hand moves in the whole step [m].
    """
    candidates, motions = state.candidates, state.progress.motion
    reach = min(state.trust.reach, state.trust.radius)
    # A step that ends the tick, of a hand that rests, needs no better bound.
    enough = options.step_tolerance
    motion_bounds(hand, state.pose, state.step.delta, state.problem.abduction_step, enough, motions)
    fraction = 1.0
    longest = 0.0
    for body in range(BODY_COUNT):
        if state.modelled[body] == 0:
            continue
        motion = motions[body]
        longest = max(longest, motion)
        near = candidates.nearest[body]
        if near <= reach:
            allowed = min(candidates.slack[body], reach)
        else:
            allowed = min(candidates.slack[body], near)
        if motion * fraction > allowed:
            fraction = allowed / motion
    return fraction, longest


@jit_inline
def snap_step(options: TickOptions, progress: Record) -> float:
    """Return how far a hand may go in this tick beyond the user's own motion [m]: farther where it snaps for long."""
    growth, late = progress.snapped / FALLS, max(0.0, progress.snapped - LONG_SNAP) / FALLS
    return options.snap_step * (min(1.0 + growth * growth, FASTEST) + late * late)


@jit_inline
def set_bound(options: TickOptions, state: Record) -> None:
    """Set how far the hand may go in this tick, from where it stands: as far as the user's has gone, and a snap step.

    The step grows where the hand has snapped for long. What the work of the last tick did not suffice
    for is the user's own motion, too.
    """
    progress = state.progress
    left = progress.bound - farthest_joint(state.pose.joints, progress.start) if progress.lag > 0.0 else 0.0
    progress.snapped = progress.snapped + 1 if progress.snaps else 0
    progress.behind = progress.lag if progress.snaps else 0.0
    progress.bound = snap_step(options, progress) + state.input.motion + progress.carried
    if progress.lag > progress.behind:
        progress.bound += max(progress.lag, left)
    progress.snaps = False
    for f in range(FINGER_COUNT):
        for k in range(PHALANX_COUNT + 1):
            for i in range(3):
                progress.start[f, k, i] = state.pose.joints[f, k, i]


@jit_inline
def keep_bound(
    hand: HandArrays, options: TickOptions, hindered: bool, fraction: float, longest: float, state: Record
) -> float:
    """Return the share of a step, `longest` [m] as a whole, after which no joint is beyond the bound of this tick.

    The nearest pose can move on by millimetres for a breath of the user's hand: a contact that held it gives way. The
    joints then follow as far as `set_bound` says. A step from inside the object may go a little farther, to leave it.
    A hand without rows is not `hindered` and has no bound, but where it snapped in the last tick: then it comes nearer
    to the user's by a share of the way left.
    """
    progress, least = state.progress, LEAST_STEP * options.snap_step
    if not hindered and progress.snapped == 0:
        return fraction
    bound = progress.bound if hindered else progress.bound + IN_THE_AIR * progress.behind
    if progress.path + fraction * longest <= bound:
        # The path, which is known, is no shorter than the way from where the tick began.
        return fraction
    gone = farthest_joint(state.pose.joints, progress.start)
    bound = max(bound, gone + least)
    if gone + fraction * longest <= bound:
        return fraction
    # Of the whole step, since the share that lists allow depends on when they were gathered.
    trial = state.trial
    copy_configuration(state.pose, trial)
    move(trial, state.step.delta, state.problem.abduction_step, 1.0)
    update_kinematics(hand, trial)
    there = farthest_joint(trial.joints, progress.start)
    # A distance is a convex function of the share: below this chord.
    if gone + fraction * (there - gone) <= bound:
        return fraction
    progress.snaps = True
    return (bound - gone) / (there - gone)
