"""Step that a method proposes, and the contacts that carry force."""

import numpy as np

from hhsim.kernels.contact.linearise import LIMIT_ROWS, limit_start
from hhsim.kernels.contact.self_pairs import SELF_PAIRS, WHOLE_PALM, SelfPairs
from hhsim.kernels.hand.kinematics import DOF, FINGER_COUNT, PALM_BODY, PHALANX_COUNT
from hhsim.kernels.jit import Indices, Record, as_int64, jit, jit_inline
from hhsim.kernels.qp.active_set import QpWork

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
    ],
    align=True,
)
"""A proposed step and the multipliers that hold it."""

ACTIVE_CONTACTS = np.dtype(
    [
        ("key", np.int64, (ACTIVE_CAPACITY,)),  # as in the contact records; -1 - i for joint limit i
        ("body", np.int64, (ACTIVE_CAPACITY,)),  # 0 to 15, -1 for a joint limit
        ("point", np.float64, (3, ACTIVE_CAPACITY)),  # [m], world
        ("normal", np.float64, (3, ACTIVE_CAPACITY)),  # from the object to the hand, world
        ("multiplier", np.float64, (ACTIVE_CAPACITY,)),  # [N], [N·m] for joint limits
        ("count", np.int64),  # how many
    ],
    align=True,
)
"""Contacts with a multiplier at some step."""


@jit_inline
def take_multipliers(qp: QpWork, solution: Record) -> None:
    """Write a solved program's active rows and their multipliers to a step, or to a finger's part of one."""
    count = qp.counts[0]
    for i in range(count):
        solution.row[i] = qp.active[i]
        solution.multiplier[i] = qp.multiplier[i]
    solution.count = count


@jit_inline
def store_active(contacts: Record, step: Record, active: Record) -> None:
    """Remember the contacts that carry the step's multipliers."""
    limits = limit_start(contacts, as_int64(0))
    for i in range(step.count):
        row = step.row[i]
        active.multiplier[i] = step.multiplier[i]
        if row >= limits:
            active.key[i] = limits - row - 1
            active.body[i] = -1
            for j in range(3):
                active.point[j, i] = 0.0
                active.normal[j, i] = 0.0
        else:
            active.key[i] = contacts.key[row]
            active.body[i] = contacts.body[row]
            for j in range(3):
                active.point[j, i] = contacts.point[j, row]
                active.normal[j, i] = contacts.normal[j, row]
    active.count = step.count


@jit
def store_meeting(own: SelfPairs, state: Record, active: Record) -> None:
    """Name the parts of rows of the hand's own parts in a set of active contacts, each of both with its force."""
    step, rows = state.step, state.self_contact
    first = limit_start(state.contacts, as_int64(FINGER_COUNT))
    for i in range(step.count):
        row, other = step.row[i] - first, active.count
        if row < 0:
            continue
        pair = rows.pair[row]
        # Behind the keys of joint limits, which no guess takes for one of its own.
        active.key[i] = -1 - LIMIT_ROWS - pair - SELF_PAIRS * (rows.sphere[row] - WHOLE_PALM)
        active.key[other], active.multiplier[other] = active.key[i], active.multiplier[i]
        active.body[i], active.body[other] = own.first[pair], own.second[pair]
        for j in range(3):
            active.normal[j, i], active.normal[j, other] = rows.normal[row, j], -rows.normal[row, j]
            active.point[j, other] = 0.0
        active.count += 1


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
