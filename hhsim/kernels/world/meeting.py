"""Pairs of bodies of hands: what keeps two hands out of each other, and a hand's own parts, in the program of all.

Both hands are as the first body sees them, in whose frame their variables are. The row of a pair may have fingers of
both hands, or two fingers of one: it is a dense one (`kernels.qp.row_scan`). The rows of two hands come first, then
those of each hand's own pairs.
"""

import math
from typing import Any

import numpy as np

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
from hhsim.kernels.contact.linearise import LIMIT_ROWS, limit_start
from hhsim.kernels.contact.self_pairs import SELF_PAIRS, WHOLE_PALM, SelfPairs, scale_rows
from hhsim.kernels.hand.kinematics import DOF, FINGER_COUNT, PHALANX_COUNT
from hhsim.kernels.jit import Record, as_bool, as_int64, jit, jit_inline, jit_noinline, jit_pasted
from hhsim.kernels.qp.active_set import QpWork
from hhsim.kernels.tick.options import TickOptions
from hhsim.kernels.tick.state import WORK_ROWS, WORK_UNITS
from hhsim.kernels.tick.step import ACTIVE_CAPACITY
from hhsim.kernels.world.columns import States, common_count, hand_count, is_still, palm_column

SEEN = 0.02
"""Distance up to which two hands are measured [m]: they are looked at again when their motions may have used it up."""
MEETING_KEYS = -100
"""Keys of dense rows go down from here: below those of the fingers' limits, and above those of joints."""
DEEP = 1e-3
"""Hands that parts have pushed deeper into each other than this [m] are parted along the line of their palms, whatever
is deeper meanwhile: there the normals of their pairs contradict each other."""
OTHER_HAND = 1 << 62
"""Key of a force of the other hand among a hand's active contacts: no contact has it, and no guess takes it for one."""
UNITS_ROUND = 25_000
"""Work units of a program more for pairs that the step of the one before would bring together."""
RECALL, ADD, SHARE, APART, LOAD = map(as_int64, range(5))
"""What `do_hands` is asked to do."""


@jit_pasted
def hands_of(movers: Any, states: States, world: Record) -> Any:
    """Return both hands and their states, as `kernels.contact.hand_pairs` takes them."""
    # Dynamic indices: with one hand there is no second mover, and this is never run.
    last = hand_count(world.problem) - 1
    return (movers[0], movers[last]), (states[0], states[last])


@jit_noinline
def keep_meetings(movers: Any, states: States, world: Record) -> None:
    """Begin a program with the rows that bore a force in the one before."""
    pairs = world.meeting
    hands, two = hands_of(movers, states, world)
    held, pairs.count = pairs.count, 0
    for i in range(held):
        if pairs.multiplier[i] > 0.0 and world.kept_apart >= -DEEP:
            add_hand_row(hands, two, pairs.body[i, 0], pairs.body[i, 1], pairs.multiplier[i], pairs)


@jit
def most_motion(states: States, world: Record) -> float:
    """Return a bound of how much nearer any points of two hands come to each other in the step at hand [m]."""
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
    spread_fingers(states, world.problem)
    world.may_meet = world.apart <= offset + most_motion(states, world)
    return as_bool(world.may_meet == 1)


@jit_noinline
def add_meetings(movers: Any, options: TickOptions, states: States, world: Record) -> bool:
    """Add rows of pairs that the step at hand would bring together; return whether one is new."""
    pairs = world.meeting
    hands, two = hands_of(movers, states, world)
    bound_motions(hands, two, pairs)
    look_at_pairs(hands, two, world.seen, world.within, options.offset, pairs)
    world.apart = min(pairs.least, world.seen)
    return as_bool(world.kept_apart >= -DEEP and add_broken_pairs(hands, two, options.offset, pairs))


@jit
def stay_apart(fraction: float, states: States, world: Record) -> bool:
    """Return whether the hands are known to be out of each other after a share of a step."""
    world.apart -= fraction * most_motion(states, world)
    return as_bool(world.apart > 0.0)


@jit_noinline
def measure_hands(movers: Any, states: States, world: Record) -> float:
    """Compute the distance of the hands [m], negative if they are in each other, up to `seen` of the world."""
    hands, two = hands_of(movers, states, world)
    world.apart = min(hands_nearest(hands, two, world.seen, world.meeting), world.seen)
    return float(world.apart)


@jit
def part_targets(states: States, problem: Record, held: float) -> None:
    """Let the targets of hands deep in each other lead out of it along the line of their palms."""
    first, second = states[0].pose.position, states[1].pose.position
    between = math.sqrt((first[0] - second[0]) ** 2 + (first[1] - second[1]) ** 2 + (first[2] - second[2]) ** 2)
    problem.hand_target[:] = 0.0
    problem.abduction_step[:] = 0.0
    for j in range(3):
        away = -0.5 * held * (first[j] - second[j]) / max(between, DEEP)
        problem.hand_target[j], problem.hand_target[DOF + j] = away, -away


@jit
def spread_fingers(states: States, problem: Record) -> None:
    """Give each hand its abduction step of the program."""
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


@jit_inline
def _begin_dense(row: int, problem: Record) -> int:
    """Begin a dense row with zeros; return its place among those."""
    i = row - problem.dense_row
    for j in range(common_count(problem)):
        problem.common[j, row] = 0.0
    for j in range(problem.dense.shape[1]):
        problem.dense[i, j] = 0.0
    problem.key[row] = MEETING_KEYS - i
    problem.owner[row] = -1
    problem.kind[row] = 0
    return as_int64(i)


@jit
def dense_rows(states: States, pairs: Record, offset: float, relaxed: bool, row: int, problem: Record) -> int:
    """Write the rows of pairs of hands' bodies from a row on, and return the one behind them."""
    hands, fingers = hand_count(problem), PHALANX_COUNT * FINGER_COUNT
    common, dense, weight = problem.common, problem.dense, problem.inverse_root
    problem.dense_row = row
    spread_fingers(states, problem)
    for r in range(pairs.count if hands > 1 else 0):
        i = _begin_dense(row, problem)
        for h in range(2):
            palm = palm_column(problem, as_int64(h))
            for j in range(6):
                common[palm + j, row] = pairs.gradient[r, DOF * h + j] * weight[j]
            for j in range(fingers):
                dense[i, fingers * h + j] = pairs.gradient[r, DOF * h + 6 + j] * weight[6 + j]
        problem.rhs[row] = row_rest(offset, (states[0], states[hands - 1]), as_int64(r), pairs)
        row += 1
    for h in range(hands):
        each = states[h]
        scale_rows(offset, relaxed, each)
        first = limit_start(each.contacts, as_int64(FINGER_COUNT))
        problem.own_row[h] = row
        for r in range(each.self_contact.count):
            i = _begin_dense(row, problem)
            for j in range(fingers):
                dense[i, fingers * h + j] = each.self_contact.dense[r, 6 + j]
            problem.rhs[row] = each.problem.rhs[first + r]
            row += 1
    problem.dense_rows = row - problem.dense_row
    return as_int64(row)


@jit
def guess_dense(states: States, problem: Record, pairs: Record, loaded: Record, filled: int) -> int:
    """Append the dense rows that bore a force to a guess; return its new length."""
    for r in range(pairs.count if hand_count(problem) > 1 else 0):
        if pairs.multiplier[r] > 0.0 and filled < ACTIVE_CAPACITY:
            loaded.guess[filled] = problem.dense_row + r
            filled += 1
    for h in range(hand_count(problem)):
        for r in range(states[h].self_contact.count):
            if problem.own_multiplier[h, r] > 0.0 and filled < ACTIVE_CAPACITY:
                loaded.guess[filled] = problem.own_row[h] + r
                filled += 1
    return filled


@jit
def read_dense(problem: Record, pairs: Record, qp: QpWork) -> None:
    """Read the multipliers of dense rows of a solution."""
    pairs.multiplier[:] = 0.0
    problem.own_multiplier[:] = 0.0
    for i in range(qp.counts[0]):
        row = qp.active[i]
        if not problem.dense_row <= row < problem.dense_row + problem.dense_rows:
            continue
        if row < problem.own_row[0]:
            pairs.multiplier[row - problem.dense_row] += qp.multiplier[i]
            continue
        h = as_int64(1 if hand_count(problem) > 1 and row >= problem.own_row[1] else 0)
        problem.own_multiplier[h, row - problem.own_row[h]] += qp.multiplier[i]


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
            warm.key[last], warm.body[last] = OTHER_HAND, part_of(pairs.body[i, h])
            warm.multiplier[last] = pairs.multiplier[i]
            for j in range(3):
                warm.normal[j, last], warm.point[j, last] = sign * pairs.normal[i, j], 0.0
            warm.count += 1


@jit
def bear_own(own: SelfPairs, state: Record, h: int, problem: Record) -> None:
    """Add the forces of a hand's own parts on each other to those on it, each with the name of its pair."""
    rows, warm = state.self_contact, state.warm
    for i in range(rows.count):
        force, last = problem.own_multiplier[h, i], warm.count
        if force == 0.0 or last + 1 >= ACTIVE_CAPACITY:
            continue
        pair = rows.pair[i]
        for side in range(2):
            at = last + side
            warm.key[at] = -1 - LIMIT_ROWS - pair - SELF_PAIRS * (rows.sphere[i] - WHOLE_PALM)
            warm.body[at] = own.first[pair] if side == 0 else own.second[pair]
            warm.multiplier[at] = force
            for j in range(3):
                warm.normal[j, at] = rows.normal[i, j] if side == 0 else -rows.normal[i, j]
                warm.point[j, at] = 0.0
        warm.count += 2


@jit
def do_hands(method: Any, asked: int, value: float) -> float:
    """Do one stage of a tick for two hands that may meet, with a share of the step.

    Returns a share, how far they are from what they keep [m], infinity if that is not known to be little, or 1 for yes.
    """
    world, states, options = method.world[0], method.states, method.options
    problem = world.problem
    if asked == RECALL:
        if world.meeting.count > 0:
            keep_meetings(method.movers, states, world)
        if world.kept_apart < -DEEP:
            part_targets(states, problem, world.kept_apart)
    elif asked == ADD:
        if not may_meet(options.offset, states, world):
            return 0.0
        met = add_meetings(method.movers, options, states, world)
        for h in range(hand_count(problem) if is_still(problem) else 0):
            each = states[h]
            each.work[WORK_UNITS] += UNITS_ROUND
            rows = problem.last[h] - problem.first[h] + world.meeting.count + each.self_contact.count
            each.work[WORK_ROWS] = max(each.work[WORK_ROWS], rows)
        return 1.0 if met else 0.0
    elif asked == SHARE:
        return share_of_meetings(states, world)
    elif asked == APART:
        if stay_apart(value, states, world):
            return np.inf
        apart = measure_hands(method.movers, states, world)
        return float(apart - world.kept_apart) if world.kept_apart >= -DEEP else 0.0
    elif asked == LOAD:
        bear_meetings(states, world)
    return 0.0
