"""A tick beside parts that move: the parts go to where they are, the hand gives way, then the hand follows its user.

     1  n ← the least number of sub-steps in which no body of the hand passes a part by more than the margin,
            or by more than the body is away from it                                               sub_steps
     2  n times:  the parts go on; where one is in the hand then:                                  move_parts
     3      at most 12 times:  δ ← the least step that leaves all parts by ε;  pose ← pose + t δ   make_way
     4      where that has no solution, or does not end free:  δ ← the least step that leaves all parts but those
                that move, and these as far as can be, palm and each finger by a depth of its own;  pose ← pose + t δ,
                at most 8 times                                                                    squeeze
     5  if the hand is free:  a tick of the method, on parts that stand still
        else:  one program with the user's hand, in which no depth grows;  its multipliers are the forces, and the tick
            says that there is no place                                                            bear

The depths of 4 are the solution of min ½ |√G δ|² + ½ k Σ s², in which what moves may be s [m] deep: s of the palm and
of each finger, k = `FIRM`. A part that moves counts as such until the hand is free again.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.clock import monotonic_ns
from hhsim.kernels.contact.linearise import ROW_CAPACITY, build_rows, clamp_to_limits, limit_start
from hhsim.kernels.contact.own_parts import add_own_rows
from hhsim.kernels.contact.self_pairs import SELF_ROWS, begin_rows, scale_rows
from hhsim.kernels.contact.surface_code import SurfaceCode, pairs_near
from hhsim.kernels.hand.kinematics import (
    BODY_COUNT,
    BOX_CORNERS,
    DOF,
    FINGER_COUNT,
    PALM_BODY,
    PHALANX_COUNT,
    HandArrays,
)
from hhsim.kernels.hand.pose import copy_configuration, farthest_joint, move
from hhsim.kernels.jit import Record, as_bool, as_int64, jit, jit_inline, jit_noinline
from hhsim.kernels.parts.surface import KEY_STRIDE, PartsMotion, passing
from hhsim.kernels.qp.active_set import OPTIMAL, QpWork, solve
from hhsim.kernels.qp.row_scan import WideRows
from hhsim.kernels.rotation import quaternion_to_matrix, turned, write_unit_quaternion
from hhsim.kernels.tick.coupled import GROUPS, solve_coupled
from hhsim.kernels.tick.evaluation import end_work, evaluate_pose, least_distance
from hhsim.kernels.tick.force import hand_forces
from hhsim.kernels.tick.linearisation import find_program_contacts, step_to_haptic, write_program
from hhsim.kernels.tick.method import Coupled, tick
from hhsim.kernels.tick.options import TickOptions
from hhsim.kernels.tick.state import (
    STATUS_CAPACITY_EXCEEDED,
    STATUS_NO_PLACE,
    UNITS_LINEARISATION,
    WORK_COUNTERS,
    WORK_LINEARISATIONS,
    WORK_TOUCHING,
    WORK_UNITS,
)
from hhsim.kernels.tick.step import (
    ACTIVE_CAPACITY,
    DURATION_DETECT,
    DURATION_PALM,
    copy_active,
    store_active,
    store_meeting,
)
from hhsim.kernels.tick.step_length import allowed_fraction

WAYS = 12
"""Most steps of a hand that gives way in a sub-step."""
SQUEEZES = 8
"""Most steps towards the least depth in a sub-step."""
SETTLED = 1e-7
"""A step of this length [m] towards the least depth is the last one."""
FIRM = 1e6
"""Stiffness k of a depth [N/m]: a thousand times that of the palm's coupling, so that a depth is off by micrometres."""
DEPTHS = 6
"""Depths of a squeezed hand: of the palm, and of each finger; the first variables of its program."""
SQUEEZED_DOF = DEPTHS + DOF

SQUEEZE = np.dtype(
    [
        ("common", np.float64, (2 * DEPTHS, ROW_CAPACITY)),  # columns of the depths and the palm
        ("own", np.float64, (SELF_ROWS, DOF - DEPTHS)),  # columns of the fingers in rows of the hand's own parts
        ("target", np.float64, (SQUEEZED_DOF,)),
        ("guess", np.int64, (ACTIVE_CAPACITY,)),
        ("work", np.int64, (WORK_COUNTERS,)),  # of the sub-steps of a tick
        ("duration", np.int64, (4,)),  # [ns]
    ],
    align=True,
)
"""Program of a squeezed hand, and the work of a tick before its method's own."""


class Jointed(NamedTuple):
    """Method of a hand beside parts that move: between two motions of theirs, a method for bodies that stand still."""

    method: Any  # Coupled, or Progressive
    parts: PartsMotion
    squeeze: NDArray[np.void]  # a record of `SQUEEZE`, (1,)
    qp: NDArray[np.void]  # workspace of programs of `SQUEEZED_DOF` variables, (1,)


@jit_inline
def _row(parts: PartsMotion) -> int:
    return int(min(parts.tick[0], parts.path.shape[0] - 1))


@jit
def sub_steps(hand: HandArrays, pose: Record, margin: float, parts: PartsMotion, point: Any) -> tuple[int, float]:
    """Return the number of sub-steps of the parts' motion, 0 if none moves, and how far it passes the hand [m]."""
    row, most, way = _row(parts), 0.0, 0.0
    moves = False
    for p in range(parts.path.shape[1]):
        part, goal = parts.part[p], parts.path[row, p]
        still = True
        for j in range(3):
            still = still and goal[j] == part.position[j]
        for j in range(4):
            still = still and goal[3 + j] == part.orientation[j]
        if still:
            continue
        moves = True
        for body in range(BODY_COUNT):
            near = part.near
            if near.gathered_slack[body] == np.inf:
                continue
            passed = 0.0
            if body < PALM_BODY:
                for k in range(2):
                    joint = pose.joints[body // PHALANX_COUNT, body % PHALANX_COUNT + k]
                    passed = max(passed, passing(part, goal, joint))
            else:
                for i in range(BOX_CORNERS):
                    x, y, z = turned(pose.rotation, hand.palm_box[i, 0], hand.palm_box[i, 1], hand.palm_box[i, 2])
                    point[0], point[1], point[2] = x + pose.position[0], y + pose.position[1], z + pose.position[2]
                    passed = max(passed, passing(part, goal, point))
            way = max(way, passed)
            most = max(most, passed / max(margin, min(near.slack[body], near.nearest[body])))
    return max(1, math.ceil(most)) if moves else 0, way


@jit
def move_parts(parts: PartsMotion, share: float) -> None:
    """Move each part by a share of its way to where this tick brings it; 1 is there, to the bit."""
    row = _row(parts)
    for p in range(parts.path.shape[1]):
        part, goal = parts.part[p], parts.path[row, p]
        position, orientation = part.position, part.orientation
        changed, side = False, 0.0
        for j in range(3):
            changed = changed or goal[j] != position[j]
            position[j] = goal[j] if share == 1.0 else position[j] + share * (goal[j] - position[j])
        for j in range(4):
            changed = changed or goal[3 + j] != orientation[j]
            side += goal[3 + j] * orientation[j]
        if not changed:
            continue
        part.yields = 1
        if share == 1.0:
            for j in range(4):
                orientation[j] = goal[3 + j]
        else:
            to = share if side >= 0.0 else -share
            w = orientation[0] + share * (-orientation[0]) + to * goal[3]
            x = orientation[1] + share * (-orientation[1]) + to * goal[4]
            y = orientation[2] + share * (-orientation[2]) + to * goal[5]
            z = orientation[3] + share * (-orientation[3]) + to * goal[6]
            write_unit_quaternion(orientation[:], w, x, y, z)
        quaternion_to_matrix(orientation[:], part.rotation[:])


@jit_inline
def _stay(state: Record) -> None:
    """Let the program's target be where the hand is."""
    for j in range(DOF):
        state.problem.target[j] = 0.0
    for f in range(FINGER_COUNT):
        state.problem.abduction_step[f] = 0.0
    state.work[WORK_LINEARISATIONS] += 1
    state.work[WORK_UNITS] += UNITS_LINEARISATION


@jit
def _find_own(hand: HandArrays, options: TickOptions, state: Record) -> None:
    """Find the rows of the hand's own parts within the margin."""
    begin_rows(state.self_contact)
    add_own_rows(options.own, hand, options.margin, options, state)


@jit
def _write_rows(hand: HandArrays, options: TickOptions, state: Record) -> None:
    """Write the rows of contacts, joint limits and own parts, of a step without abduction."""
    build_rows(hand, state.pose, state.contacts, options.offset, as_bool(True), state.problem)
    scale_rows(options.offset, as_bool(True), state)


@jit_noinline
def _move_hand(hand: HandArrays, options: TickOptions, state: Record) -> float:
    """Make as much of the step as the listed pairs allow; returns the longest motion [m]."""
    # A program may miss a joint limit by its tolerance, and the next one would start from there.
    for f in range(FINGER_COUNT):
        clamp_to_limits(hand, state.pose, f, state.step.delta[:])
    fraction, longest = allowed_fraction(hand, options, state)
    move(state.pose, state.step.delta, state.problem.abduction_step, fraction)
    return longest


@jit_noinline
def make_way(hand: HandArrays, surface: SurfaceCode, options: TickOptions, state: Record, qp: QpWork) -> bool:
    """Bring a hand that a part has come into out of it, by the least steps; returns whether it is free."""
    for _ in range(WAYS):
        if not find_program_contacts(hand, surface, options, state):
            return False
        _stay(state)
        _find_own(hand, options, state)
        _write_rows(hand, options, state)
        if solve_coupled(Coupled(options), state, qp) != OPTIMAL:
            return False
        _move_hand(hand, options, state)
        if not evaluate_pose(hand, surface, options, state):
            return False
        if least_distance(state) >= 0.0:
            return True
    return False


@jit
def _squeezed_step(options: TickOptions, state: Record, method: Jointed) -> bool:
    """Solve for the least step with depths in the parts that yield; returns whether there is one."""
    problem, contacts, groups, step = state.problem, state.contacts, state.coupled, state.step
    program, qp, parts = method.squeeze[0], method.qp[0], state.self_contact
    dense = limit_start(contacts, as_int64(FINGER_COUNT))
    for group in range(FINGER_COUNT + 1):
        groups.group_start[group], groups.group_stop[group] = contacts.start[group], contacts.start[group + 1]
        groups.group_block[group] = 2 * DEPTHS + 3 * (group - 1) if group > 0 else -1
    for f in range(FINGER_COUNT):
        limits = limit_start(contacts, f), limit_start(contacts, f + 1)
        groups.group_start[DEPTHS + f], groups.group_stop[DEPTHS + f] = limits
        groups.group_block[DEPTHS + f] = 2 * DEPTHS + 3 * f
    groups.group_start[GROUPS], groups.group_stop[GROUPS] = dense, dense + parts.count
    groups.group_block[GROUPS] = -1
    for j in range(DEPTHS):
        for i in range(dense + parts.count):
            program.common[j, i] = 0.0
            program.common[DEPTHS + j, i] = problem.common[j, i] if i < dense else 0.0
    for i in range(parts.count):
        for j in range(DOF - DEPTHS):
            program.own[i, j] = parts.dense[i, DEPTHS + j]
    for group in range(FINGER_COUNT + 1):
        for i in range(contacts.start[group], contacts.start[group + 1]):
            if method.parts.part[contacts.key[i] // KEY_STRIDE].yields == 1:
                program.common[group, i] = 1.0 / math.sqrt(FIRM)
    end = GROUPS + 1
    start, stop, first = groups.group_start[:end], groups.group_stop[:end], groups.group_block[:end]
    given = problem.block[:], problem.rhs[:], start, stop, first, program.own[:], dense, parts.count
    wide = WideRows(as_int64(2 * DEPTHS), program.common[:], *given, as_int64(DOF - DEPTHS))
    none = as_int64(0)
    target, guess = program.target[:], program.guess[:]
    status = solve(as_int64(SQUEEZED_DOF), wide, target, options.tolerance, options.relaxation, guess, none, qp)
    step.iterations += qp.counts[1]
    for j in range(DOF):
        step.delta[j] = qp.x[DEPTHS + j] * problem.inverse_root[j]
    return status == OPTIMAL


@jit_noinline
def squeeze(hand: HandArrays, surface: SurfaceCode, options: TickOptions, state: Record, method: Jointed) -> bool:
    """Bring the hand to the least depth in the parts that yield; returns whether all pairs fit into the arrays."""
    for _ in range(SQUEEZES):
        if not find_program_contacts(hand, surface, options, state):
            return False
        _stay(state)
        _find_own(hand, options, state)
        _write_rows(hand, options, state)
        if not _squeezed_step(options, state, method):
            return True
        longest = _move_hand(hand, options, state)
        if not evaluate_pose(hand, surface, options, state):
            return False
        if longest < SETTLED:
            break
    return True


@jit_noinline
def bear(hand: HandArrays, surface: SurfaceCode, options: TickOptions, state: Record, qp: QpWork) -> bool:
    """Let a squeezed hand follow its user where no depth grows, and compute the forces that bear it there.

    They are those of the coupling alone: what squeezes the hand is given, and presses as hard as one likes. Returns
    whether all pairs fit into the arrays.
    """
    problem, contacts = state.problem, state.contacts
    copy_configuration(state.pose, state.safe)
    depth = least_distance(state)
    state.active.count = 0
    if not find_program_contacts(hand, surface, options, state):
        return False
    for i in range(contacts.start[FINGER_COUNT + 1]):
        contacts.distance[i] = max(contacts.distance[i], 0.0)
    step_to_haptic(state, problem.target[:], problem.abduction_step[:])
    for f in range(FINGER_COUNT):
        problem.abduction_step[f] = 0.0
    _find_own(hand, options, state)
    write_program(hand, options, as_bool(True), state)
    if solve_coupled(Coupled(options), state, qp) != OPTIMAL:
        return True
    store_active(contacts, state.step, state.warm)
    store_meeting(options.own.pairs, state, state.warm)
    copy_active(state.warm, state.active)
    _move_hand(hand, options, state)
    fits = evaluate_pose(hand, surface, options, state)
    if fits and least_distance(state) >= depth - options.offset:
        return True
    copy_configuration(state.safe, state.pose)
    return evaluate_pose(hand, surface, options, state)


@jit_noinline
def _give_way(hand: HandArrays, surface: SurfaceCode, method: Jointed, state: Record, qp: QpWork) -> int:
    """Move the parts, and the hand out of them; returns 0 if it is free, else status bits."""
    options, trust = method.method.options, state.trust
    steps, state.progress.carried = sub_steps(hand, state.pose, options.margin, method.parts, state.scratch[:])
    if steps == 0 and least_distance(state) >= 0.0:
        return 0
    began = monotonic_ns()
    radius = trust.radius
    status = 0
    for i in range(max(steps, 1)):
        if steps > 0:
            move_parts(method.parts, 1.0 / (steps - i))
        trust.radius = trust.reach = options.margin
        if not evaluate_pose(hand, surface, options, state):
            return STATUS_CAPACITY_EXCEEDED
        if least_distance(state) >= 0.0 or make_way(hand, surface, options, state, qp):
            status = 0
            continue
        if state.progress.pairs_overflow or not squeeze(hand, surface, options, state, method):
            return STATUS_CAPACITY_EXCEEDED
        status = 0 if least_distance(state) >= 0.0 else STATUS_NO_PLACE
    trust.radius = radius
    if status == 0:
        for p in range(method.parts.path.shape[1]):
            method.parts.part[p].yields = 0
    duration = state.step.duration
    duration[DURATION_DETECT] = monotonic_ns() - began - duration[DURATION_PALM]
    return status


@tick.of(Jointed)
@jit_inline
def follow_parts(method: Jointed, hand: HandArrays, surface: SurfaceCode, state: Record, qp: QpWork) -> int:
    """Move the parts by a tick, and the hand with them; returns status bits."""
    options, before = method.method.options, method.squeeze[0]
    state.work[:] = 0
    state.step.duration[:] = 0
    state.step.iterations = 0
    status = _give_way(hand, surface, method, state, qp)
    method.parts.tick[0] += 1
    end_work(state)
    if status == 0:
        for i in range(WORK_COUNTERS):
            before.work[i] = state.work[i]
        for i in range(4):
            before.duration[i] = state.step.duration[i]
        status = tick(method.method, hand, surface, state, qp)
        for i in range(WORK_COUNTERS):
            # Those that are the most of a program are the method's own.
            state.work[i] += before.work[i]
        for i in range(4):
            state.step.duration[i] += before.duration[i]
        return status
    if status == STATUS_NO_PLACE and not bear(hand, surface, options, state, qp):
        status = STATUS_CAPACITY_EXCEEDED
    progress = state.progress
    copy_configuration(state.pose, state.prediction.start)
    progress.is_unfinished = False
    progress.path = 0.0
    progress.lag = farthest_joint(state.pose.joints, state.haptic.joints)
    # Where there is a place again the hand goes there as one that snaps.
    progress.snaps = True
    _, state.work[WORK_TOUCHING] = pairs_near(surface, hand, state.candidates, options.touch)
    hand_forces(options, as_bool(False), state)
    end_work(state)
    return status
