"""Forces of a hand that is shown where no program has its optimum: what touches there bears the coupling."""

from hhsim.kernels.contact.own_parts import add_own_rows
from hhsim.kernels.contact.self_pairs import begin_rows
from hhsim.kernels.contact.surface_code import SurfaceCode, find_surface_contacts
from hhsim.kernels.hand.kinematics import FINGER_COUNT, HandArrays
from hhsim.kernels.jit import Record, as_bool, jit
from hhsim.kernels.qp.active_set import OPTIMAL, QpWork
from hhsim.kernels.tick.coupled import solve_coupled
from hhsim.kernels.tick.linearisation import step_to_haptic, write_program
from hhsim.kernels.tick.method import Coupled
from hhsim.kernels.tick.options import TickOptions
from hhsim.kernels.tick.step import DURATION_FINGERS, DURATION_PALM, store_active, store_meeting

ON_THE_WAY = 20.0
"""Distance up to which a lagging hand bears on the object, in offsets: its last step has not brought it nearer yet."""


@jit
def settle_forces(hand: HandArrays, surface: SurfaceCode, options: TickOptions, state: Record, qp: QpWork) -> None:
    """Compute the multipliers of the contacts that touch at the configuration shown.

    A lagging tick's last program was made for another configuration, and a finger's own program that the palm has
    yielded to has multipliers without bound. One more program, of the touching contacts alone, gives them: standing
    still satisfies it, so that they stay within the coupling's own. Without a solution they stay as they were. It
    counts in the forces' time.
    """
    duration = state.step.duration
    palm, fingers = duration[DURATION_PALM], duration[DURATION_FINGERS]
    near = max(options.touch, ON_THE_WAY * options.offset) if state.progress.lag > 0.0 else options.touch
    status = find_surface_contacts(surface, hand, state.pose, state.candidates, near, state.contacts)
    own = state.self_contact
    begin_rows(own)
    add_own_rows(options.own, hand, near, options, state)
    if status == 0 and state.contacts.start[FINGER_COUNT + 1] + own.count == 0:
        state.active.count = 0
    elif status == 0:
        step_to_haptic(state, state.problem.target[:], state.problem.abduction_step[:])
        for f in range(FINGER_COUNT):
            state.problem.abduction_step[f] = 0.0
        write_program(hand, options, as_bool(True), state)
        if solve_coupled(Coupled(options), state, qp) == OPTIMAL:
            store_active(state.contacts, state.step, state.active)
            store_meeting(options.own.pairs, state, state.active)
    duration[DURATION_PALM] = palm
    duration[DURATION_FINGERS] = fingers
