"""Stages of a tick: its beginning, a linearisation, an accepted step, its status, and when decoupling is suspended.

In `progressive`, a palm that yields to a finger can be pulled back by the next program, endlessly and without a failed
step. A tick that lags and has not reduced the coupling's energy therefore solves palm and fingers together, as does one
whose separate steps all end inside the object. They stay together until the user's hand moves away.

`kernels.world.tick` says what a tick is. With ρ the smaller of the trust region's radius and reach, `allowed_fraction`
lets body b move by min(slack, ρ) if one of its pairs is within ρ, else by min(slack, its least distance): pairs that
are not listed are farther than the slack. An unfinished tick leaves three flags to the next: clearance waived, palm and
fingers together, abduction held.
"""

import numpy as np

from hhsim.kernels.contact.detection import SurfaceCode, find_surface_contacts
from hhsim.kernels.hand.kinematics import BODY_COUNT, FINGER_COUNT, PHALANX_COUNT, HandArrays
from hhsim.kernels.hand.pose import copy_configuration, farthest_joint, step_between
from hhsim.kernels.jit import Array, Record, jit, jit_inline
from hhsim.kernels.memory import copy_values
from hhsim.kernels.rotation import rotation_vector_between
from hhsim.kernels.tick.evaluation import UNITS_CONTACT, usual_reach
from hhsim.kernels.tick.options import TickOptions
from hhsim.kernels.tick.state import STATUS_ABDUCTION_HELD, STATUS_LAG, STATUS_STUCK, WORK_UNITS
from hhsim.kernels.tick.step import WHOLE_TARGET, copy_active, set_bound

TRUST_DECAY = 0.25
"""Share of the trust radius that is left when a step has been taken back."""
LEAST_TRUST = 1e-6
"""Share of the margin, or of a step, that is not worth a step."""
STEADY = 2.0
"""Ratio of a tick's path to that of the tick before, above which the hand has jumped and nothing is predicted."""
SUSPENSION_MARGINS = 10.0
"""Motion of the haptic hand after which palm and fingers are solved apart again, in margins."""
PROGRESS = 0.9
"""Share of the coupling's energy to which a lagging tick must at least bring it down."""


@jit
def suspend_decoupling(state: Record) -> None:
    """Let palm and fingers share a program in this tick, and as long as the user's hand stays near."""
    state.fallback.is_coupled = True
    state.decoupling.is_suspended = True
    copy_values(state.haptic.joints[:], state.decoupling.suspended_joints[:])


@jit
def coupling_energy(pose: Record, state: Record) -> float:
    """Compute the energy ½ δᵀ G δ [J] of the coupling between a pose and the haptic hand (paper, Eq. 2)."""
    haptic, weight = state.haptic, state.problem.inverse_root
    rotation_vector_between(pose.orientation, haptic.orientation, state.scratch)
    total = 0.0
    for i in range(3):
        total += ((haptic.position[i] - pose.position[i]) / weight[i]) ** 2 + (state.scratch[i] / weight[3 + i]) ** 2
    for f in range(FINGER_COUNT):
        for k in range(PHALANX_COUNT):
            total += ((haptic.flexion[f, k] - pose.flexion[f, k]) / weight[6 + PHALANX_COUNT * f + k]) ** 2
    return 0.5 * total


@jit
def energy_stalled(state: Record) -> bool:
    """Return whether the programs apart of a tick that lags have made no progress."""
    if state.fallback.is_coupled:
        return False
    return coupling_energy(state.pose, state) > PROGRESS * coupling_energy(state.prediction.start, state)


@jit_inline
def step_to_haptic(state: Record, step_out: Array, abduction_out: Array) -> None:
    """Compute the step from the graphic to the haptic hand [m, rad], shape (21,), and that of its abduction, (5,)."""
    step_between(state.pose, state.haptic, step_out, abduction_out, state.scratch)
    for f in range(FINGER_COUNT if state.fallback.holds_abduction else 0):
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


REACH_GROWTH = 4.0
"""Growth of the reach after a step that it has cut short."""
TRUST_GROWTH = 2.0
"""Growth of the trust radius from one unfinished tick to the next, after a step that was accepted."""
MOST_FAILED_STEPS = 3
"""Steps in a row that may end inside the object before they are taken back."""
MOST_IDLE_TICKS = 10
"""Ticks in a row that may accept no step before those that the budget cuts short count as stuck, too."""


@jit
def _carry_over_trust(options: TickOptions, state: Record) -> None:
    """Adjust the trust radius of an unfinished tick and keep its flags, or begin with the whole margin.

    Else ticks whose work runs out before they accept a step could repeat themselves for ever.
    """
    progress, trust, fallback = state.progress, state.trust, state.fallback
    if progress.is_unfinished:
        if progress.is_accepted and progress.failed_steps == 0:
            trust.radius = min(options.margin, TRUST_GROWTH * trust.radius)
        elif progress.failed_steps > 0 and not progress.is_accepted:
            trust.radius *= TRUST_DECAY
    if not progress.is_unfinished or trust.radius < LEAST_TRUST * options.margin:
        progress.is_unfinished = False
        trust.radius = options.margin
        fallback.is_relaxed = False
        fallback.holds_abduction = False
        fallback.is_coupled = state.decoupling.is_suspended


@jit_inline
def begin_tick(options: TickOptions, state: Record) -> None:
    """Reset what belongs to one tick; the present configuration, evaluated and free of penetration, is the safe one."""
    progress, prediction, decoupling = state.progress, state.prediction, state.decoupling
    copy_configuration(state.pose, state.safe)
    progress.differs_from_safe = False
    if decoupling.is_suspended:
        moved = farthest_joint(decoupling.suspended_joints, state.haptic.joints)
        decoupling.is_suspended = moved <= SUSPENSION_MARGINS * options.margin
    _carry_over_trust(options, state)
    state.progressive.variables = 6
    progress.is_accepted = False
    progress.pairs_overflow = False
    progress.failed_steps = progress.restarted = 0
    state.first_step.free_share = 0.0
    state.step.duration[:] = 0
    state.step.iterations = 0
    state.trust.reach = usual_reach(options, state)
    prediction.is_steady = progress.lag == 0.0 and progress.path <= STEADY * prediction.previous_path
    prediction.previous_path = progress.path
    state.work[:] = 0
    progress.path = 0.0
    set_bound(options, state)
    progress.lag = 0.0


@jit_inline
def accept(options: TickOptions, fraction: float, longest: float, full_motion: float, state: Record) -> bool:
    """Let the present configuration be the safe one; returns whether the tick is done.

    `fraction` is the share of the program's step that led here; `longest` and `full_motion` [m] are the motions of the
    whole step and of that with the true target, or `WHOLE_TARGET`.
    """
    progress = state.progress
    copy_configuration(state.pose, state.safe)
    progress.differs_from_safe = False
    copy_active(state.warm, state.active)
    progress.is_accepted = True
    state.prediction.is_predicted = False
    progress.failed_steps = 0
    unhindered = state.contacts.start[FINGER_COUNT + 1] + state.hand_contact.rows == 0
    is_whole = fraction == 1.0 and full_motion == WHOLE_TARGET
    done = is_whole and (unhindered or longest <= options.step_tolerance)
    progress.lag = max(full_motion, longest) - fraction * longest
    if done:
        progress.lag = 0.0
    elif progress.lag == 0.0:
        # A whole step, but not a short one: if the budget ended here, up to as much again could be left to go.
        progress.lag = longest
    return done


@jit_inline
def update_reach(
    options: TickOptions, fraction: float, longest: float, full_motion: float, foreseen: float, state: Record
) -> None:
    """Add a step to the path, and set the next one's reach from `foreseen` [m] and what `accept` is given."""
    progress, trust = state.progress, state.trust
    for body in range(BODY_COUNT):
        progress.differs_from_safe = progress.differs_from_safe or fraction * progress.motion[body] > 0.0
    progress.path += fraction * longest
    if fraction < 1.0 or full_motion != WHOLE_TARGET:
        trust.reach = min(options.margin, REACH_GROWTH * trust.reach)
    else:
        # After a whole step the rest is of second order: only near contacts matter.
        trust.reach = min(trust.reach, foreseen)


@jit_inline
def tick_status(cut_short: bool, made_part: bool, state: Record) -> int:
    """Return the tick's status bits; `cut_short` by the work budget, `made_part` of a step at its end."""
    progress, status = state.progress, 0
    # A step that was cut short may have ended inside, and a shorter way have led all the way.
    progress.snaps = progress.snaps and progress.is_accepted and progress.lag > 0.0
    progress.idle_ticks = 0 if progress.is_accepted else progress.idle_ticks + 1
    if not progress.is_accepted:
        # A tick whose budget ended before it found a step is on its way: the next one goes on. But not for ever.
        status |= STATUS_LAG if cut_short and progress.idle_ticks <= MOST_IDLE_TICKS else STATUS_STUCK
        progress.lag = np.inf
    elif progress.lag > 0.0:
        status |= 0 if progress.snaps else STATUS_LAG
    progress.is_unfinished = not progress.is_accepted or made_part or (progress.is_unfinished and progress.lag > 0.0)
    if progress.is_accepted and (state.fallback.holds_abduction or state.hand_contact.holds):
        status |= STATUS_ABDUCTION_HELD
    if status & (STATUS_STUCK | STATUS_LAG) or progress.snaps:
        # Along a soft, almost unconstrained direction a step can be longer than the distance left to the haptic hand.
        progress.lag = min(progress.lag, farthest_joint(state.pose.joints, state.haptic.joints))
    return status
