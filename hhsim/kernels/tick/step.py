"""Step that a method proposes, and the contacts that carry force."""

import numpy as np

from hhsim.kernels.contact.linearise import LIMIT_ROWS, limit_start
from hhsim.kernels.hand.kinematics import BODY_COUNT, DOF, FINGER_COUNT, PALM_BODY, PHALANX_COUNT
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


@jit
def bear_contacts(contacts: Record, first: int, last: int, loaded: Record, active: Record) -> None:
    """Remember the contacts of rows `first` to `last` that carry a multiplier, and the joint limits behind them."""
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
