"""One linearisation of a tick: the contacts within reach, and the quadratic program that they make."""

from hhsim.kernels.clock import monotonic_ns
from hhsim.kernels.contact.detection import Reach
from hhsim.kernels.contact.linearise import build_rows, clamp_to_limits
from hhsim.kernels.contact.own_parts import add_own_rows, foresee_own_rows
from hhsim.kernels.contact.redundant_contacts import drop_redundant_contacts
from hhsim.kernels.contact.self_pairs import BROKEN, begin_rows, scale_rows
from hhsim.kernels.contact.surface_code import SurfaceCode, evaluate_surface, find_surface_contacts, pairs_near
from hhsim.kernels.hand.kinematics import BODY_COUNT, DOF, FINGER_COUNT, HandArrays, motion_bounds
from hhsim.kernels.hand.pose import step_between
from hhsim.kernels.jit import Array, Record, jit, jit_inline, jit_noinline
from hhsim.kernels.tick.options import TickOptions
from hhsim.kernels.tick.restoration import LEAST_TRUST, TRUST_DECAY
from hhsim.kernels.tick.state import (
    UNITS_CONTACT,
    UNITS_LINEARISATION,
    UNITS_ROW,
    WORK_BODIES,
    WORK_CANDIDATES,
    WORK_LINEARISATIONS,
    WORK_ROWS,
    WORK_UNITS,
)
from hhsim.kernels.tick.step import DURATION_DETECT


@jit_inline
def step_to_haptic(state: Record, step_out: Array, abduction_out: Array) -> None:
    """Compute the step from the graphic to the haptic hand [m, rad], shape (21,), and that of its abduction, (5,)."""
    step_between(state.pose, state.haptic, step_out, abduction_out, state.scratch)
    for f in range(FINGER_COUNT if state.program.holds_abduction else 0):
        abduction_out[f] = 0.0


@jit_inline
def find_program_contacts(hand: HandArrays, surface: SurfaceCode, options: TickOptions, state: Record) -> bool:
    """Find the contacts within reach, shortened where they do not fit; False if not even those that touch do."""
    while True:
        reach = min(state.trust.reach, state.trust.radius)
        status = find_surface_contacts(surface, hand, state.pose, state.candidates, reach, state.contacts)
        if status == 0 or reach < LEAST_TRUST * options.margin:
            return status == 0
        state.trust.radius = TRUST_DECAY * reach
        state.work[WORK_UNITS] += UNITS_CONTACT * state.contacts.key.shape[0]


@jit_inline
def count_linearisation(
    hand: HandArrays, surface: SurfaceCode, options: TickOptions, found: int, rows: int, state: Record
) -> None:
    """Add a program of so many contacts found and rows kept to the work of the tick."""
    work = state.work
    bodies, pairs = pairs_near(surface, hand, state.candidates, max(options.listed, state.trust.reach))
    work[WORK_BODIES] = max(work[WORK_BODIES], bodies)
    work[WORK_LINEARISATIONS] += 1
    work[WORK_CANDIDATES] = max(work[WORK_CANDIDATES], pairs)
    work[WORK_ROWS] = max(work[WORK_ROWS], rows)
    work[WORK_UNITS] += UNITS_LINEARISATION + UNITS_CONTACT * found + UNITS_ROW * rows


@jit_inline
def write_program(hand: HandArrays, options: TickOptions, relaxed: bool, state: Record) -> None:
    """Write the rows of contacts, joint limits and own parts; scale the target, clamped for fingers without rows."""
    problem, start = state.problem, state.contacts.start
    for f in range(FINGER_COUNT):
        if start[f + 2] == start[f + 1] and state.self_contact.meets[f] == 0:
            clamp_to_limits(hand, state.pose, f, problem.target[:])
    build_rows(hand, state.pose, state.contacts, options.offset, relaxed, problem)
    scale_rows(options.offset, relaxed, state)
    for j in range(DOF):
        problem.target[j] /= problem.inverse_root[j]


@jit
def add_broken_rows(hand: HandArrays, options: TickOptions, share: float, state: Record) -> bool:
    """Add rows for the hand's own parts that a program's step brings together, and build it anew; False for none.

    The program's target is a share of the way to the user's hand.
    """
    if not add_own_rows(options.own, hand, BROKEN, options, state):
        return False
    problem = state.problem
    step_to_haptic(state, problem.target[:], problem.abduction_step[:])
    for j in range(DOF):
        problem.target[j] *= share
    for f in range(FINGER_COUNT):
        problem.abduction_step[f] *= share * state.self_contact.share[f]
    write_program(hand, options, state.program.is_relaxed, state)
    return True


@jit
def build_program(hand: HandArrays, surface: SurfaceCode, options: TickOptions, state: Record) -> int:
    """Build the program at the present configuration; return the number of contacts, -1 where they do not fit.

    Without a contact its solution is written, too: the step to the user's hand within the joints' limits.
    """
    began = monotonic_ns()
    problem = state.problem
    begin_rows(state.self_contact)
    if not find_program_contacts(hand, surface, options, state):
        return -1
    found = state.contacts.start[FINGER_COUNT + 1]
    drop_redundant_contacts(hand, min(state.trust.reach, state.trust.radius), state.contacts, state.open_distance[:])
    step_to_haptic(state, problem.target[:], problem.abduction_step[:])
    contacts = state.contacts.start[FINGER_COUNT + 1]
    count_linearisation(hand, surface, options, found, contacts, state)
    foresee_own_rows(options.own, hand, state.warm, options, state)
    if contacts + state.self_contact.count == 0:
        for j in range(DOF):
            state.step.delta[j] = problem.target[j]
        for f in range(FINGER_COUNT):
            clamp_to_limits(hand, state.pose, f, state.step.delta[:])
        state.step.count = 0
    else:
        write_program(hand, options, state.program.is_relaxed, state)
    state.step.duration[DURATION_DETECT] += monotonic_ns() - began
    return contacts


# Absorbed by its one caller it made every tick on triangles 5 % slower.
@jit_noinline
def complete_lists(hand: HandArrays, surface: SurfaceCode, options: TickOptions, state: Record) -> bool:
    """Gather the pairs that a program's step would go beyond; returns whether the program is to be built anew.

    Rows that a list lacks are farther than its slack, and change nothing as long as no body moves by so much: the step
    is the one of all rows. A longer one would depend on when a list happened to be gathered.
    """
    candidates, motion = state.candidates, state.progress.motion
    reach = min(state.trust.reach, state.trust.radius)
    lacking = False
    for body in range(BODY_COUNT):
        lacking = lacking or candidates.slack[body] < reach
    if not lacking:
        return False
    motion_bounds(hand, state.pose, state.step.delta, state.problem.abduction_step, 0.0, motion)
    beyond = False
    for body in range(BODY_COUNT):
        # A pair that is missing is then still an offset away, so that its row holds.
        slack = candidates.slack[body]
        beyond = beyond or (state.modelled[body] == 1 and slack < reach and motion[body] > slack - options.offset)
    if not beyond:
        return False
    candidates.allowed_deficit = 0.0
    reached = Reach(candidates.needed, options.margin, options.skin)
    if evaluate_surface(hand, state.pose, surface, reached, candidates, state.work) != 0:
        state.progress.pairs_overflow = True
        return False
    return True
