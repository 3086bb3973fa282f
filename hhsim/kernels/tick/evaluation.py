"""True distances at a pose, the work of a tick, and what is known of a hand that was shown by others."""

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.contact.detection import ListDistances, SurfaceCode, evaluate_surface, pairs_near
from hhsim.kernels.contact.surface import COUNT_NODE_TESTS, COUNT_PAIR_TESTS
from hhsim.kernels.hand.kinematics import BODY_COUNT, HandArrays, motion_bounds
from hhsim.kernels.hand.pose import copy_configuration, update_kinematics
from hhsim.kernels.jit import Indices, Record, as_int64, jit, jit_inline, jit_noinline
from hhsim.kernels.tick.force import clear_forces, palm_wrench
from hhsim.kernels.tick.options import TickOptions
from hhsim.kernels.tick.state import (
    STATUS_CAPACITY_EXCEEDED,
    WORK_BODIES,
    WORK_CANDIDATES,
    WORK_LINEARISATIONS,
    WORK_QP_ITERATIONS,
    WORK_ROWS,
    WORK_TOUCHING,
    WORK_UNITS,
)

UNITS_LINEARISATION = 1500
UNITS_NODE_TEST = 10
UNITS_PAIR_TEST = 2
UNITS_CONTACT = 60
UNITS_ROW = 100
UNITS_QP_ITERATION = 1500
"""Work units of each piece of work, about a nanosecond on a 2.6 GHz core with AVX-512; only their ratios matter. A
contact is a pair within reach as it is found, a row one that is kept."""

REACH_PACE = 1.5
"""Reach of a tick's first program, as a multiple of the path of the last tick's hand."""
REACH_FLOOR = 2.0
"""Least reach of a program, as a multiple of the step tolerance; after a whole step, as a multiple of that step."""


@jit_inline
def usual_reach(options: TickOptions, state: Record) -> float:
    """Compute the first program's reach [m], for a hand as fast as in the last tick; a faster one gains it by steps."""
    return min(options.margin, max(REACH_FLOOR * options.step_tolerance, REACH_PACE * state.progress.path))


@jit_noinline
def evaluate_pose(hand: HandArrays, surface: SurfaceCode, options: TickOptions, state: Record) -> bool:
    """Compute kinematics and pair distances at the pose; False, noted in the progress, where the pairs do not fit."""
    update_kinematics(hand, state.pose)
    pose, candidates, margin = state.pose, state.candidates, options.margin
    # As far as the next program may reach, in this tick or in the next.
    needed = max(options.listed, max(state.trust.reach, usual_reach(options, state)))
    # A reach exceeds the step that is expected. Lists that vouch for that step may wait for a tick that makes no other;
    # where a hand's own step turns out longer, `complete_lists` gathers them.
    candidates.allowed_deficit = needed - max(options.listed, needed / REACH_PACE)
    status = evaluate_surface(hand, pose, surface, ListDistances(needed, margin, options.skin), candidates, state.work)
    state.progress.pairs_overflow = status != 0
    return status == 0


@jit_noinline
def complete_lists(hand: HandArrays, surface: SurfaceCode, options: TickOptions, state: Record) -> bool:
    """Gather the pairs that a step would go beyond; returns whether its program is to be built anew.

    Rows that a list lacks are farther than its slack, and change nothing as long as no body moves by so much: the step
    is the one of all rows. A longer one would depend on when a list happened to be gathered.
    """
    candidates, motion, beyond, lacks = state.candidates, state.progress.motion, False, False
    reach = min(state.trust.reach, state.trust.radius)
    for body in range(BODY_COUNT):
        lacks = lacks or candidates.slack[body] < reach
    if not lacks:
        return False
    motion_bounds(hand, state.pose, state.step.delta[:], state.problem.abduction_step[:], 0.0, motion)
    for body in range(BODY_COUNT):
        # A pair that is missing is then still an offset away, so that its row holds.
        slack = candidates.slack[body]
        beyond = beyond or (state.modelled[body] == 1 and slack < reach and motion[body] > slack - options.offset)
    if not beyond:
        return False
    candidates.allowed_deficit = 0.0
    reached = ListDistances(candidates.needed, options.margin, options.skin)
    state.progress.pairs_overflow = evaluate_surface(hand, state.pose, surface, reached, candidates, state.work) != 0
    return not state.progress.pairs_overflow


@jit_inline
def least_distance(state: Record) -> float:
    """Return the least signed distance of all listed pairs [m], of hands' parts too; infinite where there is none."""
    candidates, least = state.candidates, state.hand_contact.least
    for body in range(BODY_COUNT):
        least = min(least, candidates.nearest[body])
    return least


@jit_inline
def count_program(bodies: int, pairs: int, found: int, rows: int, work: Indices) -> None:
    """Add a program to the work of a tick: so many bodies and pairs near, contacts found, and rows kept."""
    work[WORK_BODIES] = max(work[WORK_BODIES], bodies)
    work[WORK_LINEARISATIONS] += 1
    work[WORK_CANDIDATES] = max(work[WORK_CANDIDATES], pairs)
    work[WORK_ROWS] = max(work[WORK_ROWS], rows)
    work[WORK_UNITS] += UNITS_LINEARISATION + UNITS_CONTACT * found + UNITS_ROW * rows


@jit_inline
def spent_units(state: Record) -> int:
    """Compute the work units of the tick so far that count against its budget: those of linearisations, rows and QPs.

    Tests of nodes and pairs do not: lists that are older have more of them, and the hand would depend on that.
    """
    return as_int64(state.work[WORK_UNITS] + UNITS_QP_ITERATION * state.step.iterations)


@jit_inline
def end_work(state: Record) -> None:
    """Write the counters that are summed up elsewhere while the tick runs."""
    work = state.work
    tests = UNITS_NODE_TEST * work[COUNT_NODE_TESTS] + UNITS_PAIR_TEST * work[COUNT_PAIR_TESTS]
    work[WORK_UNITS] = spent_units(state) + tests
    work[WORK_QP_ITERATIONS] = state.step.iterations


@jit_inline
def forget_lists(state: Record) -> None:
    """Empty the lists of pairs of the graphic hand, so that they are gathered anew where it stands."""
    copy_configuration(state.pose, state.prediction.start)
    for body in range(BODY_COUNT):
        # A body that the scene does not use is never due for a walk and never near.
        state.candidates.gathered_slack[body] = -np.inf if state.modelled[body] == 1 else np.inf
        state.candidates.count[body] = 0


@jit
def look_at(hand: HandArrays, surface: SurfaceCode, options: TickOptions, states: NDArray[np.void]) -> int:
    """Compute joints, near and touching pairs and Eq. 1 of the hand; 0, or STATUS_CAPACITY_EXCEEDED far inside."""
    state = states[0]
    pose, candidates, work = state.pose, state.candidates, state.work
    update_kinematics(hand, pose)
    status = evaluate_surface(
        hand, pose, surface, ListDistances(options.margin, options.margin, options.skin), candidates, work
    )
    work[:] = 0
    work[WORK_BODIES], work[WORK_CANDIDATES] = pairs_near(surface, hand, candidates, options.margin)
    _, work[WORK_TOUCHING] = pairs_near(surface, hand, candidates, options.touch)
    clear_forces(state.forces)
    palm_wrench(state)
    return STATUS_CAPACITY_EXCEEDED if status != 0 else 0
