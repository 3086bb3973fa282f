"""A tick beside parts that move: the parts go to where they are, the hand gives way, then the hand follows its user.

     1  n ← the least number of sub-steps in which no body of the hand passes a part by more than the margin,
            or by more than the body is away from it                                               sub_steps
     2  n times:  the parts go on; where one is in the hand then:                                  move_parts
     3      at most 12 times:  δ ← the least step that leaves all parts by ε;  pose ← pose + t δ   _make_way
     4      where that has no solution, or does not end free:  δ ← the least step that leaves all parts but those
                that move, and these as far as can be, palm and each finger by a depth of its own;  pose ← pose + t δ,
                at most 8 times                                                                    _squeeze
     5  if the hand is free:  a tick of the method, on parts that stand still
        else:  one program with the user's hand, in which no depth grows;  its multipliers are the forces, and the tick
            says that there is no place                                                            _follow_squeezed

The depths of 4 are the solution of min ½ |√G δ|² + ½ k Σ s², in which what moves may be s [m] deep: s of the palm and
of each finger, k = `FIRM`. A part that moves counts as such until the hand is free again.
"""

import math
from typing import Any

import numpy as np

from hhsim.kernels.clock import monotonic_ns
from hhsim.kernels.contact.detection import pairs_near
from hhsim.kernels.contact.linearise import clamp_to_limits
from hhsim.kernels.hand.kinematics import BODY_COUNT, BOX_CORNERS, FINGER_COUNT, PALM_BODY, PHALANX_COUNT, HandArrays
from hhsim.kernels.hand.pose import copy_configuration, farthest_joint, move
from hhsim.kernels.jit import Record, as_bool, as_int64, jit, jit_inline, jit_noinline
from hhsim.kernels.memory import copy_values
from hhsim.kernels.parts.surface import KEY_STRIDE, PartsMotion, passing
from hhsim.kernels.qp.active_set import OPTIMAL, QpWork
from hhsim.kernels.rotation import quaternion_to_matrix, turned, write_unit_quaternion
from hhsim.kernels.tick.evaluation import end_work, least_distance
from hhsim.kernels.tick.force import hand_forces
from hhsim.kernels.tick.state import STATUS_CAPACITY_EXCEEDED, STATUS_NO_PLACE, WORK_TOUCHING
from hhsim.kernels.tick.step import DURATION_DETECT, DURATION_PALM
from hhsim.kernels.world.linearisation import allowed_share, prepare, solve_with_pairs
from hhsim.kernels.world.pairs import World, measure
from hhsim.kernels.world.rows import SLACKS
from hhsim.kernels.world.second_order import FLAT_PROGRAMS
from hhsim.kernels.world.tick import settle_forces

WAYS = 12
"""Most steps of a hand that gives way in a sub-step."""
SQUEEZES = 8
"""Most steps towards the least depth in a sub-step."""
LAST_SQUEEZE = 1e-7
"""A step of this length [m] towards the least depth is the last one."""
FIRM = 1e6
"""Stiffness k of a depth [N/m]: a thousand times that of the palm's coupling, so that a depth is off by micrometres."""
SQUEEZE_DEPTHS = SLACKS
"""Depths of a squeezed hand: of the palm, and of each finger."""


@jit_inline
def _row(parts: PartsMotion) -> int:
    return int(min(parts.tick[0], parts.path.shape[0] - 1))


@jit
def sub_steps(hand: HandArrays, pose: Record, margin: float, parts: PartsMotion, point: Any) -> tuple[int, float]:
    """Return the number of sub-steps of the parts' motion, 0 if none moves, and how far it passes the hand [m]."""
    row, most, farthest = _row(parts), 0.0, 0.0
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
            farthest = max(farthest, passed)
            most = max(most, passed / max(margin, min(near.slack[body], near.nearest[body])))
    return max(1, math.ceil(most)) if moves else 0, farthest


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


@jit_noinline
def _move_hand(method: World, state: Record) -> float:
    """Make as much of the step as the listed pairs allow; returns the longest motion [m]."""
    # A program may miss a joint limit by its tolerance, and the next one would start from there.
    for f in range(FINGER_COUNT):
        clamp_to_limits(method.movers[0], state.pose, f, state.step.delta[:])
    fraction, longest = allowed_share(method)
    move(state.pose, state.step.delta, state.problem.abduction_step, fraction)
    return longest


@jit_noinline
def _make_way(method: World, state: Record, qp: QpWork) -> bool:
    """Bring a hand that a part has come into out of it, by the least steps; returns whether it is free."""
    for i in range(WAYS):
        method.world[0].curved = i >= FLAT_PROGRAMS
        count = prepare(method, 0.0, state)
        if count < 0 or solve_with_pairs(method, count, as_bool(False), state, qp) != OPTIMAL:
            return False
        _move_hand(method, state)
        if not measure(method):
            return False
        if least_distance(state) >= 0.0:
            return True
    return False


@jit_noinline
def _squeeze(parts: PartsMotion, method: World, state: Record, qp: QpWork) -> bool:
    """Bring the hand to the least depth in the parts that yield; returns whether all pairs fit into the arrays."""
    problem, contacts, fits = method.world[0].problem, state.contacts, as_bool(True)
    # Depths of the palm and of each finger, in the columns of slack variables.
    problem.slacks, method.world[0].curved = SQUEEZE_DEPTHS, False
    for _ in range(SQUEEZES):
        count = prepare(method, 0.0, state)
        fits = as_bool(count >= 0)
        for j in range(SQUEEZE_DEPTHS if fits else 0):
            problem.target[problem.width + j] = 0.0
            for i in range(contacts.start[j], contacts.start[j + 1]):
                if parts.part[contacts.key[i] // KEY_STRIDE].yields == 1:
                    problem.common[problem.width + j, i] = 1.0 / math.sqrt(FIRM)
        if not fits or solve_with_pairs(method, count, as_bool(False), state, qp) != OPTIMAL:
            break
        longest = _move_hand(method, state)
        fits = as_bool(measure(method))
        if not fits or longest < LAST_SQUEEZE:
            break
    problem.slacks = 0
    return fits


@jit_noinline
def _follow_squeezed(method: World, state: Record, qp: QpWork) -> bool:
    """Let a squeezed hand follow its user where no depth grows, and compute the forces that bear it there.

    The forces are those of the coupling alone: the recorded part is not limited in force. Returns whether all pairs fit
    into the arrays.
    """
    copy_configuration(state.pose, state.safe)
    depth = least_distance(state)
    state.active.count = 0
    if not settle_forces(method, method.options.margin, state, qp):
        return False
    if state.active.count == 0:
        return True
    _move_hand(method, state)
    fits = measure(method)
    if fits and least_distance(state) >= depth - method.options.offset:
        return True
    copy_configuration(state.safe, state.pose)
    return measure(method)


@jit_noinline
def _leave_parts(parts: PartsMotion, method: World, state: Record, qp: QpWork) -> int:
    """Move the parts, and the hand out of them; returns 0 if it is free, else status bits."""
    options, trust, world = method.options, state.trust, method.world[0]
    steps, state.progress.carried = sub_steps(method.movers[0], state.pose, options.margin, parts, state.scratch[:])
    if steps == 0 and least_distance(state) >= 0.0:
        return 0
    state.step.lap = start = monotonic_ns()
    radius, fallback, status = trust.radius, state.fallback, 0
    coupled, relaxed = fallback.is_coupled, fallback.is_relaxed
    world.stays, fallback.is_relaxed, fallback.is_coupled = True, True, True
    for i in range(max(steps, 1)):
        if steps > 0:
            move_parts(parts, 1.0 / (steps - i))
        trust.radius = trust.reach = options.margin
        if not measure(method):
            status = STATUS_CAPACITY_EXCEEDED
            break
        if least_distance(state) >= 0.0 or _make_way(method, state, qp):
            status = 0
            continue
        if state.progress.pairs_overflow or not _squeeze(parts, method, state, qp):
            status = STATUS_CAPACITY_EXCEEDED
            break
        status = 0 if least_distance(state) >= 0.0 else STATUS_NO_PLACE
    world.stays, fallback.is_relaxed, fallback.is_coupled, trust.radius = False, relaxed, coupled, radius
    if status == 0:
        for p in range(parts.path.shape[1]):
            parts.part[p].yields = 0
    duration = state.step.duration
    duration[DURATION_DETECT] = monotonic_ns() - start - duration[DURATION_PALM]
    return status


@jit
def give_way(parts: PartsMotion, method: World, qp: QpWork) -> int:
    """Move the parts by a tick, and the hand out of them; returns 0 where the tick goes on from there, else its status.

    What that took is left in the world's `work` and `spent`, for `kernels.world.tick` to add to the tick's own.
    """
    world, state, options = method.world[0], method.states[0], method.options
    state.work[:] = 0
    state.step.duration[:] = 0
    state.step.iterations = 0
    status = _leave_parts(parts, method, state, qp)
    parts.tick[0] += 1
    end_work(state)
    copy_values(state.work[:], world.work[:])
    copy_values(state.step.duration[:], world.spent[:])
    if status == 0:
        return as_int64(0)
    if status == STATUS_NO_PLACE and not _follow_squeezed(method, state, qp):
        status = STATUS_CAPACITY_EXCEEDED
    progress = state.progress
    copy_configuration(state.pose, state.prediction.start)
    progress.is_unfinished = False
    progress.path = 0.0
    progress.lag = farthest_joint(state.pose.joints, state.haptic.joints)
    # Where there is a place again the hand goes there as one that snaps.
    progress.snaps = True
    _, state.work[WORK_TOUCHING] = pairs_near(method.surfaces[0], method.movers[0], state.candidates, options.touch)
    hand_forces(options, as_bool(False), state)
    end_work(state)
    return as_int64(status)
