"""Pairs of the parts of hands that may meet: how near they are, and the rows that keep them apart in a step.

A part is a phalanx, or the palm, whose spheres count as one; a body is a phalanx or one of these spheres. A pair is two
parts of one hand, or one of each: one list has all.

With p and q the nearest axis points of two bodies and n the normal from q to p, a step changes their distance by
n · (v_p - v_q), v the velocities of these points with their hands: a row has the variables of both hands, or the joints
of two fingers of one, whose palm moves both alike, and abduction on its right-hand side. The force of its multiplier is
n times it on the first body and the opposite on the second one.

A bound of each pair's distance goes down by what its parts have moved since: in the palm's frame a joint's angle times
its lever, and the palm's own motion against another hand. While the least bound less the largest of these ways is
enough, no pair is looked at.

Ticks call these kernels by their address, so that they do not contain what hands whose parts never meet do not run.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.arithmetic import sine_cosine
from hhsim.kernels.by_reference import by_reference
from hhsim.kernels.contact.linearise import LEVER_FLOOR, point_jacobian
from hhsim.kernels.hand.kinematics import (
    BODY_COUNT,
    DOF,
    FINGER_COUNT,
    PALM_BODY,
    PHALANX_COUNT,
    HandArrays,
    motion_bounds,
    phalanx_cone,
    placed_sphere,
    seen_cone,
)
from hhsim.kernels.hand.pose import HAND_POSE, copy_configuration, step_between, update_kinematics
from hhsim.kernels.jit import Array, Indices, Record, as_int64, jit, jit_inline, jit_noinline
from hhsim.kernels.machine_code import number_of_code
from hhsim.kernels.memory import copy_values
from hhsim.kernels.round_cone import RoundCone, round_cone_pair, round_cone_parameter

OWN_PAIRS = PHALANX_COUNT * PHALANX_COUNT * FINGER_COUNT * (FINGER_COUNT - 1) // 2 + PHALANX_COUNT * FINGER_COUNT
"""Most pairs of one hand."""
MOST_PAIRS = 2 * OWN_PAIRS + BODY_COUNT * BODY_COUNT
"""Most pairs of two hands."""
HAND_PAIR_ROWS = 128
"""Most rows in a program; what it lacks is found by the true distances."""
WORTH_A_ROW = 1e-3
"""Share of the clearance by which a step breaks a row that the program lacks before it is added."""
BEND = 1e-4
"""Largest rotation of a joint [rad] for a difference of gradients."""
EXACT = 1e-4
"""Least distances below this are no bounds [m]."""
BOUND_SKIN = 5e-4
"""Pairs up to this much farther are measured with them [m], so that bounds last for ticks."""
UNMOVED = 1e-12
"""Motion below what a program may leave a row broken by [m]: distances are as they were."""
STEEP = 0.5
"""Share of the coupling by which rows curve that are steep: so much of an error a program of flat rows leaves at least,
and beyond 1 it grows from tick to tick until a tick has enough programs for second derivatives."""
DEEP_HANDS = 1e-3
"""Hands that parts have pushed deeper into each other than this [m] are parted along the line of their palms, whatever
is deeper meanwhile: there the normals of their pairs contradict each other."""
OWN, CROSS = 0, 1
"""Kinds of pairs: of one hand, in whose palm's frame its parts move, and of two."""

HAND_PAIRS = np.dtype(
    [
        ("bound", np.float64, (MOST_PAIRS,)),  # no pair was nearer at the bounds [m]; a small one is the distance
        ("floor", np.float64, (2,)),  # least of these of each kind [m], infinite without pairs
        ("least", np.float64, (2,)),  # no pair is nearer where the hands are [m]; the floor at the bounds
        ("start", HAND_POSE, (2,)),  # the hands at the bounds, without what follows from their angles
        ("moved", np.float64, (2, 2, BODY_COUNT)),  # bound of each part's motion since, by hand and kind [m]
        ("motion", np.float64, (2, 2, BODY_COUNT)),  # the same of the step at hand
        ("step", np.float64, (DOF,)),  # scratch
        ("spread_step", np.float64, (FINGER_COUNT,)),
        ("turn", np.float64, (3,)),
        ("kept", np.float64),  # distance of two hands that steps keep [m]: below 0 where parts push one into another
        ("within", np.float64, (2,)),  # of pairs farther apart than this no row is sought [m]
        ("count", np.int64),  # rows in the program
        ("crossing", np.int64),  # those of pairs of two hands
        ("pair", np.int64, (HAND_PAIR_ROWS,)),  # of each row
        ("hand", np.int64, (HAND_PAIR_ROWS, 2)),  # of its bodies
        ("body", np.int64, (HAND_PAIR_ROWS, 2)),  # 0 to 14, or 15 and on for the palm's spheres
        ("multiplier", np.float64, (HAND_PAIR_ROWS,)),  # [N]
        ("distance", np.float64, (HAND_PAIR_ROWS + 1,)),  # [m]; as what follows with one row more, to try a pair
        ("normal", np.float64, (HAND_PAIR_ROWS + 1, 3)),  # unit, from the second body to the first
        ("gradient", np.float64, (HAND_PAIR_ROWS + 1, 2, DOF)),  # of the distance by each hand's variables [1, m/rad]
        ("spread", np.float64, (HAND_PAIR_ROWS + 1, 2, FINGER_COUNT)),  # and by the fingers' abduction
        ("bent", HAND_POSE),  # a hand a little farther along a step, for second derivatives
    ],
    align=True,
)
"""Pairs from tick to tick, and their rows in the program."""

HAND_CONTACT = np.dtype(
    [
        ("least", np.float64),  # no pair is nearer than this, and than what steps keep [m]; infinite without pairs
        ("rows", np.int64),  # number of the program's rows that are of this hand
        ("has_row", np.int64, (FINGER_COUNT,)),  # 1 for fingers with a row
        ("holds", np.bool_),  # the abduction step was reduced to what a pair has room for
        ("bends", np.bool_),  # the rows of its own pairs have second derivatives in the program at hand
        ("steep", np.bool_),  # they have had a force since they curved by more than STEEP: flat, they would not do
    ],
    align=True,
)
"""What a hand's own tick knows of its parts' pairs."""


@by_reference
class PartPairs(NamedTuple):
    """Pairs of parts that may meet, a phalanx first unless both are palms."""

    hand: Indices  # of each part, 0 or 1, (N, 2)
    part: Indices  # 0 to 14, or 15 for the palm, (N, 2)


@by_reference
class HandPairs(NamedTuple):
    """Pairs of the parts of one or two hands, and where they are kept."""

    hand: Indices  # as of `PartPairs`
    part: Indices
    hands: int
    first_hand: HandArrays
    second_hand: HandArrays  # the first hand's where there is but one
    states: NDArray[np.void]  # of each hand, `kernels.tick.state`
    rows: NDArray[np.void]  # one record of HAND_PAIRS


@by_reference
class PairsCode(NamedTuple):
    """Pairs as ticks take them: their address, and what is done with them, by `code_of`; 0 where no parts meet."""

    address: int = 0
    stages: int = 0  # of `do_pairs`
    curvature: int = 0  # of `add_bends`


NO_PAIRS = PairsCode()
"""In place of the pairs of a hand whose parts go through each other."""
MEASURE_PAIRS, KEEP_LOADED_ROWS, ADD_ROWS, CLEAR_SHARE, CROSS_SHARE = map(as_int64, range(5))
"""What `ask_pairs` is asked to do."""


@jit_inline
def ask_pairs(code: PairsCode, asked: int, length: float, radius: float) -> float:
    """Do a stage as `do_pairs` does; without pairs return 1 for CLEAR_SHARE, and 0 for all others."""
    if code.stages == 0:
        return 1.0 if asked == CLEAR_SHARE else 0.0
    return number_of_code(code.stages, (code.address, as_int64(asked), length, radius))


@jit_inline
def _hand(pairs: HandPairs, h: int) -> HandArrays:
    return pairs.first_hand if h == 0 else pairs.second_hand


@jit_inline
def _body(hand: HandArrays, pose: Record, body: int) -> RoundCone:
    if body < PALM_BODY:
        return phalanx_cone(hand, pose.joints, pose.direction, body // PHALANX_COUNT, body % PHALANX_COUNT)
    i = body - PALM_BODY
    x, y, z = hand.palm_x[i], hand.palm_y[i], hand.palm_z[i]
    return placed_sphere(pose.position, pose.rotation, x, y, z, hand.palm_radius[i])


@jit_inline
def _sphere_distance(cone: RoundCone, x: float, y: float, z: float, radius: float) -> float:
    """Compute the signed distance [m] of a round cone and a sphere."""
    dx, dy, dz = x - cone.x, y - cone.y, z - cone.z
    s = round_cone_parameter(dx, dy, dz, cone.ux, cone.uy, cone.uz, cone.tan_slope, cone.inverse_length)
    along = s * cone.length
    dx, dy, dz = dx - along * cone.ux, dy - along * cone.uy, dz - along * cone.uz
    return math.sqrt(dx * dx + dy * dy + dz * dz) - radius - cone.radius + s * cone.drop


@jit_inline
def _next_sphere(hand: HandArrays, cone: RoundCone, limit: float, after: int) -> tuple[int, float]:
    """Find the next palm sphere nearer than `limit` [m] to a cone of the palm frame; its number, -1 for none."""
    group, start = hand.palm_group, hand.palm_group_start
    for g in range(group.shape[1]):
        if start[g + 1] <= after:
            continue
        if _sphere_distance(cone, group[0, g], group[1, g], group[2, g], group[3, g]) >= limit:
            continue
        for i in range(max(start[g], after), start[g + 1]):
            distance = _sphere_distance(cone, hand.palm_x[i], hand.palm_y[i], hand.palm_z[i], hand.palm_radius[i])
            if distance < limit:
                return i, distance
    return as_int64(-1), limit


@jit
def next_bodies(
    hand: HandArrays,
    pose: Record,
    other_hand: HandArrays,
    other_pose: Record,
    part: int,
    other_part: int,
    limit: float,
    body: int,
    other: int,
) -> tuple[int, int, float]:
    """Find the next two bodies of a pair of parts that are nearer than `limit` [m]; return them and their distance.

    They come after `body` and `other`, at first -1; the first one is -1 where there are no more. Poses are up to date.
    """
    last = part if part < PALM_BODY else PALM_BODY + hand.palm_radius.shape[0] - 1
    for i in range(max(body, part), last + 1):
        cone = _body(hand, pose, i)
        after = other if i == body else as_int64(-1)
        if other_part == PALM_BODY:
            first = max(after + 1 - PALM_BODY, 0)
            sphere, distance = _next_sphere(other_hand, seen_cone(other_pose, cone), limit, first)
            if sphere >= 0:
                return as_int64(i), PALM_BODY + sphere, distance
        elif after < other_part:
            distance = round_cone_pair(cone, _body(other_hand, other_pose, other_part))[0]
            if distance < limit:
                return as_int64(i), other_part, distance
    return as_int64(-1), as_int64(-1), limit


@jit
def part_distance(
    hand: HandArrays, pose: Record, other_hand: HandArrays, other_pose: Record, part: int, other_part: int
) -> float:
    """Compute the signed distance [m] of two parts, 0 to 15 each, a phalanx first unless both are palms."""
    nearest, body, other = np.inf, as_int64(-1), as_int64(-1)
    while True:
        arguments = (hand, pose, other_hand, other_pose, part, other_part)
        body, other, distance = next_bodies(*arguments, nearest, body, other)
        if body < 0:
            return nearest
        nearest = distance


@jit
def hands_distance(pairs: PartPairs, hand: HandArrays, pose: Record, other_hand: HandArrays, other: Record) -> float:
    """Compute the least signed distance [m] of pairs of two hands."""
    least = np.inf
    for pair in range(pairs.part.shape[0]):
        part, other_part = pairs.part[pair, 0], pairs.part[pair, 1]
        if pairs.hand[pair, 0] == 0:
            least = min(least, part_distance(hand, pose, other_hand, other, part, other_part))
        else:
            least = min(least, part_distance(other_hand, other, hand, pose, part, other_part))
    return least


@jit_inline
def _distance(pairs: HandPairs, pair: int) -> float:
    h, k = pairs.hand[pair, 0], pairs.hand[pair, 1]
    part, other_part = pairs.part[pair, 0], pairs.part[pair, 1]
    return part_distance(_hand(pairs, h), pairs.states[h].pose, _hand(pairs, k), pairs.states[k].pose, part, other_part)


@jit_inline
def _motions(
    pairs: HandPairs, h: int, step: Array, abduction_step: Array, enough: float, motion_out: Array
) -> tuple[float, float]:
    """Bound the motion of a hand's parts in a step, shape (2, 16); return the most by which it brings parts nearer.

    That is of two of its own, in the palm's frame, and of one and what stands still [m]; `enough` as of
    `motion_bounds`.
    """
    hand, own, largest, most = _hand(pairs, h), motion_out[OWN], 0.0, 0.0
    own[PALM_BODY] = 0.0
    for f in range(FINGER_COUNT):
        for k in range(PHALANX_COUNT):
            total = abs(abduction_step[f]) * hand.lever[f, k, 0]
            for i in range(k + 1):
                total += abs(step[6 + PHALANX_COUNT * f + i]) * hand.lever[f, k, i]
            own[PHALANX_COUNT * f + k] = total
            # A bound that is no number is not to be lost.
            largest = largest if total <= largest else total
    if pairs.hands > 1:
        motion_bounds(hand, pairs.states[h].pose, step, abduction_step, enough, motion_out[CROSS])
        for part in range(BODY_COUNT):
            motion = motion_out[CROSS, part]
            most = most if motion <= most else motion
    return 2.0 * largest, most


@jit
def _motions_since(pairs: HandPairs) -> tuple[float, float]:
    """Bound the motions since the bounds; return the most by which pairs of one hand and of two come nearer [m]."""
    rows, own, cross = pairs.rows[0], 0.0, 0.0
    for h in range(pairs.hands):
        start, pose, step, spread = rows.start[h], pairs.states[h].pose, rows.step[:], rows.spread_step[:]
        if pairs.hands > 1:
            step_between(start, pose, step, spread, rows.turn[:])
        else:
            for f in range(FINGER_COUNT):
                spread[f] = pose.abduction[f] - start.abduction[f]
                for k in range(PHALANX_COUNT):
                    step[6 + PHALANX_COUNT * f + k] = pose.flexion[f, k] - start.flexion[f, k]
        fingers, most = _motions(pairs, h, step, spread, np.inf, rows.moved[h])
        own, cross = own if fingers <= own else fingers, cross + most
    return own, cross


@jit
def _step_motions(pairs: HandPairs) -> tuple[float, float]:
    """Bound the motions of the step at hand; returns as `_motions_since`."""
    rows, own, cross = pairs.rows[0], 0.0, 0.0
    enough = 0.5 * rows.least[CROSS]
    for h in range(pairs.hands):
        state = pairs.states[h]
        delta, abduction = state.step.delta[:], state.problem.abduction_step[:]
        fingers, most = _motions(pairs, h, delta, abduction, enough, rows.motion[h])
        own, cross = own if fingers <= own else fingers, cross + most
    return own, cross


@jit_inline
def _kind(pairs: HandPairs, pair: int) -> int:
    return OWN if pairs.hand[pair, 0] == pairs.hand[pair, 1] else CROSS


@jit_inline
def _closing(pairs: HandPairs, pair: int, motion: Array) -> float:
    """Return how much nearer the parts of a pair come at most by motions of all parts, (2, 2, 16) [m]."""
    hand, part, kind = pairs.hand[pair], pairs.part[pair], _kind(pairs, pair)
    return motion[hand[0], kind, part[0]] + motion[hand[1], kind, part[1]]


@jit_noinline
def _update_bounds(pairs: HandPairs, reach: float) -> None:
    """Bring the bounds to where the hands are, by the motion since; those below `reach` are then distances."""
    rows = pairs.rows[0]
    for h in range(pairs.hands):
        copy_configuration(pairs.states[h].pose, rows.start[h])
    rows.floor[:] = np.inf
    for pair in range(pairs.part.shape[0]):
        bound, kind = rows.bound[pair] - _closing(pairs, pair, rows.moved), _kind(pairs, pair)
        # Not below, or a bound that is no number would be kept.
        if not bound >= reach:
            bound = _distance(pairs, pair)
        rows.bound[pair] = bound
        rows.floor[kind] = min(rows.floor[kind], bound)
    rows.least[OWN], rows.least[CROSS] = rows.floor[OWN], rows.floor[CROSS]


@jit
def measure_pairs(pairs: HandPairs, exact: float) -> None:
    """Compute the least distances of pairs where hands are, or bounds of them that are not below `exact` [m]."""
    rows = pairs.rows[0]
    own, cross = _motions_since(pairs)
    rows.least[OWN], rows.least[CROSS] = rows.floor[OWN] - own, rows.floor[CROSS] - cross
    known = rows.least[OWN] >= exact or (own <= UNMOVED and rows.least[OWN] >= 0.0)
    if not (known and (rows.least[CROSS] >= exact or (cross <= UNMOVED and rows.least[CROSS] >= 0.0))):
        _update_bounds(pairs, exact + BOUND_SKIN)
    # Hands deep in each other are not judged by their distance.
    cross = rows.least[CROSS] - rows.kept if rows.kept >= -DEEP_HANDS else np.inf
    for h in range(pairs.hands):
        pairs.states[h].hand_contact.least = min(rows.least[OWN], cross)


@jit_inline
def _at_the_bounds(pairs: HandPairs, exact: float) -> None:
    """Let the bounds be those of where the hands are, and distances below `exact` [m]."""
    rows = pairs.rows[0]
    if rows.least[OWN] != rows.floor[OWN] or rows.least[CROSS] != rows.floor[CROSS]:
        measure_pairs(pairs, exact)


@jit
def self_clearances(
    hand: HandArrays, pairs: PartPairs, flexion: Array, abduction: Array, poses: NDArray[np.void], clearance_out: Array
) -> None:
    """Compute the least signed distance [m] of T hands' own parts, shape (T,), or a lower bound that is not negative.

    Flexion (T, 5, 3), abduction (T, 5) [rad]; NaN where not finite. Workspace: `poses`, (1,), and (T,) of the result.
    """
    pose = poses[0]
    for t in range(flexion.shape[0]):
        copy_values(flexion[t], pose.flexion[:])
        copy_values(abduction[t], pose.abduction[:])
        update_kinematics(hand, pose)
        # What is not finite makes the sum no number.
        total = 0.0
        for f in range(FINGER_COUNT):
            total += abduction[t, f] + flexion[t, f, 0] + flexion[t, f, 1] + flexion[t, f, 2]
        clearance_out[t] = hands_distance(pairs, hand, pose, hand, pose) + 0.0 * total


@jit
def _write_cones(
    poses: tuple[Record, Record],
    hands: tuple[int, int],
    bodies: tuple[int, int],
    cones: tuple[RoundCone, RoundCone],
    floors: tuple[float, float],
    row: int,
    rows: Record,
) -> None:
    """Write distance, normal and gradient of two bodies to a row; `floors` [m] are as of `point_jacobian`."""
    normal = rows.normal[row]
    rows.distance[row], s, t, normal[0], normal[1], normal[2] = round_cone_pair(cones[0], cones[1])
    for h in range(2):
        for j in range(DOF):
            rows.gradient[row, h, j] = 0.0
        for f in range(FINGER_COUNT):
            rows.spread[row, h, f] = 0.0
    # How the point of each body moves along the normal with its hand.
    for side in range(2):
        pose, hand, cone, sign = poses[side], hands[side], cones[side], 1.0 if side == 0 else -1.0
        along, gradient = (s if side == 0 else t) * cone.length, rows.gradient[row, hand]
        x, y, z = cone.x + along * cone.ux, cone.y + along * cone.uy, cone.z + along * cone.uz
        nx, ny, nz = sign * normal[0], sign * normal[1], sign * normal[2]
        if bodies[side] < PALM_BODY:
            spread = rows.spread[row, hand]
            point_jacobian(pose, bodies[side], (x, y, z), (nx, ny, nz), floors[side], gradient, spread)
        if hands[0] != hands[1]:
            rx, ry, rz = x - pose.position[0], y - pose.position[1], z - pose.position[2]
            gradient[0], gradient[1], gradient[2] = nx, ny, nz
            gradient[3], gradient[4], gradient[5] = ry * nz - rz * ny, rz * nx - rx * nz, rx * ny - ry * nx


@jit_inline
def _least_lever(hand: HandArrays, body: int) -> float:
    return LEVER_FLOOR * hand.length[body // PHALANX_COUNT, 0] if body < PALM_BODY else 0.0


@jit
def write_row(pairs: HandPairs, pair: int, body: int, other: int, row: int) -> None:
    """Write distance, normal and gradient of two bodies of a pair to a row."""
    h, k = pairs.hand[pair, 0], pairs.hand[pair, 1]
    poses, first, second = (pairs.states[h].pose, pairs.states[k].pose), _hand(pairs, h), _hand(pairs, k)
    cones = _body(first, poses[0], body), _body(second, poses[1], other)
    floors = _least_lever(first, body), _least_lever(second, other)
    _write_cones(poses, (h, k), (body, other), cones, floors, row, pairs.rows[0])


@jit_inline
def row_rest(offset: float, states: Any, hands: int, row: int, rows: Record) -> float:
    """Compute the right-hand side of a row [m]: what the variables must bring after the abduction step.

    A row keeps the offset; relaxed, what is nearer may stay as near as it is.
    """
    distance = rows.distance[row]
    relaxed = states[0].fallback.is_relaxed and distance >= 0.0
    rest = (min(offset, distance) if relaxed else offset) - distance
    for h in range(hands):
        for f in range(FINGER_COUNT):
            rest -= rows.spread[row, h, f] * states[h].problem.abduction_step[f]
    return rest


@jit
def _leave_room(pairs: HandPairs, offset: float, row: int) -> None:
    """Reduce the abduction, which is given, to what brings the pair no nearer than the offset, if nothing else can."""
    rows = pairs.rows[0]
    closing, opening, excess = 0.0, max(rows.distance[row] - offset, 0.0), 0.0
    for h in range(pairs.hands):
        for f in range(FINGER_COUNT):
            rate = rows.spread[row, h, f] * pairs.states[h].problem.abduction_step[f]
            closing -= min(rate, 0.0)
            opening += max(rate, 0.0)
            excess += rows.spread[row, h, f] ** 2
        for j in range(DOF):
            excess -= rows.gradient[row, h, j] ** 2
    if not (closing > opening and excess > 0.0):
        return
    for h in range(pairs.hands):
        state = pairs.states[h]
        for f in range(FINGER_COUNT):
            if rows.spread[row, h, f] * state.problem.abduction_step[f] < 0.0:
                state.problem.abduction_step[f] *= opening / closing
                state.hand_contact.holds = True


@jit
def _add_row(pairs: HandPairs, pair: int, body: int, other: int, multiplier: float, offset: float) -> bool:
    """Add the row of two bodies of a pair; False where there is no room."""
    rows, row = pairs.rows[0], pairs.rows[0].count
    if row == HAND_PAIR_ROWS:
        return False
    write_row(pairs, pair, body, other, row)
    rows.pair[row], rows.multiplier[row] = pair, multiplier
    rows.body[row, 0], rows.body[row, 1] = body, other
    rows.hand[row, 0], rows.hand[row, 1] = pairs.hand[pair, 0], pairs.hand[pair, 1]
    rows.count += 1
    rows.crossing += _kind(pairs, pair)
    for side in range(2):
        hand_contact = pairs.states[rows.hand[row, side]].hand_contact
        hand_contact.rows += 1
        if rows.body[row, side] < PALM_BODY:
            hand_contact.has_row[rows.body[row, side] // PHALANX_COUNT] = 1
    _leave_room(pairs, offset, row)
    return True


@jit
def keep_loaded_rows(pairs: HandPairs, offset: float) -> None:
    """Begin a program with the rows that bore a force in the one before."""
    rows, last_count = pairs.rows[0], pairs.rows[0].count
    rows.count = rows.crossing = 0
    for h in range(pairs.hands):
        hand_contact = pairs.states[h].hand_contact
        hand_contact.rows, hand_contact.holds = 0, False
        hand_contact.has_row[:] = 0
    for i in range(last_count):
        pair = rows.pair[i]
        if rows.multiplier[i] > 0.0 and (rows.kept >= -DEEP_HANDS or _kind(pairs, pair) == OWN):
            _add_row(pairs, pair, rows.body[i, 0], rows.body[i, 1], rows.multiplier[i], offset)
    for h in range(pairs.hands):
        hand_contact = pairs.states[h].hand_contact
        hand_contact.steep = hand_contact.steep and hand_contact.rows > 0


@jit
def _has_row(rows: Record, pair: int, body: int, other: int) -> bool:
    found = False
    for i in range(rows.count):
        found = found or (rows.pair[i] == pair and rows.body[i, 0] == body and rows.body[i, 1] == other)
    return found


@jit
def _add_worst(pairs: HandPairs, pair: int, limit: float, offset: float) -> bool:
    """Add the row of the bodies nearer than `limit` [m] that the step breaks most of those that the program lacks."""
    rows, row, worst = pairs.rows[0], as_int64(HAND_PAIR_ROWS), WORTH_A_ROW * offset
    h, k, part, other_part = pairs.hand[pair, 0], pairs.hand[pair, 1], pairs.part[pair, 0], pairs.part[pair, 1]
    first, second = _hand(pairs, h), _hand(pairs, k)
    body, other, worst_body, worst_other = as_int64(-1), as_int64(-1), as_int64(-1), as_int64(-1)
    while True:
        poses = pairs.states[h].pose, pairs.states[k].pose
        body, other, _ = next_bodies(first, poses[0], second, poses[1], part, other_part, limit, body, other)
        if body < 0:
            break
        write_row(pairs, pair, body, other, row)
        short = row_rest(offset, pairs.states, pairs.hands, row, rows)
        for hand in range(pairs.hands):
            for j in range(DOF):
                short -= rows.gradient[row, hand, j] * pairs.states[hand].step.delta[j]
        if short > worst and not _has_row(rows, pair, body, other):
            worst, worst_body, worst_other = short, body, other
    return worst_body >= 0 and _add_row(pairs, pair, worst_body, worst_other, 0.0, offset)


@jit
def add_rows(pairs: HandPairs, offset: float) -> bool:
    """Add a row of each pair that the step at hand would bring nearer than the offset; return whether one is new."""
    rows, added = pairs.rows[0], False
    own, cross = _step_motions(pairs)
    if rows.least[OWN] >= own + offset - UNMOVED and rows.least[CROSS] >= cross + offset - UNMOVED:
        return False
    _at_the_bounds(pairs, max(own, cross) + offset)
    for pair in range(pairs.part.shape[0]):
        kind = _kind(pairs, pair)
        limit = min(_closing(pairs, pair, rows.motion) + offset, rows.within[kind])
        if rows.bound[pair] <= limit and (kind == OWN or rows.kept >= -DEEP_HANDS):
            added = _add_worst(pairs, pair, limit, offset) or added
    return added


@jit
def clear_share(pairs: HandPairs, kind: int, extra: float, radius: float) -> float:
    """Return the share of the step that moves parts by no more than they are apart, less `extra`, or `radius` [m].

    With `kind` CROSS it is that of pairs of two hands alone.
    """
    rows, fraction = pairs.rows[0], 1.0
    own, cross = _step_motions(pairs)
    own = own if kind == OWN else 0.0
    if own <= max(rows.least[OWN] - extra, radius) and cross <= max(rows.least[CROSS] - extra, radius):
        return fraction
    _at_the_bounds(pairs, max(own, cross) + extra)
    for pair in range(pairs.part.shape[0]):
        moved = _closing(pairs, pair, rows.motion)
        if _kind(pairs, pair) >= kind and fraction * moved > max(rows.bound[pair] - extra, radius):
            rows.bound[pair] = _distance(pairs, pair)
            fraction = min(fraction, max(rows.bound[pair] - extra, radius) / moved)
    return fraction


@jit
def do_pairs(pairs: HandPairs, asked: int, length: float, radius: float) -> float:
    """Do one stage of a tick for pairs, with a length of its own and a trust radius [m].

    Returns the share of the step for CLEAR_SHARE, for CROSS_SHARE that of pairs of two hands alone, and 1 for ADD_ROWS
    where a row is new; else 0.
    """
    if asked == MEASURE_PAIRS:
        measure_pairs(pairs, length)
    elif asked == KEEP_LOADED_ROWS:
        keep_loaded_rows(pairs, length)
    elif asked == ADD_ROWS:
        return 1.0 if add_rows(pairs, length) else 0.0
    elif asked >= CLEAR_SHARE:
        return clear_share(pairs, OWN if asked == CLEAR_SHARE else CROSS, length, radius)
    return 0.0


@jit
def _bend(hand: HandArrays, pose: Record, finger: int, share: float, step: Array, bent: Record) -> None:
    """Write a finger bent by a share of a step: each phalanx is turned about the axis by the joints before it."""
    axis, angle = pose.axis[finger], 0.0
    ax, ay, az = axis[0], axis[1], axis[2]
    copy_values(axis, bent.axis[finger])
    copy_values(pose.abduction_axis[finger], bent.abduction_axis[finger])
    copy_values(pose.joints[finger, 0], bent.joints[finger, 0])
    for k in range(PHALANX_COUNT):
        angle += share * step[6 + PHALANX_COUNT * finger + k]
        sine, cosine = sine_cosine(angle)
        u, turned = pose.direction[finger, k], bent.direction[finger, k]
        turned[0] = cosine * u[0] + sine * (ay * u[2] - az * u[1])
        turned[1] = cosine * u[1] + sine * (az * u[0] - ax * u[2])
        turned[2] = cosine * u[2] + sine * (ax * u[1] - ay * u[0])
        for j in range(3):
            bent.joints[finger, k + 1, j] = bent.joints[finger, k, j] + hand.length[finger, k] * turned[j]


@jit
def add_bends(
    pairs: HandPairs, h: int, first: int, row: Indices, force: Array, inverse_root: Array, step: Array, product: Array
) -> None:
    """Add Σ λ ∇²d · step over the rows of pairs of a hand's own phalanges; `first` is the first of all, λ the force.

    See `curvature_product`. The spheres of the palm count as flat. `inverse_root` is 1 / √G of the hand's variables, by
    which rows are found to be steep.
    """
    # By the difference of gradients a little farther on: two nearest points that slide make a long closed form.
    rows, hand, state = pairs.rows[0], _hand(pairs, h), pairs.states[h]
    bent, most, bends = rows.bent, 0.0, False
    for j in range(6, DOF):
        most = max(most, abs(step[j]))
    for i in range(row.shape[0]):
        bends = bends or first <= row[i] < first + rows.count
    if not bends or most == 0.0:
        return
    share, last, along, square = BEND / most, as_int64(HAND_PAIR_ROWS), 0.0, 0.0
    for f in range(FINGER_COUNT):
        _bend(hand, state.pose, f, share, step, bent)
    for i in range(row.shape[0]):
        r = row[i] - first
        if not 0 <= r < rows.count or rows.hand[r, 0] != h or rows.hand[r, 1] != h or rows.body[r, 1] >= PALM_BODY:
            continue
        body, other = rows.body[r, 0], rows.body[r, 1]
        cones = _body(hand, bent, body), _body(hand, bent, other)
        _write_cones((bent, bent), (h, h), (body, other), cones, (0.0, 0.0), last, rows)
        for j in range(6, DOF):
            # A lever below the least one counts as none, which is no curvature.
            if rows.gradient[r, h, j] != 0.0:
                change = force[i] * (rows.gradient[last, h, j] - rows.gradient[r, h, j]) / share
                product[j] += change
                along += step[j] * change
    for j in range(6, DOF):
        square += (step[j] / inverse_root[j]) ** 2
    state.hand_contact.steep = state.hand_contact.steep or abs(along) > STEEP * square
