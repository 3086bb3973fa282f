"""Pairs of the hand's own parts: their distances at a pose, and the rows that keep them apart in a step.

A pair is a phalanx and one of another finger, or a phalanx and the palm, whose spheres count as one part. The palm's
motion moves no part against another: a row has the joints of one finger or of two, and abduction on the right-hand
side. With p and q the nearest axis points, n the normal from q to p, J and a the centre and axis of a joint, a joint of
the first finger changes the distance by n · (a × (p - J)), one of the second by -n · (a × (q - J)).

A bound of each pair's distance goes down by what its parts have moved since: a joint's angle times its lever. While the
least bound less the two largest of these ways is enough, no pair is looked at.

A tick calls these kernels by their address, so that it is compiled once for hands whose parts meet and for others, and
does not contain what the others never run.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.arithmetic import sine_cosine
from hhsim.kernels.by_reference import by_reference
from hhsim.kernels.contact.linearise import LEVER_FLOOR, LIMIT_ROWS, limit_start, point_jacobian
from hhsim.kernels.hand.kinematics import (
    BODY_COUNT,
    DOF,
    FINGER_COUNT,
    PALM_BODY,
    PHALANX_COUNT,
    HandArrays,
    phalanx_cone,
    placed_sphere,
)
from hhsim.kernels.hand.pose import HAND_POSE, update_kinematics
from hhsim.kernels.jit import Array, Indices, Record, as_int64, jit, jit_inline, jit_noinline
from hhsim.kernels.machine_code import ask_code, number_of_code, run_code
from hhsim.kernels.memory import copy_values
from hhsim.kernels.rotation import turned_back
from hhsim.kernels.round_cone import RoundCone, round_cone_pair, round_cone_parameter

SELF_PAIRS = PHALANX_COUNT * PHALANX_COUNT * FINGER_COUNT * (FINGER_COUNT - 1) // 2 + PHALANX_COUNT * FINGER_COUNT
"""Most pairs of a hand."""
SELF_ROWS = 32
"""Most rows of such pairs in a program, the nearest; what it lacks is found by the true distances."""
BEND = 1e-4
"""Largest rotation of a joint [rad] for a difference of gradients."""
BROKEN = -1.0
"""Stands for a distance where only the rows that the step breaks are added."""
EXACT = 1e-4
"""Least distances below this are no bounds [m]."""
LASTS = 5e-4
"""Pairs up to this much farther are measured with them [m], so that bounds last for ticks."""
STILL = 1e-12
"""Motion below what a program may leave a row broken by [m]: distances are as they were."""
STEEP = 0.5
"""Share of the coupling by which rows curve that are steep: so much of an error a program of flat rows leaves at least,
and beyond 1 it grows from tick to tick until a tick has enough programs for second derivatives."""
WHOLE_PALM = -1
"""In place of a palm sphere in a row of two phalanges."""


@by_reference
class SelfPairs(NamedTuple):
    """Pairs of a hand's own parts that may meet."""

    first: Indices  # a phalanx, body 0 to 14, (N,)
    second: Indices  # a phalanx of a later finger, or the palm, body 15, (N,)


SELF_CONTACT = np.dtype(
    [
        ("bound", np.float64, (SELF_PAIRS,)),  # no pair was nearer at the bounds [m]; a small one is the distance
        ("floor", np.float64),  # least of these [m]
        ("least", np.float64),  # no pair is nearer at the pose [m], infinite without pairs; the floor at the bounds
        ("posture", np.float64, (DOF,)),  # flexion at the bounds, in its place among the variables [rad]
        ("abduction", np.float64, (FINGER_COUNT,)),
        ("flexed", np.float64, (DOF,)),  # changes of both since [rad]
        ("abducted", np.float64, (FINGER_COUNT,)),
        ("moved", np.float64, (BODY_COUNT,)),  # bound of each part's motion since in the palm frame [m]
        ("motion", np.float64, (BODY_COUNT,)),  # the same of a step
        ("count", np.int64),  # rows in the program
        ("pair", np.int64, (SELF_ROWS,)),  # pair of each row
        ("sphere", np.int64, (SELF_ROWS,)),  # its palm sphere, or WHOLE_PALM
        ("distance", np.float64, (SELF_ROWS + 1,)),  # [m]; as the next three with one row more, to try a pair
        ("normal", np.float64, (SELF_ROWS + 1, 3)),  # unit, from the second part to the first, world
        ("gradient", np.float64, (SELF_ROWS + 1, DOF)),  # of the distance by the joints [m/rad]
        ("spread", np.float64, (SELF_ROWS + 1, FINGER_COUNT)),  # and by the fingers' abduction
        ("dense", np.float64, (SELF_ROWS, DOF)),  # the gradient, divided by √G
        ("meets", np.int64, (FINGER_COUNT,)),  # 1 for fingers with a row
        ("share", np.float64, (FINGER_COUNT,)),  # share of its abduction step that a finger has room for
        ("holds", np.bool_),  # a share is below 1
        ("bends", np.bool_),  # the rows have second derivatives in the program at hand
        ("steep", np.bool_),  # they have had a force since they curved by more than STEEP: flat, they would not do
        ("shape", np.float64, (PALM_BODY, 5)),  # last five fields of each phalanx's `RoundCone`
        ("bent", HAND_POSE),  # the hand a little farther along a step, for second derivatives
    ],
    align=True,
)
"""Contacts of the hand with itself, from tick to tick, and their rows, which follow the joint limits."""


@jit_inline
def _finger_motions(hand: HandArrays, step: Array, abduction_step: Array, motion_out: Array) -> float:
    """Compute how far any axis point of each part goes at most in the palm frame [m], shape (16,), in a step (21,).

    Return the most by which two parts come nearer [m].
    """
    motion_out[PALM_BODY], largest = 0.0, 0.0
    for f in range(FINGER_COUNT):
        for k in range(PHALANX_COUNT):
            total = abs(abduction_step[f]) * hand.lever[f, k, 0]
            for i in range(k + 1):
                total += abs(step[6 + PHALANX_COUNT * f + i]) * hand.lever[f, k, i]
            motion_out[PHALANX_COUNT * f + k] = total
            # A bound that is no number is not to be lost.
            largest = largest if total <= largest else total
    return 2.0 * largest


@jit_inline
def _cone(hand: HandArrays, pose: Record, body: int) -> RoundCone:
    return phalanx_cone(hand, pose.joints, pose.direction, body // PHALANX_COUNT, body % PHALANX_COUNT)


@jit_inline
def sphere_distance(cone: RoundCone, x: float, y: float, z: float, radius: float) -> float:
    """Compute the signed distance [m] of a round cone and a sphere."""
    dx, dy, dz = x - cone.x, y - cone.y, z - cone.z
    s = round_cone_parameter(dx, dy, dz, cone.ux, cone.uy, cone.uz, cone.tan_slope, cone.inverse_length)
    along = s * cone.length
    dx, dy, dz = dx - along * cone.ux, dy - along * cone.uy, dz - along * cone.uz
    return math.sqrt(dx * dx + dy * dy + dz * dz) - radius - cone.radius + s * cone.drop


@jit_inline
def in_palm_frame(pose: Record, cone: RoundCone) -> RoundCone:
    """Return a round cone of the world in a palm's frame."""
    position, rotation = pose.position, pose.rotation
    x, y, z = turned_back(rotation, cone.x - position[0], cone.y - position[1], cone.z - position[2])
    ux, uy, uz = turned_back(rotation, cone.ux, cone.uy, cone.uz)
    return RoundCone(x, y, z, ux, uy, uz, cone.length, cone.tan_slope, cone.inverse_length, cone.radius, cone.drop)


@jit_inline
def _next_sphere(hand: HandArrays, cone: RoundCone, limit: float, after: int) -> tuple[int, float]:
    """Find the next palm sphere nearer than `limit` [m] to a cone of the palm frame; its number, -1 for none."""
    group, start = hand.palm_group, hand.palm_group_start
    for g in range(group.shape[1]):
        if start[g + 1] <= after:
            continue
        if sphere_distance(cone, group[0, g], group[1, g], group[2, g], group[3, g]) >= limit:
            continue
        for i in range(max(start[g], after), start[g + 1]):
            distance = sphere_distance(cone, hand.palm_x[i], hand.palm_y[i], hand.palm_z[i], hand.palm_radius[i])
            if distance < limit:
                return i, distance
    return as_int64(-1), limit


@jit
def pair_distance(hand: HandArrays, pose: Record, first: int, second: int) -> float:
    """Compute the signed distance [m] of a phalanx and another, or the palm, with kinematics up to date."""
    if second != PALM_BODY:
        return round_cone_pair(_cone(hand, pose, first), _cone(hand, pose, second))[0]
    cone, nearest, sphere = in_palm_frame(pose, _cone(hand, pose, first)), np.inf, as_int64(-1)
    while True:
        sphere, distance = _next_sphere(hand, cone, nearest, sphere + 1)
        if sphere < 0:
            return nearest
        nearest = distance


@jit_noinline
def _update_bounds(pairs: SelfPairs, hand: HandArrays, pose: Record, reach: float, own: Record) -> None:
    """Bring the bounds to the pose, by the motion since; those below `reach` are then distances."""
    for f in range(FINGER_COUNT):
        own.abduction[f] = pose.abduction[f]
        for k in range(PHALANX_COUNT):
            own.posture[6 + PHALANX_COUNT * f + k] = pose.flexion[f, k]
    least = np.inf
    for i in range(pairs.first.shape[0]):
        first, second = pairs.first[i], pairs.second[i]
        bound = own.bound[i] - own.moved[first] - own.moved[second]
        # Not below, or a bound that is no number would be kept.
        if not bound >= reach:
            bound = pair_distance(hand, pose, first, second)
        own.bound[i] = bound
        least = min(least, bound)
    own.floor, own.least = least, least


@jit
def measure_pairs(pairs: SelfPairs, hand: HandArrays, pose: Record, exact: float, own: Record) -> None:
    """Compute the least distance of pairs at a pose, or a bound of it that is not below `exact` [m]."""
    for f in range(FINGER_COUNT):
        own.abducted[f] = pose.abduction[f] - own.abduction[f]
        for k in range(PHALANX_COUNT):
            own.flexed[6 + PHALANX_COUNT * f + k] = pose.flexion[f, k] - own.posture[6 + PHALANX_COUNT * f + k]
    nearer = _finger_motions(hand, own.flexed, own.abducted, own.moved)
    own.least = own.floor - nearer
    if not (own.least >= exact or (nearer <= STILL and own.least >= 0.0)):
        _update_bounds(pairs, hand, pose, exact + LASTS, own)


@jit
def self_clearances(
    hand: HandArrays,
    pairs: SelfPairs,
    flexion: Array,
    abduction: Array,
    poses: NDArray[np.void],
    contacts: NDArray[np.void],
    clearance_out: Array,
) -> None:
    """Compute the least signed distance [m] of T hands' own parts, shape (T,), or a lower bound that is not negative.

    Flexion (T, 5, 3), abduction (T, 5) [rad]; NaN where not finite. Workspace: `poses`, a fresh `contacts`, each (1,).
    """
    pose, own = poses[0], contacts[0]
    for t in range(flexion.shape[0]):
        copy_values(flexion[t], pose.flexion[:])
        copy_values(abduction[t], pose.abduction[:])
        update_kinematics(hand, pose)
        measure_pairs(pairs, hand, pose, 0.0, own)
        # What is not finite makes the sum no number.
        total = 0.0
        for f in range(FINGER_COUNT):
            total += abduction[t, f] + flexion[t, f, 0] + flexion[t, f, 1] + flexion[t, f, 2]
        clearance_out[t] = own.least + 0.0 * total


@jit
def _write_cones(
    pose: Record, first: int, second: int, cone: RoundCone, other: RoundCone, floor: float, row: int, own: Record
) -> None:
    # The second body is -1 where it is a sphere of the palm.
    own.distance[row], s, t, own.normal[row, 0], own.normal[row, 1], own.normal[row, 2] = round_cone_pair(cone, other)
    own.gradient[row, :] = 0.0
    own.spread[row, :] = 0.0
    n, gradient, spread = own.normal[row], own.gradient[row], own.spread[row]
    along = s * cone.length
    point = cone.x + along * cone.ux, cone.y + along * cone.uy, cone.z + along * cone.uz
    point_jacobian(pose, first, point, (n[0], n[1], n[2]), floor, gradient, spread)
    if second >= 0:
        along = t * other.length
        point = other.x + along * other.ux, other.y + along * other.uy, other.z + along * other.uz
        point_jacobian(pose, second, point, (-n[0], -n[1], -n[2]), floor, gradient, spread)


@jit
def write_row(hand: HandArrays, pose: Record, first: int, second: int, sphere: int, row: int, own: Record) -> None:
    """Write distance, normal and gradient of a pair to a row; `sphere` is a palm's, or WHOLE_PALM for phalanges."""
    cone, floor = _cone(hand, pose, first), LEVER_FLOOR * hand.length[first // PHALANX_COUNT, 0]
    if sphere >= 0:
        c = (hand.palm_x[sphere], hand.palm_y[sphere], hand.palm_z[sphere])
        other = placed_sphere(pose.position, pose.rotation, c[0], c[1], c[2], hand.palm_radius[sphere])
    else:
        other = _cone(hand, pose, second)
    _write_cones(pose, first, second if sphere < 0 else -1, cone, other, floor, row, own)


@jit_inline
def clearance_kept(relaxed: bool, offset: float, distance: float) -> float:
    """Return the distance that a row keeps: the offset; relaxed, what is nearer may stay as near as it is."""
    return min(offset, distance) if relaxed and distance >= 0.0 else offset


@jit_inline
def _is_violated(options: Any, row: int, state: Record) -> bool:
    """Return whether the step breaks a row by more than a program would leave it broken."""
    own, problem, delta = state.self_contact, state.problem, state.step.delta
    after, square = own.distance[row], 0.0
    for f in range(FINGER_COUNT):
        after += own.spread[row, f] * problem.abduction_step[f]
    for j in range(6, DOF):
        after += own.gradient[row, j] * delta[j]
        square += (own.gradient[row, j] * problem.inverse_root[j]) ** 2
    short = clearance_kept(state.program.is_relaxed, options.offset, own.distance[row]) - after
    return short > options.tolerance * math.sqrt(square) if square > 0.0 else short > options.relaxation


@jit_inline
def _leave_room(offset: float, row: int, state: Record) -> None:
    """Reduce the abduction, which is given, to what brings the pair's fingers no nearer than the offset by itself."""
    own, step = state.self_contact, state.problem.abduction_step
    closing, opening, excess = 0.0, max(own.distance[row] - offset, 0.0), 0.0
    for f in range(FINGER_COUNT):
        rate = own.spread[row, f] * step[f]
        closing -= min(rate, 0.0)
        opening += max(rate, 0.0)
        excess += own.spread[row, f] ** 2
    for j in range(6, DOF):
        excess -= own.gradient[row, j] ** 2
    if closing > opening and excess > 0.0:
        own.holds = True
        for f in range(FINGER_COUNT):
            if own.spread[row, f] * step[f] < 0.0:
                own.share[f] *= opening / closing


@jit_noinline
def _farthest_row(own: Record) -> int:
    farthest = 0
    for row in range(SELF_ROWS):
        farthest = row if own.distance[row] > own.distance[farthest] else farthest
    return farthest


@jit
def _add_pair(
    pairs: SelfPairs, hand: HandArrays, pair: int, sphere: int, within: float, options: Any, state: Record
) -> bool:
    """Add the row of a pair that the step breaks, or not farther than `within` [m]; return if it is new."""
    own, row = state.self_contact, state.self_contact.count
    for other in range(row):
        if own.pair[other] == pair and own.sphere[other] == sphere:
            return False
    first, second = pairs.first[pair], pairs.second[pair]
    write_row(hand, state.pose, first, second, sphere, row, own)
    if not (_is_violated(options, row, state) if within == BROKEN else own.distance[row] <= within):
        return False
    if row < SELF_ROWS:
        own.count += 1
    else:
        row = _farthest_row(own)
        if own.distance[row] <= own.distance[SELF_ROWS]:
            return False
        write_row(hand, state.pose, first, second, sphere, row, own)
    own.pair[row], own.sphere[row] = pair, sphere
    own.meets[first // PHALANX_COUNT] = 1
    if second != PALM_BODY:
        own.meets[second // PHALANX_COUNT] = 1
    _leave_room(options.offset, row, state)
    return True


@jit_inline
def begin_rows(own: Record) -> None:
    """Remove all rows, and follow the abduction as a whole."""
    own.count = 0
    own.holds = False
    for f in range(FINGER_COUNT):
        own.meets[f] = 0
        own.share[f] = 1.0


@jit
def add_rows(pairs: SelfPairs, hand: HandArrays, within: float, options: Any, state: Record) -> bool:
    """Add rows of pairs up to `within` [m], or of those that the step breaks if BROKEN; return whether one is new."""
    own, motion = state.self_contact, state.self_contact.motion
    nearer = _finger_motions(hand, state.step.delta, state.problem.abduction_step, motion)
    added, most = False, within if within != BROKEN else nearer + options.offset
    if own.least >= most - STILL:
        return added
    if own.least != own.floor:
        measure_pairs(pairs, hand, state.pose, most, own)
    for pair in range(pairs.first.shape[0]):
        first, second = pairs.first[pair], pairs.second[pair]
        limit = within if within != BROKEN else motion[first] + motion[second] + options.offset
        if own.bound[pair] > limit:
            continue
        if second != PALM_BODY:
            added = _add_pair(pairs, hand, pair, as_int64(WHOLE_PALM), within, options, state) or added
            continue
        cone, sphere = in_palm_frame(state.pose, _cone(hand, state.pose, first)), as_int64(-1)
        while True:
            sphere, _ = _next_sphere(hand, cone, limit, sphere + 1)
            if sphere < 0:
                break
            added = _add_pair(pairs, hand, pair, sphere, within, options, state) or added
    return added


@jit
def foresee_rows(pairs: SelfPairs, hand: HandArrays, active: Record, options: Any, state: Record) -> None:
    """Add the rows that were active in the last program, and reduce the abduction step to what they have room for."""
    own = state.self_contact
    for i in range(active.count):
        key = -1 - LIMIT_ROWS - active.key[i]
        if key >= 0 and active.body[i] == pairs.first[key % SELF_PAIRS]:
            _add_pair(pairs, hand, key % SELF_PAIRS, key // SELF_PAIRS + WHOLE_PALM, np.inf, options, state)
    own.steep = own.steep and own.count > 0
    for f in range(FINGER_COUNT):
        state.problem.abduction_step[f] *= own.share[f]


@jit
def scale_rows(offset: float, relaxed: bool, state: Record) -> None:
    """Scale the rows for the program, with its abduction step; arguments as of `build_rows`."""
    own, problem = state.self_contact, state.problem
    first = limit_start(state.contacts, as_int64(FINGER_COUNT))
    for row in range(own.count):
        rhs = clearance_kept(relaxed, offset, own.distance[row]) - own.distance[row]
        for f in range(FINGER_COUNT):
            rhs -= own.spread[row, f] * problem.abduction_step[f]
        problem.rhs[first + row] = rhs
        for j in range(DOF):
            own.dense[row, j] = own.gradient[row, j] * problem.inverse_root[j]


@jit
def clear_fraction(pairs: SelfPairs, fraction: float, hand: HandArrays, state: Record) -> float:
    """Reduce the share of the step so that parts which may meet in it move by no more than the trust radius."""
    own, motion = state.self_contact, state.self_contact.motion
    nearer = _finger_motions(hand, state.step.delta, state.problem.abduction_step, motion)
    if fraction * nearer <= max(own.least, state.trust.radius):
        return fraction
    if own.least != own.floor:
        measure_pairs(pairs, hand, state.pose, nearer, own)
    for pair in range(pairs.first.shape[0]):
        moved = motion[pairs.first[pair]] + motion[pairs.second[pair]]
        if fraction * moved > max(own.bound[pair], state.trust.radius):
            own.bound[pair] = pair_distance(hand, state.pose, pairs.first[pair], pairs.second[pair])
            fraction = min(fraction, max(own.bound[pair], state.trust.radius) / moved)
    return fraction


@jit_noinline
def choose_bends(pairs: SelfPairs, bends: bool, hand: HandArrays, pose: Record, own: Record) -> None:
    """Let the rows have second derivatives in the program at hand if told so, or if they are steep.

    They then keep the shapes of the phalanges.
    """
    own.bends = pairs.first.shape[0] > 0 and (bends or own.steep)
    for body in range(PALM_BODY if own.bends else 0):
        cone, shape = _cone(hand, pose, body), own.shape[body]
        shape[0], shape[1], shape[2] = cone.length, cone.tan_slope, cone.inverse_length
        shape[3], shape[4] = cone.radius, cone.drop


@jit_inline
def _bent_cone(own: Record, body: int) -> RoundCone:
    a, s = own.bent.joints[body // PHALANX_COUNT, body % PHALANX_COUNT], own.shape[body]
    u = own.bent.direction[body // PHALANX_COUNT, body % PHALANX_COUNT]
    return RoundCone(a[0], a[1], a[2], u[0], u[1], u[2], s[0], s[1], s[2], s[3], s[4])


@jit
def _bend(pose: Record, finger: int, share: float, step: Array, own: Record) -> None:
    """Write a finger bent by a share of a step: each phalanx is turned about the axis by the joints before it."""
    bent, axis, angle = own.bent, pose.axis[finger], 0.0
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
            along = own.shape[PHALANX_COUNT * finger + k, 0] * turned[j]
            bent.joints[finger, k + 1, j] = bent.joints[finger, k, j] + along


@jit
def add_bends(
    pairs: SelfPairs,
    pose: Record,
    own: Record,
    first: int,
    row: Indices,
    force: Array,
    inverse_root: Array,
    step: Array,
    product: Array,
) -> None:
    """Add Σ λ ∇²d · step over the rows of pairs of phalanges; `first` is the first of the hand's own rows, λ the force.

    See `curvature_product`. The spheres of the palm count as flat. `inverse_root` is 1 / √G of the hand's variables, by
    which rows are found to be steep.
    """
    # By the difference of gradients a little farther on: two nearest points that slide make a long closed form.
    most, bends = 0.0, False
    for j in range(6, DOF):
        most = max(most, abs(step[j]))
    for i in range(row.shape[0]):
        bends = bends or first <= row[i] < first + own.count
    if not bends or most == 0.0:
        return
    share, last, along, square = BEND / most, as_int64(SELF_ROWS), 0.0, 0.0
    for f in range(FINGER_COUNT):
        _bend(pose, f, share, step, own)
    for i in range(row.shape[0]):
        own_row = row[i] - first
        if own_row < 0 or own_row >= own.count or own.sphere[own_row] != WHOLE_PALM:
            continue
        one, two = pairs.first[own.pair[own_row]], pairs.second[own.pair[own_row]]
        _write_cones(own.bent, one, two, _bent_cone(own, one), _bent_cone(own, two), 0.0, last, own)
        for j in range(6, DOF):
            # A lever below the least one counts as none, which is no curvature.
            if own.gradient[own_row, j] != 0.0:
                bent = force[i] * (own.gradient[last, j] - own.gradient[own_row, j]) / share
                product[j] += bent
                along += step[j] * bent
    for j in range(6, DOF):
        square += (step[j] / inverse_root[j]) ** 2
    own.steep = own.steep or abs(along) > STEEP * square


@by_reference
class OwnParts(NamedTuple):
    """Pairs that may meet, none where parts go through each other, and what is done with them, by `code_of`."""

    pairs: SelfPairs
    measuring: int = 0  # of `measure_pairs`
    adding: int = 0  # of `add_rows`
    foreseeing: int = 0  # of `foresee_rows`
    clearing: int = 0  # of `clear_fraction`
    bending: int = 0  # of `add_bends`
    correcting: int = 0  # of `kernels.world.second_order.correct`


NO_PARTS = OwnParts(SelfPairs(np.zeros(0, np.int64), np.zeros(0, np.int64)))
"""In place of the pairs of a hand whose parts go through each other."""


@jit_noinline
def measure_own(own: OwnParts, hand: HandArrays, pose: Record, exact: float, rows: Record) -> None:
    """Do what `measure_pairs` does."""
    if own.measuring != 0:
        run_code(own.measuring, (own.pairs, hand, pose, exact, rows))


@jit_noinline
def add_own_rows(own: OwnParts, hand: HandArrays, within: float, options: Any, state: Record) -> bool:
    """Do what `add_rows` does."""
    return own.adding != 0 and ask_code(own.adding, (own.pairs, hand, within, options, state))


@jit_noinline
def foresee_own_rows(own: OwnParts, hand: HandArrays, active: Record, options: Any, state: Record) -> None:
    """Do what `foresee_rows` does."""
    if own.foreseeing != 0:
        run_code(own.foreseeing, (own.pairs, hand, active, options, state))


@jit_noinline
def clear_own_fraction(own: OwnParts, fraction: float, hand: HandArrays, state: Record) -> float:
    """Do what `clear_fraction` does."""
    if own.clearing == 0:
        return fraction
    return number_of_code(own.clearing, (own.pairs, fraction, hand, state))


@jit_noinline
def add_own_bends(
    own: OwnParts,
    pose: Record,
    rows: Record,
    first: int,
    row: Indices,
    force: Array,
    inverse_root: Array,
    step: Array,
    product_out: Array,
) -> None:
    """Do what `add_bends` does."""
    if own.bending != 0:
        run_code(own.bending, (own.pairs, pose, rows, first, row, force, inverse_root, step, product_out))
