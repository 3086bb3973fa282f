"""One linearisation of a tick: the contacts within reach, and the quadratic program that they make."""

from hhsim.kernels.contact.surface_code import SurfaceCode, find_surface_contacts, pairs_near
from hhsim.kernels.hand.kinematics import FINGER_COUNT, HandArrays
from hhsim.kernels.hand.pose import step_between
from hhsim.kernels.jit import Array, Record, jit_inline
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
