"""Method `paper`: the decoupled-and-progressive optimisation of Tong et al. as printed, the baseline of every table.

One tick (their Fig. 3, Section IV): pairs of the graphic hand of t - 1, grown by Δr (`kernels.tick.paper_contacts`);
the palm's program, ½ (q - q_h)ᵀ G (q - q_h) with q = (x, y, z, α, β, γ), linearised once; each finger's on that palm, ½
(θ - θ_h)ᵀ G_r (θ - θ_h), within its joint limits; forces by Eq. 14 or the multipliers. Nothing is checked afterwards,
no step is bounded. docs/methods.md says what was chosen where the paper is silent. A part that is stuck inside takes
the haptic hand's place once that touches nothing: its program would be the same in every tick.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.clock import monotonic_ns
from hhsim.kernels.contact.detection import SurfaceCode
from hhsim.kernels.contact.linearise import ROW_CAPACITY, limit_rows
from hhsim.kernels.hand.hand_shape import FRUSTUM, frustum_shapes, place_frustum
from hhsim.kernels.hand.kinematics import BODY_COUNT, FINGER_COUNT, PALM_BODY, PHALANX_COUNT, HandArrays
from hhsim.kernels.hand.pose import farthest_joint, update_kinematics
from hhsim.kernels.jit import Record, as_bool, as_int64, jit
from hhsim.kernels.qp.active_set import OPTIMAL, QpWork, solve
from hhsim.kernels.qp.row_scan import Rows
from hhsim.kernels.rotation import euler_axes, euler_quaternion, nearest_euler
from hhsim.kernels.sphere_tree import TreeArrays
from hhsim.kernels.tick.block import tick
from hhsim.kernels.tick.evaluation import count_program, end_work, spent_units
from hhsim.kernels.tick.force import hand_forces
from hhsim.kernels.tick.options import TickOptions
from hhsim.kernels.tick.paper_contacts import (
    LIMITS,
    PALM_PAIRS,
    PALM_STACK,
    PHALANX_PAIRS,
    detect,
    finger_is_free,
    palm_contacts,
    palm_is_free,
    palm_rows,
    phalanx_contacts,
    phalanx_rows,
)
from hhsim.kernels.tick.state import STATUS_STUCK, WORK_CANDIDATES, WORK_ROWS, WORK_TOUCHING
from hhsim.kernels.tick.step import (
    ACTIVE_CAPACITY,
    DURATION_DETECT,
    DURATION_FINGERS,
    DURATION_FORCE,
    DURATION_PALM,
    lap,
)

PAPER_STATE = np.dtype(
    [
        ("euler", np.float64, (3,)),  # α, β, γ of the graphic palm, kept from tick to tick [rad]
        ("haptic_euler", np.float64, (3,)),  # those of the haptic palm
        ("axes", np.float64, (3, 3)),  # world axes of the three angles
        ("tried", np.float64, (FINGER_COUNT, PHALANX_COUNT)),  # joint angles set aside while others are looked at [rad]
        ("frustum", FRUSTUM, (PALM_BODY,)),  # of each phalanx, see `kernels.hand.hand_shape`
        ("x", np.float64, (PALM_BODY, PHALANX_PAIRS)),  # object sphere of each pair of a phalanx [m], world
        ("y", np.float64, (PALM_BODY, PHALANX_PAIRS)),
        ("z", np.float64, (PALM_BODY, PHALANX_PAIRS)),
        ("radius", np.float64, (PALM_BODY, PHALANX_PAIRS)),
        ("kind", np.int8, (PALM_BODY, PHALANX_PAIRS)),  # which part of its phalanx each pair is with
        ("hand_x", np.float64, (PALM_PAIRS,)),  # palm sphere of each palm pair [m], palm frame
        ("hand_y", np.float64, (PALM_PAIRS,)),
        ("hand_z", np.float64, (PALM_PAIRS,)),
        ("hand_radius", np.float64, (PALM_PAIRS,)),
        ("object_x", np.float64, (PALM_PAIRS,)),  # object sphere of each palm pair [m], world
        ("object_y", np.float64, (PALM_PAIRS,)),
        ("object_z", np.float64, (PALM_PAIRS,)),
        ("object_radius", np.float64, (PALM_PAIRS,)),
        ("closed", np.bool_),  # spheres close all ends of the frustums, see `kernels.hand.hand_shape.in_range`
        # 1 where the palm, and each finger, has more pairs than its arrays hold
        ("full", np.int8, (FINGER_COUNT + 1,)),
        ("normal", np.float64, (3, ROW_CAPACITY)),  # of each row, from object to hand
        ("body", np.int64, (ROW_CAPACITY,)),  # of each row, 0 to 15
        ("target", np.float64, (6,)),  # of the program at hand, times √G
        ("start", np.int64, (1,)),  # the one row group of a program
        ("stop", np.int64, (1,)),
        ("first", np.int64, (1,)),  # its block's first variable
        ("guess", np.int64, (1,)),  # empty
        ("stack", np.int64, (PALM_STACK,)),  # of walks, as the next
        ("scratch", np.int64, (PHALANX_PAIRS,)),
    ],
    align=True,
)
"""State besides that of every method (`tick.state`), of which this one uses poses, pairs, rows and outcome."""


@jit
def _keep_forces(rows: int, state: Record, paper: Record, qp: QpWork) -> None:
    # The multipliers of the program just solved; a finger's limits, behind its contacts, exert no force of the object.
    active = state.active
    count = active.count
    for i in range(qp.counts[0]):
        row = qp.active[i]
        if row < rows and count < ACTIVE_CAPACITY:
            active.key[count] = row
            active.body[count] = paper.body[row]
            active.multiplier[count] = qp.multiplier[i]
            for j in range(3):
                active.normal[j, count] = paper.normal[j, row]
                active.point[j, count] = 0.0
            count += 1
    active.count = count


@jit
def _solve(
    variables: int, shared: int, row_count: int, options: TickOptions, state: Record, paper: Record, qp: QpWork
) -> bool:
    # One group of rows; those of the palm lie in `common`, those of a finger in `block`.
    problem = state.problem
    paper.start[0] = 0
    paper.stop[0] = row_count
    paper.first[0] = 0 if shared == 0 else -1
    guess, none, common = paper.guess[:], as_int64(0), problem.common[:]
    groups = paper.start[:], paper.stop[:], paper.first[:]
    rows = Rows(shared, common, problem.block[:], problem.rhs[:], *groups, common, none, none, none)
    status = solve(variables, rows, paper.target[:], options.tolerance, options.relaxation, guess, none, qp)
    state.step.iterations += qp.counts[1]
    return status == OPTIMAL


@jit
def _solve_palm(
    hand: HandArrays, palm: TreeArrays, tree: TreeArrays, options: TickOptions, state: Record, paper: Record, qp: QpWork
) -> bool:
    pose, haptic = state.pose, state.haptic
    nearest_euler(haptic.rotation, paper.euler, paper.haptic_euler)
    rows = state.candidates.count[PALM_BODY]
    free = rows == 0 and paper.full[0] == 0
    solved = free
    if not free and paper.full[0] == 0 and rows <= ROW_CAPACITY:
        weight = state.problem.inverse_root
        euler_axes(paper.euler, paper.axes)
        palm_rows(rows, state, paper)
        for i in range(rows):
            paper.body[i] = PALM_BODY
        for j in range(3):
            paper.target[j] = (haptic.position[j] - pose.position[j]) / weight[j]
            paper.target[3 + j] = (paper.haptic_euler[j] - paper.euler[j]) / weight[3 + j]
        state.work[WORK_CANDIDATES] += rows
        solved = _solve(as_int64(6), as_int64(6), rows, options, state, paper, qp)
        if solved:
            _keep_forces(rows, state, paper, qp)
            for j in range(3):
                pose.position[j] += qp.x[j] * weight[j]
                paper.euler[j] += qp.x[3 + j] * weight[3 + j]
            euler_quaternion(paper.euler, pose.orientation)
    if not solved:
        free = palm_is_free(hand, palm, tree, haptic, state, paper)
    if free:
        for j in range(3):
            pose.position[j] = haptic.position[j]
            paper.euler[j] = paper.haptic_euler[j]
        for j in range(4):
            pose.orientation[j] = haptic.orientation[j]
    return solved or free


@jit
def _take_haptic_flexion(hand: HandArrays, state: Record, finger: int) -> None:
    for k in range(PHALANX_COUNT):
        angle = state.haptic.flexion[finger, k]
        state.pose.flexion[finger, k] = min(max(angle, hand.flexion_min[finger, k]), hand.flexion_max[finger, k])


@jit
def finger_program(hand: HandArrays, finger: int, state: Record, paper: Record) -> int:
    """Rows of a finger on the palm as it now stands; returns the number of contact rows, -1 where they do not fit."""
    pose, problem = state.pose, state.problem
    weight = problem.inverse_root[6 + PHALANX_COUNT * finger : 9 + PHALANX_COUNT * finger]
    row = as_int64(0)
    for k in range(PHALANX_COUNT):
        body = PHALANX_COUNT * finger + k
        if row < 0 or state.candidates.count[body] == 0:
            continue
        place_frustum(pose, finger, k, paper.frustum[body])
        row = phalanx_rows(body, row, state, paper)
    if row > 0:
        low, high = hand.flexion_min[finger], hand.flexion_max[finger]
        limit_rows(row, pose.flexion[finger], low, high, weight, problem.common, problem.block, problem.rhs)
        for k in range(PHALANX_COUNT):
            paper.target[k] = (state.haptic.flexion[finger, k] - pose.flexion[finger, k]) / weight[k]
    return row


@jit
def _solve_finger(
    hand: HandArrays, tree: TreeArrays, options: TickOptions, finger: int, state: Record, paper: Record, qp: QpWork
) -> bool:
    pose, problem = state.pose, state.problem
    rows = as_int64(-1)
    if paper.full[finger + 1] == 0:
        rows = finger_program(hand, finger, state, paper)
    if rows == 0:
        _take_haptic_flexion(hand, state, finger)
        return True
    if rows > 0:
        state.work[WORK_CANDIDATES] += rows
        if _solve(as_int64(PHALANX_COUNT), as_int64(0), rows + LIMITS, options, state, paper, qp):
            _keep_forces(rows, state, paper, qp)
            for k in range(PHALANX_COUNT):
                weight = problem.inverse_root[6 + PHALANX_COUNT * finger + k]
                pose.flexion[finger, k] += qp.x[k] * weight
            return True
    for k in range(PHALANX_COUNT):
        paper.tried[finger, k] = pose.flexion[finger, k]
    _take_haptic_flexion(hand, state, finger)
    update_kinematics(hand, pose)
    free = finger_is_free(tree, pose, finger, state, paper)
    if not free:
        for k in range(PHALANX_COUNT):
            pose.flexion[finger, k] = paper.tried[finger, k]
    update_kinematics(hand, pose)
    return free


class Paper(NamedTuple):
    """Method as printed in the paper."""

    options: TickOptions  # margin is Δr
    palm: TreeArrays  # the palm's sphere tree, palm frame
    tree: TreeArrays  # the object's, world frame
    work: NDArray[np.void]  # one record of PAPER_STATE, shape (1,)


@jit
def _count_touching(touch: float, state: Record, paper: Record) -> None:
    # What Eq. 14 sums over: the pairs of this tick that are in contact at its end.
    pose, candidates, contacts = state.pose, state.candidates, state.contacts
    contacts.start[0] = 0
    row = palm_contacts(touch, state, paper)
    contacts.start[1] = row
    for f in range(FINGER_COUNT):
        for k in range(PHALANX_COUNT):
            body = PHALANX_COUNT * f + k
            if candidates.count[body] > 0:
                place_frustum(pose, f, k, paper.frustum[body])
                row = phalanx_contacts(body, touch, row, state, paper)
        contacts.start[f + 2] = row
    state.work[WORK_TOUCHING] = row


@tick.of(Paper)
@jit
def _tick(method: Paper, hand: HandArrays, surface: SurfaceCode, state: Record, qp: QpWork) -> int:
    options, palm, tree, paper = method.options, method.palm, method.tree, method.work[0]
    pose, haptic = state.pose, state.haptic
    state.work[:] = 0
    state.step.duration[:] = 0
    state.step.iterations = 0
    state.progress.lag = 0.0
    stuck = False
    state.step.lap = monotonic_ns()
    for i in range(options.linearisations):
        if i > 0 and spent_units(state) >= options.budget:
            break
        detect(hand, palm, tree, options.margin, state, paper)
        lap(DURATION_DETECT, state)
        state.active.count = 0
        state.work[WORK_CANDIDATES] = 0
        stuck = not _solve_palm(hand, palm, tree, options, state, paper, qp)
        for f in range(FINGER_COUNT):
            pose.abduction[f] = haptic.abduction[f]
        lap(DURATION_PALM, state)
        update_kinematics(hand, pose)
        for f in range(FINGER_COUNT):
            stuck = not _solve_finger(hand, tree, options, f, state, paper, qp) or stuck
        update_kinematics(hand, pose)
        lap(DURATION_FINGERS, state)
        rows, near = state.work[WORK_CANDIDATES], as_int64(0)
        for body in range(BODY_COUNT):
            near += 1 if state.candidates.count[body] > 0 else 0
        count_program(near, rows, rows, rows, state.work[:])
    _count_touching(options.touch, state, paper)
    hand_forces(options, as_bool(False), state)
    # Eq. 1 in the paper's variables: of the palm's rotation its three Euler angles, not the rotation vector.
    for j in range(3):
        state.forces.palm_wrench[3 + j] = state.stiffness[3 + j] * (paper.euler[j] - paper.haptic_euler[j])
    lap(DURATION_FORCE, state)
    state.work[WORK_CANDIDATES] = state.work[WORK_ROWS]
    end_work(state)
    if stuck:
        state.progress.lag = farthest_joint(pose.joints, haptic.joints)
        return STATUS_STUCK
    return 0


@jit
def begin_paper(hand: HandArrays, states: NDArray[np.void], papers: NDArray[np.void]) -> None:
    """Take the graphic hand's configuration as it now stands: kinematics and Euler angles."""
    state, paper = states[0], papers[0]
    update_kinematics(hand, state.pose)
    frustum_shapes(hand, paper.frustum)
    paper.haptic_euler[:] = 0.0
    nearest_euler(state.pose.rotation, paper.haptic_euler, paper.euler)
    paper.guess[0] = 0
