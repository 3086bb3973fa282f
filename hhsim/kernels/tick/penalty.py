"""Method `penalty`: spring-dampers instead of constraints, the way of simulations that do not optimise.

docs/methods.md has its equation of motion and its sources: one backward Euler step of 21 virtual masses M = G τ²,
coupled to the haptic hand with D = 2 G τ, critically damped, each contact's spring-damper at the *end* of the step. A
pair that is free at the beginning has no damper: its closing speed would push before it touches. The damper is tied to
the world, so that a sensor's steps do not kick the hand; the price is a delay of 2 τ. In y = √G δ
(`kernels.contact.linearise`) all three matrices are multiples of the identity, and the step is the minimum of

    ½ α |y|² - y · (y* + τ²/h √G v) + Σ ½ w_i max(0, r_i - a_i · y)²,   α = 1 + 2τ/h + τ²/h²,

convex and piecewise quadratic. A Newton iteration finds it in a few rounds: which contacts push, one Cholesky
factorisation (`kernels.qp.qr_update`), and again until the set stays. Joint limits are springs `LIMIT_WEIGHT` times as
stiff as the joint's. Every sphere in touch has its own spring: to divide by their number, or to keep the deepest alone,
would make the force jump where one joins. The backward step is stable at any stiffness.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.by_reference import by_reference
from hhsim.kernels.clock import monotonic_ns
from hhsim.kernels.contact.detection import (
    CONTACT_ROWS,
    ListDistances,
    SurfaceCode,
    evaluate_surface,
    find_surface_contacts,
    pairs_near,
)
from hhsim.kernels.contact.linearise import build_rows
from hhsim.kernels.hand.kinematics import BODY_COUNT, DOF, FINGER_COUNT, PHALANX_COUNT, HandArrays
from hhsim.kernels.hand.pose import move, update_kinematics
from hhsim.kernels.jit import Array, Record, as_int64, jit, jit_inline
from hhsim.kernels.memory import copy_values
from hhsim.kernels.qp.active_set import QpWork
from hhsim.kernels.qp.qr_update import factorise, solve_factorised
from hhsim.kernels.tick.block import tick
from hhsim.kernels.tick.evaluation import UNITS_QP_ITERATION, count_program, end_work, spent_units
from hhsim.kernels.tick.force import FORCE_PAPER, add_force, clear_forces, finish_forces, proxy_forces
from hhsim.kernels.tick.options import TickOptions
from hhsim.kernels.tick.state import STATUS_CAPACITY_EXCEEDED, WORK_ROWS, WORK_TOUCHING
from hhsim.kernels.tick.step import DURATION_DETECT, DURATION_FORCE, DURATION_PALM, lap
from hhsim.kernels.tick.tick import begin_tick, step_to_haptic

LIMIT_WEIGHT = 1e10
"""Stiffness of a joint's limit, in units of the joint's coupling."""
DEPTHS = 12
"""Number of times the depth from which pairs are taken is doubled before a hand is too deep inside for the arrays."""


@by_reference
class PenaltyOptions(NamedTuple):
    """Dynamics of a tick."""

    period: float  # h, what a tick lasts [s]
    response: float  # τ, time constant of the coupling [s]
    stiffness: float  # k of every contact [N/m]
    damping: float  # b of every contact [N·s/m]


PENALTY_STATE = np.dtype(
    [
        ("velocity", np.float64, (DOF,)),  # √G v
        ("bias", np.float64, (DOF,)),  # what the step would be without contacts, times α
        ("step", np.float64, (DOF,)),  # y = √G δ
        ("before", np.float64, (DOF,)),  # that of the round before
        ("lowest", np.float64, (DOF,)),  # joint limits as lower bounds of y
        ("highest", np.float64, (DOF,)),  # as upper ones
        ("matrix", np.float64, (DOF, DOF)),  # of the Newton round
        ("row", np.float64, (6 + PHALANX_COUNT,)),  # of one contact
        ("weight", np.float64, (CONTACT_ROWS,)),  # w of each contact [N/m]
        ("threshold", np.float64, (CONTACT_ROWS,)),  # r of each contact: it pushes where a · y < r [m]
        ("short", np.float64, (CONTACT_ROWS,)),  # r - a · y: how far a contact falls short of that [m]
        ("short_before", np.float64, (CONTACT_ROWS,)),  # a round before [m]
        ("pushes", np.int8, (CONTACT_ROWS,)),  # 1 for contacts that push in this round, else 0
        ("bent", np.int64, (DOF,)),  # 1 where a joint's upper limit pushes, -1 its lower one, else 0
    ],
    align=True,
)
"""State of the method from tick to tick, and its workspace, besides the state of every method (`tick.state`)."""


@jit
def _evaluate(hand: HandArrays, surface: SurfaceCode, options: TickOptions, state: Record) -> bool:
    # A hand deep inside has more pairs near than there is room for: then the deepest have to do.
    margin, candidates = options.margin, state.candidates
    distances = ListDistances(margin, margin, options.skin)
    if evaluate_surface(hand, state.pose, surface, distances, candidates, state.work) == 0:
        return True
    reach = 0.0
    for _ in range(DEPTHS):
        if evaluate_surface(hand, state.pose, surface, ListDistances(reach, reach, 0.0), candidates, state.work) == 0:
            return True
        reach = 2.0 * reach - margin
    return False


@jit
def _find(hand: HandArrays, surface: SurfaceCode, options: TickOptions, state: Record) -> bool:
    # Contacts among the pairs known to be complete; again the deepest where they are too many.
    reach = options.margin
    for body in range(BODY_COUNT):
        reach = min(reach, state.candidates.slack[body])
    for _ in range(DEPTHS):
        if find_surface_contacts(surface, hand, state.pose, state.candidates, reach, state.contacts) == 0:
            return True
        reach = 0.0 if reach > 0.0 else 2.0 * reach - options.margin
    return False


@jit_inline
def _aim(hand: HandArrays, penalty: PenaltyOptions, state: Record, work: Record) -> None:
    pose, problem = state.pose, state.problem
    step_to_haptic(state, problem.target[:], problem.abduction_step[:])
    for j in range(6):
        work.lowest[j] = -np.inf
        work.highest[j] = np.inf
    for f in range(FINGER_COUNT):
        for k in range(PHALANX_COUNT):
            j = 6 + PHALANX_COUNT * f + k
            bend = pose.flexion[f, k]
            work.lowest[j] = min(hand.flexion_min[f, k] - bend, 0.0) / problem.inverse_root[j]
            work.highest[j] = max(hand.flexion_max[f, k] - bend, 0.0) / problem.inverse_root[j]
    momentum = penalty.response * penalty.response / penalty.period
    for j in range(DOF):
        work.bias[j] = problem.target[j] / problem.inverse_root[j] + momentum * work.velocity[j]


@jit
def _springs(penalty: PenaltyOptions, contacts: Record, rhs: Array, work: Record) -> None:
    # Stiffness and threshold of every contact; those that penetrate are the first guess of those that push.
    stiffness = penalty.stiffness
    damped = stiffness + penalty.damping / penalty.period
    for i in range(contacts.start[FINGER_COUNT + 1]):
        inside = contacts.distance[i] < 0.0
        work.pushes[i] = 1 if inside else 0
        work.weight[i] = damped if inside else stiffness
        work.threshold[i] = rhs[i] * (stiffness / damped) if inside else rhs[i]


@jit
def _add_spring(problem: Record, i: int, finger: int, weight: float, threshold: float, work: Record) -> None:
    # w a aᵀ to the matrix, w r a to the right-hand side; finger -1 is the palm.
    row, matrix, rhs = work.row, work.matrix, work.step
    for j in range(6):
        row[j] = problem.common[j, i]
    for a in range(6):
        scaled = weight * row[a]
        rhs[a] += scaled * threshold
        for b in range(a, 6):
            matrix[a, b] += scaled * row[b]
    if finger < 0:
        return
    first = 6 + PHALANX_COUNT * finger
    for k in range(PHALANX_COUNT):
        row[6 + k] = problem.block[k, i]
    for a in range(6):
        scaled = weight * row[a]
        for k in range(PHALANX_COUNT):
            matrix[a, first + k] += scaled * row[6 + k]
    for a in range(PHALANX_COUNT):
        scaled = weight * row[6 + a]
        rhs[first + a] += scaled * threshold
        for b in range(a, PHALANX_COUNT):
            matrix[first + a, first + b] += scaled * row[6 + b]


@jit
def _round(problem: Record, contacts: Record, alpha: float, work: Record) -> int:
    # The minimum while exactly those push that do now; returns the solver's status.
    work.matrix[:, :] = 0.0
    for j in range(DOF):
        work.matrix[j, j] = alpha
        work.step[j] = work.bias[j]
        if work.bent[j] != 0:
            work.matrix[j, j] += LIMIT_WEIGHT
            work.step[j] += LIMIT_WEIGHT * (work.highest[j] if work.bent[j] > 0 else work.lowest[j])
    for group in range(FINGER_COUNT + 1):
        for i in range(contacts.start[group], contacts.start[group + 1]):
            if work.pushes[i] != 0:
                _add_spring(problem, i, group - 1, work.weight[i], work.threshold[i], work)
    status = factorise(work.matrix, as_int64(DOF))
    if status == 0:
        solve_factorised(work.matrix, as_int64(DOF), work.step)
    return status


@jit
def _shortfalls(problem: Record, contacts: Record, y: Array, threshold: Array, out: Array) -> None:
    # r - a · y of all contacts.
    common, block = problem.common, problem.block
    for i in range(contacts.start[FINGER_COUNT + 1]):
        out[i] = threshold[i]
    for j in range(6):
        value = y[j]
        for i in range(contacts.start[FINGER_COUNT + 1]):
            out[i] -= common[j, i] * value
    for f in range(FINGER_COUNT):
        for k in range(PHALANX_COUNT):
            value = y[6 + PHALANX_COUNT * f + k]
            for i in range(contacts.start[f + 1], contacts.start[f + 2]):
                out[i] -= block[k, i] * value


@jit_inline
def _slope(contacts: Record, alpha: float, share: float, work: Record) -> float:
    # Derivative of the function along the way from `before` to `step`, at a share of it.
    slope = 0.0
    for j in range(DOF):
        way = work.step[j] - work.before[j]
        y = work.before[j] + share * way
        force = alpha * y - work.bias[j]
        if y > work.highest[j]:
            force += LIMIT_WEIGHT * (y - work.highest[j])
        elif y < work.lowest[j]:
            force += LIMIT_WEIGHT * (y - work.lowest[j])
        slope += force * way
    for i in range(contacts.start[FINGER_COUNT + 1]):
        way = work.short[i] - work.short_before[i]
        short = work.short_before[i] + share * way
        if short > 0.0:
            slope += work.weight[i] * short * way
    return slope


@jit
def _shorten(contacts: Record, alpha: float, work: Record) -> bool:
    # Where the Newton step overshoots the least value on its way, go there: so the value falls in every round and no
    # set of contacts can come back. Bisection halves the way 30 times: exact enough for a step that is not the last.
    if _slope(contacts, alpha, 1.0, work) <= 0.0:
        return False
    low, high = 0.0, 1.0
    for _ in range(30):
        middle = 0.5 * (low + high)
        if _slope(contacts, alpha, middle, work) > 0.0:
            high = middle
        else:
            low = middle
    for j in range(DOF):
        work.step[j] = work.before[j] + high * (work.step[j] - work.before[j])
    for i in range(contacts.start[FINGER_COUNT + 1]):
        work.short[i] = work.short_before[i] + high * (work.short[i] - work.short_before[i])
    return True


@jit_inline
def _update(contacts: Record, work: Record) -> int:
    # Who pushes at `step`; returns how many have changed.
    changed = 0
    for i in range(contacts.start[FINGER_COUNT + 1]):
        pushes = 1 if work.short[i] > 0.0 else 0
        if pushes != work.pushes[i]:
            changed += 1
            work.pushes[i] = pushes
    for j in range(6, DOF):
        bent = 0
        if work.step[j] > work.highest[j]:
            bent = 1
        elif work.step[j] < work.lowest[j]:
            bent = -1
        if bent != work.bent[j]:
            changed += 1
            work.bent[j] = bent
    return changed


@jit
def _minimise(problem: Record, contacts: Record, alpha: float, rounds: int, work: Record) -> int:
    # The step; returns the number of rounds.
    for j in range(DOF):
        work.bent[j] = 0
    for i in range(rounds):
        if _round(problem, contacts, alpha, work) != 0:
            # Cannot happen while all numbers are finite: the matrix is α times the identity and more.
            work.step[:] = 0.0
            return i + 1
        _shortfalls(problem, contacts, work.step, work.threshold, work.short)
        if _update(contacts, work) == 0:
            return i + 1
        if i > 0 and _shorten(contacts, alpha, work):
            _update(contacts, work)
        copy_values(work.step[:], work.before[:])
        for c in range(contacts.start[FINGER_COUNT + 1]):
            work.short_before[c] = work.short[c]
    return rounds


@jit
def _forces(options: TickOptions, hand: HandArrays, surface: SurfaceCode, state: Record, work: Record) -> None:
    forces, contacts = state.forces, state.contacts
    clear_forces(forces)
    if options.force_model == FORCE_PAPER:
        find_surface_contacts(surface, hand, state.pose, state.candidates, options.touch, contacts)
        proxy_forces(options, state)
    else:
        for i in range(contacts.start[FINGER_COUNT + 1]):
            if work.pushes[i] == 0 or work.short[i] <= 0.0:
                continue
            push, normal = work.weight[i] * work.short[i], contacts.normal
            add_force(forces, contacts.body[i], normal[0, i], normal[1, i], normal[2, i], push)
    finish_forces(options, state)


class Penalty(NamedTuple):
    """Spring-dampers; `work` is one record of PENALTY_STATE, shape (1,)."""

    options: TickOptions
    dynamics: PenaltyOptions
    work: NDArray[np.void]


@tick.of(Penalty)
@jit
def _tick(method: Penalty, hand: HandArrays, surface: SurfaceCode, state: Record, qp: QpWork) -> int:
    options, penalty, work = method.options, method.dynamics, method.work[0]
    state.step.lap = monotonic_ns()
    begin_tick(options, state)
    problem, contacts = state.problem, state.contacts
    status = 0 if _find(hand, surface, options, state) else STATUS_CAPACITY_EXCEEDED
    _aim(hand, penalty, state, work)
    build_rows(hand, state.pose, contacts, 0.0, state.fallback.is_relaxed, problem.abduction_step[:], problem)
    _springs(penalty, contacts, problem.rhs, work)
    count, near = contacts.start[FINGER_COUNT + 1], as_int64(0)
    for body in range(BODY_COUNT):
        near += 1 if state.candidates.nearest[body] <= options.margin else 0
    # Its rows cost rounds alone.
    count_program(near, count, count, as_int64(0), state.work[:])
    state.work[WORK_ROWS] = count
    lap(DURATION_DETECT, state)

    share = penalty.response / penalty.period
    alpha = 1.0 + 2.0 * share + share * share
    affordable = max((options.budget - spent_units(state)) // UNITS_QP_ITERATION, 1)
    rounds = _minimise(problem, contacts, alpha, min(options.linearisations, affordable), work)
    state.step.iterations = rounds
    for j in range(DOF):
        y = min(max(work.step[j], work.lowest[j]), work.highest[j])
        work.velocity[j] = y / penalty.period
        state.step.delta[j] = y * problem.inverse_root[j]
    lap(DURATION_PALM, state)

    move(state.pose, state.step.delta, problem.abduction_step, 1.0)
    update_kinematics(hand, state.pose)
    if not _evaluate(hand, surface, options, state):
        status |= STATUS_CAPACITY_EXCEEDED
    _, state.work[WORK_TOUCHING] = pairs_near(surface, hand, state.candidates, options.touch)
    end_work(state)
    lap(DURATION_DETECT, state)
    _forces(options, hand, surface, state, work)
    lap(DURATION_FORCE, state)
    return status
