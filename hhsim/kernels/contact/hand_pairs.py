"""Pairs of bodies of two hands: how near they are, and the rows that keep them apart in a step.

A body is a phalanx or a sphere of the palm; a part is one of the 16 that move alike. With p and q the nearest axis
points of a pair and n the normal from q to p, a step changes its distance by n · (v_p - v_q), v the velocities of these
points with their hands: a row has the variables of both hands, and abduction on its right-hand side. The force of its
multiplier is n times it on the first hand and the opposite on the second one.
"""

import math
from typing import Any

import numpy as np

from hhsim.kernels.contact.linearise import LEVER_FLOOR, point_jacobian
from hhsim.kernels.contact.self_pairs import clearance_kept, in_palm_frame, sphere_distance
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
)
from hhsim.kernels.jit import Record, as_int64, jit, jit_inline, jit_noinline
from hhsim.kernels.round_cone import RoundCone, round_cone_pair

HAND_ROWS = 64
"""Most rows of such pairs in a program; what it lacks is found by the true distances."""
WORTH_A_ROW = 1e-3
"""Share of the clearance by which a step breaks a row that the program lacks before it is added."""

PARTS = (BODY_COUNT, BODY_COUNT)
HAND_PAIRS = np.dtype(
    [
        ("reach", np.float64, (2,)),  # radius of a ball around each palm's origin that holds the hand [m]
        ("motion", np.float64, (2, BODY_COUNT)),  # bound of each part's motion in the step at hand [m]
        ("nearest", np.float64, PARTS),  # distance of parts [m], infinite where the step cannot bring them together
        ("least", np.float64),  # least of these [m]
        ("worst", np.float64, PARTS),  # how far the step breaks the row of a pair of these parts that has none [m]
        ("worst_pair", np.int64, (*PARTS, 2)),  # its bodies
        ("count", np.int64),  # rows in the program
        ("body", np.int64, (HAND_ROWS, 2)),  # of each row; what is from here on has one row more, to try a pair
        ("distance", np.float64, (HAND_ROWS + 1,)),  # [m]
        ("normal", np.float64, (HAND_ROWS + 1, 3)),  # unit, from the second hand to the first
        ("gradient", np.float64, (HAND_ROWS + 1, 2 * DOF)),  # of the distance by the variables [1, m/rad]
        ("spread", np.float64, (HAND_ROWS + 1, 2, FINGER_COUNT)),  # and by the abduction
        ("multiplier", np.float64, (HAND_ROWS,)),  # [N]
    ],
    align=True,
)
"""Pairs of two hands, and their rows in a program of both."""


def hand_reach(hand: HandArrays) -> float:
    """Return the radius [m] of a ball around the palm's origin that holds the hand in every posture."""
    return float(max((hand.reach + hand.radius[:, :1]).max(), (hand.palm_reach + hand.palm_radius.max()).max()))


@jit_inline
def part_of(body: int) -> int:
    """Return the part, 0 to 15, that a body belongs to."""
    return min(body, PALM_BODY)


@jit_inline
def _body(hand: HandArrays, pose: Record, body: int) -> RoundCone:
    if body < PALM_BODY:
        return phalanx_cone(hand, pose.joints, pose.direction, body // PHALANX_COUNT, body % PHALANX_COUNT)
    i = body - PALM_BODY
    x, y, z = hand.palm_x[i], hand.palm_y[i], hand.palm_z[i]
    return placed_sphere(pose.position, pose.rotation, x, y, z, hand.palm_radius[i])


@jit
def _columns(
    hand: HandArrays, pose: Record, h: int, body: int, sign: float, x: float, y: float, z: float, row: int, rows: Record
) -> None:
    """Write how the distance changes with the variables of one hand, whose axis point (x, y, z) is the nearest."""
    normal, gradient = rows.normal[row], rows.gradient[row, DOF * h : DOF * h + DOF]
    nx, ny, nz = sign * normal[0], sign * normal[1], sign * normal[2]
    for j in range(DOF):
        gradient[j] = 0.0
    for f in range(FINGER_COUNT):
        rows.spread[row, h, f] = 0.0
    rx, ry, rz = x - pose.position[0], y - pose.position[1], z - pose.position[2]
    gradient[0], gradient[1], gradient[2] = nx, ny, nz
    gradient[3], gradient[4], gradient[5] = ry * nz - rz * ny, rz * nx - rx * nz, rx * ny - ry * nx
    if body >= PALM_BODY:
        return
    floor = LEVER_FLOOR * hand.length[body // PHALANX_COUNT, 0]
    point_jacobian(pose, body, (x, y, z), (nx, ny, nz), floor, gradient, rows.spread[row, h])


@jit
def write_hand_row(hands: Any, states: Any, first: int, second: int, row: int, rows: Record) -> None:
    """Write distance, normal and gradient of a pair to a row."""
    one, other = states[0].pose, states[1].pose
    cone, against = _body(hands[0], one, first), _body(hands[1], other, second)
    normal = rows.normal[row]
    rows.distance[row], s, t, normal[0], normal[1], normal[2] = round_cone_pair(cone, against)
    along = s * cone.length
    x, y, z = cone.x + along * cone.ux, cone.y + along * cone.uy, cone.z + along * cone.uz
    _columns(hands[0], one, as_int64(0), first, 1.0, x, y, z, row, rows)
    along = t * against.length
    x, y, z = against.x + along * against.ux, against.y + along * against.uy, against.z + along * against.uz
    _columns(hands[1], other, as_int64(1), second, -1.0, x, y, z, row, rows)


@jit_inline
def row_rest(offset: float, states: Any, row: int, rows: Record) -> float:
    """Compute the right-hand side of a row [m]: what the variables must bring after the abduction step."""
    rest = clearance_kept(states[0].program.is_relaxed, offset, rows.distance[row]) - rows.distance[row]
    for h in range(2):
        for f in range(FINGER_COUNT):
            rest -= rows.spread[row, h, f] * states[h].problem.abduction_step[f]
    return rest


@jit
def _try_pair(hands: Any, states: Any, first: int, second: int, offset: float, rows: Record) -> None:
    """Note a pair where the step breaks its row, which the program lacks, more than those of the same parts."""
    one, other, row = part_of(first), part_of(second), HAND_ROWS
    write_hand_row(hands, states, first, second, row, rows)
    short = row_rest(offset, states, row, rows)
    for h in range(2):
        for j in range(DOF):
            short -= rows.gradient[row, DOF * h + j] * states[h].step.delta[j]
    if short <= rows.worst[one, other]:
        return
    for i in range(rows.count):
        if rows.body[i, 0] == first and rows.body[i, 1] == second:
            return
    rows.worst[one, other] = short
    rows.worst_pair[one, other, 0], rows.worst_pair[one, other, 1] = first, second


@jit_inline
def bound_motions(hands: Any, states: Any, rows: Record) -> None:
    """Bound the motion of each part in the step at hand."""
    for h in range(2):
        state = states[h]
        delta, abduction = state.step.delta[:], state.problem.abduction_step[:]
        motion_bounds(hands[h], state.pose, delta, abduction, 0.0, rows.motion[h])


@jit_inline
def _is_over(bound: float, limit: float, within: float, tries: bool, part: int, other: int, rows: Record) -> bool:
    """Return whether a lower bound [m] of pairs of two parts is as good as their distances, and note it."""
    if bound > limit or (not tries and bound >= rows.nearest[part, other]):
        return True
    if bound > within:
        rows.nearest[part, other] = min(rows.nearest[part, other], bound)
        return True
    return False


@jit
def _against_palm(
    hands: Any, states: Any, first: int, seen: RoundCone, extra: float, within: float, offset: float, rows: Record
) -> None:
    """Look at the pairs of a body, as the second palm sees it, and that palm's spheres."""
    group, start, size = hands[1].palm_group, hands[1].palm_group_start, hands[1].palm_radius
    part, tries = part_of(first), offset < np.inf
    moves = rows.motion[0, part] + rows.motion[1, PALM_BODY]
    limit, broken = moves + extra, min(within, moves + offset)
    for g in range(group.shape[1]):
        bound = sphere_distance(seen, group[0, g], group[1, g], group[2, g], group[3, g])
        if _is_over(bound, limit, within, tries, part, PALM_BODY, rows):
            continue
        for s in range(start[g], start[g + 1]):
            distance = sphere_distance(seen, hands[1].palm_x[s], hands[1].palm_y[s], hands[1].palm_z[s], size[s])
            if distance <= limit:
                rows.nearest[part, PALM_BODY] = min(rows.nearest[part, PALM_BODY], distance)
                if tries and distance <= broken:
                    _try_pair(hands, states, first, PALM_BODY + s, offset, rows)


@jit
def _look_from_palm(hands: Any, states: Any, extra: float, within: float, offset: float, rows: Record) -> None:
    """Look at the pairs of the first palm's spheres, by balls that hold some of them first."""
    one, other, tries = states[0].pose, states[1].pose, offset < np.inf
    group, start, second = hands[0].palm_group, hands[0].palm_group_start, hands[1].palm_group
    for g in range(group.shape[1]):
        ball = placed_sphere(one.position, one.rotation, group[0, g], group[1, g], group[2, g], group[3, g])
        for j in range(PALM_BODY):
            cone, moves = _body(hands[1], other, as_int64(j)), rows.motion[0, PALM_BODY] + rows.motion[1, j]
            limit, broken = moves + extra, min(within, moves + offset)
            bound = sphere_distance(cone, ball.x, ball.y, ball.z, ball.radius)
            if _is_over(bound, limit, within, tries, PALM_BODY, j, rows):
                continue
            for s in range(start[g], start[g + 1]):
                sphere = _body(hands[0], one, PALM_BODY + s)
                distance = sphere_distance(cone, sphere.x, sphere.y, sphere.z, sphere.radius)
                if distance <= limit:
                    rows.nearest[PALM_BODY, j] = min(rows.nearest[PALM_BODY, j], distance)
                    if tries and distance <= broken:
                        _try_pair(hands, states, PALM_BODY + s, as_int64(j), offset, rows)
        seen, bound = in_palm_frame(other, ball), np.inf
        for k in range(second.shape[1]):
            bound = min(bound, sphere_distance(seen, second[0, k], second[1, k], second[2, k], second[3, k]))
        limit = rows.motion[0, PALM_BODY] + rows.motion[1, PALM_BODY] + extra
        if _is_over(bound, limit, within, tries, PALM_BODY, PALM_BODY, rows):
            continue
        for s in range(start[g], start[g + 1]):
            seen = in_palm_frame(other, _body(hands[0], one, PALM_BODY + s))
            _against_palm(hands, states, PALM_BODY + s, seen, extra, within, offset, rows)


@jit_noinline
def look_at_pairs(hands: Any, states: Any, extra: float, within: float, offset: float, rows: Record) -> None:
    """Compute distances of the parts of two hands, and find what the step at hand breaks.

    Parts that the step leaves farther apart than `extra` [m] are passed over. Of pairs farther apart than `within` [m]
    before it no row is tried, and a lower bound is as good. The clearance `offset` [m] is infinite where none is tried
    at all.
    """
    one, other, most, own = states[0].pose, states[1].pose, 0.0, 0.0
    rows.least = np.inf
    for i in range(BODY_COUNT):
        own, most = max(own, rows.motion[0, i]), max(most, rows.motion[1, i])
        for j in range(BODY_COUNT):
            rows.nearest[i, j], rows.worst[i, j] = np.inf, WORTH_A_ROW * offset
    px, py, pz = other.position[0], other.position[1], other.position[2]
    away = math.sqrt((one.position[0] - px) ** 2 + (one.position[1] - py) ** 2 + (one.position[2] - pz) ** 2)
    if away - rows.reach[0] - rows.reach[1] > own + most + extra:
        return
    for i in range(PALM_BODY):
        cone = _body(hands[0], one, as_int64(i))
        held = cone.length + cone.radius
        far = math.sqrt((cone.x - px) ** 2 + (cone.y - py) ** 2 + (cone.z - pz) ** 2) - held
        if far - rows.reach[1] > rows.motion[0, i] + most + extra:
            continue
        for j in range(PALM_BODY):
            f, k, moves = j // PHALANX_COUNT, j % PHALANX_COUNT, rows.motion[0, i] + rows.motion[1, j]
            joint, limit = other.joints[f, k], moves + extra
            x, y, z = cone.x - joint[0], cone.y - joint[1], cone.z - joint[2]
            sum_of_balls = held + hands[1].length[f, k] + hands[1].radius[f, 0] + limit
            if x * x + y * y + z * z > sum_of_balls * sum_of_balls:
                continue
            distance = round_cone_pair(cone, _body(hands[1], other, as_int64(j)))[0]
            if distance <= limit:
                rows.nearest[i, j] = min(rows.nearest[i, j], distance)
                if offset < np.inf and distance <= min(within, moves + offset):
                    _try_pair(hands, states, as_int64(i), as_int64(j), offset, rows)
        _against_palm(hands, states, as_int64(i), in_palm_frame(other, cone), extra, within, offset, rows)
    _look_from_palm(hands, states, extra, within, offset, rows)
    for i in range(BODY_COUNT):
        for j in range(BODY_COUNT):
            rows.least = min(rows.least, rows.nearest[i, j])


@jit
def hands_nearest(hands: Any, states: Any, extra: float, rows: Record) -> float:
    """Compute the least distance of the hands [m] where they are, if it is not above `extra` [m], else infinity."""
    for h in range(2):
        for part in range(BODY_COUNT):
            rows.motion[h, part] = 0.0
    look_at_pairs(hands, states, extra, np.inf, np.inf, rows)
    return float(rows.least)


@jit
def add_hand_row(hands: Any, states: Any, first: int, second: int, multiplier: float, rows: Record) -> bool:
    """Add the row of a pair; False where there is no room."""
    row = rows.count
    if row == HAND_ROWS:
        return False
    write_hand_row(hands, states, first, second, row, rows)
    rows.body[row, 0], rows.body[row, 1] = first, second
    rows.multiplier[row] = multiplier
    rows.count += 1
    return True


@jit
def add_broken_pairs(hands: Any, states: Any, offset: float, rows: Record) -> bool:
    """Add a row of each two parts of which the step breaks one, as found; returns whether one is new."""
    added = False
    for i in range(BODY_COUNT):
        for j in range(BODY_COUNT):
            if rows.worst[i, j] > WORTH_A_ROW * offset:
                pair = rows.worst_pair[i, j]
                added = add_hand_row(hands, states, pair[0], pair[1], 0.0, rows) or added
    return added


@jit
def clear_share(radius: float, rows: Record) -> float:
    """Return the share of the step in which parts that may meet move by no more than a trust radius [m]."""
    fraction = 1.0
    for i in range(BODY_COUNT):
        for j in range(BODY_COUNT):
            moved, allowed = rows.motion[0, i] + rows.motion[1, j], max(rows.nearest[i, j], radius)
            if fraction * moved > allowed:
                fraction = allowed / moved
    return fraction
