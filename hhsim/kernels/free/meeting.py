"""Two hands beside free things: what keeps them out of each other in the program of all.

Both hands are as the first thing sees them, in whose frame their variables are. The row of a pair of their bodies has
fingers of both, so that a program with such rows is solved with all variables as common columns.
"""

import math
from typing import Any

from hhsim.kernels.contact.hand_pairs import (
    add_broken_pairs,
    add_hand_row,
    bound_motions,
    clear_share,
    hands_nearest,
    look_at_pairs,
    part_of,
    row_rest,
)
from hhsim.kernels.free.columns import States, common_count, first_finger, hand_count, variable_count
from hhsim.kernels.hand.kinematics import DOF, FINGER_COUNT, PHALANX_COUNT
from hhsim.kernels.jit import Record, as_bool, as_int64, jit, jit_inline, jit_noinline
from hhsim.kernels.tick.options import TickOptions
from hhsim.kernels.tick.step import ACTIVE_CAPACITY

SEEN = 0.02
"""Distance up to which two hands are measured [m]: they are looked at again when their motions may have used it up."""
MEETING_KEYS = -100
"""Keys of the rows go down from here: below those of the fingers' limits, and above those of joints."""
MEETING_KIND = -2
"""Kind of such a row."""


@jit_inline
def _hands(movers: Any, states: States, world: Record) -> Any:
    # Dynamic indices: with one hand there is no second mover, and this is never run.
    last = hand_count(world.problem) - 1
    return (movers[0], movers[last]), (states[0:1], states[last : last + 1])


@jit_noinline
def keep_meetings(movers: Any, states: States, world: Record) -> None:
    """Begin a program with the rows that bore a force in the one before."""
    pairs = world.meeting
    hands, two = _hands(movers, states, world)
    held, pairs.count = pairs.count, 0
    for i in range(held):
        if pairs.multiplier[i] > 0.0:
            add_hand_row(hands, two, pairs.body[i, 0], pairs.body[i, 1], pairs.multiplier[i], pairs)


@jit
def _most_motion(states: States, world: Record) -> float:
    # Bound of how much nearer any points of the hands come to each other in the step at hand [m].
    total = 0.0
    for h in range(2):
        delta, spread, reach = states[h].step.delta, states[h].problem.abduction_step, world.meeting.reach[h]
        bent = 0.0
        for f in range(FINGER_COUNT):
            turn = abs(spread[f])
            for k in range(PHALANX_COUNT):
                turn += abs(delta[6 + PHALANX_COUNT * f + k])
            bent = max(bent, turn)
        turned = math.sqrt(delta[3] ** 2 + delta[4] ** 2 + delta[5] ** 2)
        total += math.sqrt(delta[0] ** 2 + delta[1] ** 2 + delta[2] ** 2) + reach * (turned + bent)
    return total


@jit
def may_meet(offset: float, states: States, world: Record) -> bool:
    """Return whether the step at hand might bring the hands nearer to each other than the clearance [m]."""
    _spread_fingers(states, world.problem)
    world.may_meet = world.apart <= offset + _most_motion(states, world)
    return as_bool(world.may_meet == 1)


@jit_noinline
def add_meetings(movers: Any, options: TickOptions, states: States, world: Record) -> bool:
    """Add rows of pairs that the step at hand would bring together; return whether one is new."""
    pairs = world.meeting
    hands, two = _hands(movers, states, world)
    bound_motions(hands, two, pairs)
    look_at_pairs(hands, two, SEEN, options.margin, options.offset, pairs)
    world.apart = min(pairs.least, SEEN)
    return as_bool(add_broken_pairs(hands, two, options.offset, pairs))


@jit
def stay_apart(fraction: float, states: States, world: Record) -> bool:
    """Return whether the hands are known to be out of each other after a share of a step."""
    world.apart -= fraction * _most_motion(states, world)
    return as_bool(world.apart > 0.0)


@jit_noinline
def measure_hands(movers: Any, states: States, world: Record) -> float:
    """Compute the distance of the hands [m], negative if they are in each other, up to `SEEN`."""
    hands, two = _hands(movers, states, world)
    world.apart = min(hands_nearest(hands, two, SEEN, world.meeting), SEEN)
    return float(world.apart)


@jit
def _spread_fingers(states: States, problem: Record) -> None:
    # Each hand's own abduction step is that of the program.
    step = problem.abduction_step
    for h in range(hand_count(problem)):
        for f in range(FINGER_COUNT):
            states[h].problem.abduction_step[f] = step[FINGER_COUNT * h + f]


@jit
def share_of_meetings(states: States, world: Record) -> float:
    """Return the share of the step that the pairs vouch for, after `may_meet`; 1 with one hand."""
    if hand_count(world.problem) < 2 or world.may_meet == 0:
        return 1.0
    return float(clear_share(min(states[0].trust.radius, states[1].trust.radius), world.meeting))


@jit
def meeting_rows(states: States, meeting: Record, offset: float, row: int, problem: Record) -> int:
    """Write the rows of pairs from a row on, and return the one behind them."""
    pairs, common, weight = meeting, problem.common, problem.inverse_root
    last = hand_count(problem) - 1
    two = states[0:1], states[last : last + 1]
    problem.meeting_row = row
    _spread_fingers(states, problem)
    for i in range(pairs.count):
        for j in range(variable_count(problem)):
            common[j, row] = 0.0
        for h in range(2):
            fingers = first_finger(problem, as_int64(h)) - 6
            for j in range(DOF):
                column = 12 * h + j if j < 6 else fingers + j
                common[column, row] = pairs.gradient[i, DOF * h + j] * weight[j]
        problem.rhs[row] = row_rest(offset, two, as_int64(i), pairs)
        problem.key[row] = MEETING_KEYS - i
        problem.owner[row] = -1
        problem.kind[row] = MEETING_KIND
        row += 1
    return as_int64(row)


@jit
def spread_blocks(problem: Record) -> None:
    """Write the columns of fingers of all rows but those of pairs, which come last, among the common ones."""
    common, block = problem.common, problem.block
    for g in range(problem.groups - 1):
        start, stop, first = problem.group_start[g], problem.group_stop[g], problem.group_block[g]
        for j in range(common_count(problem), variable_count(problem)):
            for row in range(start, stop):
                common[j, row] = 0.0
        for k in range(PHALANX_COUNT if first >= 0 else 0):
            for row in range(start, stop):
                common[first + k, row] = block[k, row]


@jit
def bear_meetings(states: States, world: Record) -> None:
    """Add the forces of the hands on each other to those on each hand."""
    pairs = world.meeting
    for h in range(2):
        warm, sign = states[h].warm, 1.0 if h == 0 else -1.0
        for i in range(pairs.count):
            last = warm.count
            if pairs.multiplier[i] == 0.0 or last == ACTIVE_CAPACITY:
                continue
            warm.key[last], warm.body[last], warm.multiplier[last] = 0, part_of(pairs.body[i, h]), pairs.multiplier[i]
            for j in range(3):
                warm.normal[j, last], warm.point[j, last] = sign * pairs.normal[i, j], 0.0
            warm.count += 1
