"""The step that a method proposes, and the contacts that carry force: what every method hands to the tick."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .contact import Contacts
from .hand import FINGER_COUNT
from .jit import jit
from .linearise import LIMIT_ROWS, limit_start

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

ACTIVE_CAPACITY = 192

DURATION_DETECT = 0
DURATION_PALM = 1
DURATION_FINGERS = 2
DURATION_FORCE = 3
"""Places in `Step.duration`; the one QP of the coupled method counts as the palm's."""


class Step(NamedTuple):
    """A proposed step and the multipliers that hold it.

    | field | meaning | shape |
    |---|---|---|
    | delta | (δp, δφ, δθ) [m, rad, rad] | (21,) |
    | row | rows with a multiplier; a row may stand more than once | (ACTIVE_CAPACITY,) |
    | multiplier | λ >= 0 [N], [N·m] for joint limits | (ACTIVE_CAPACITY,) |
    | count | [number of these, QP iterations added to] | (2,) |
    | duration | wall time [ns] of detection, palm QP, finger QPs, forces, added to | (4,) |
    """

    delta: Array
    row: Indices
    multiplier: Array
    count: Indices
    duration: Indices


class ActiveContacts(NamedTuple):
    """The contacts with a multiplier at the last accepted step.

    | field | meaning | shape |
    |---|---|---|
    | key | as in `Contacts`; -1 - i for joint limit i | (ACTIVE_CAPACITY,) |
    | body | 0 to 15, -1 for a joint limit | (ACTIVE_CAPACITY,) |
    | point | [m], world | (3, ACTIVE_CAPACITY) |
    | normal | from the object to the hand, world | (3, ACTIVE_CAPACITY) |
    | multiplier | [N], [N·m] for joint limits | (ACTIVE_CAPACITY,) |
    | count | how many | (1,) |
    """

    key: Indices
    body: Indices
    point: Array
    normal: Array
    multiplier: Array
    count: Indices


@jit
def keep_active(contacts: Contacts, step: Step, active: ActiveContacts) -> None:
    """Remember the contacts that carry the step's multipliers."""
    limits = limit_start(contacts, 0)
    for i in range(step.count[0]):
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
    active.count[0] = step.count[0]


@jit
def guess_rows(contacts: Contacts, active: ActiveContacts, group: int, guess_out: Indices, filled: int) -> int:
    """Append the rows of `group` (0 palm, 1 to 5 fingers, with their limits) that carried force last time; returns the new count."""
    start, stop = contacts.start[group], contacts.start[group + 1]
    finger = group - 1
    limits = limit_start(contacts, 0)
    for i in range(active.count[0]):
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
        owner = 0 if body == 15 else 1 + body // 3
        if owner != group:
            continue
        for row in range(start, stop):
            if contacts.key[row] == key:
                guess_out[filled] = row
                filled += 1
                break
    return filled
