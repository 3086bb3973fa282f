"""Suspension of decoupling: palm and fingers share one program where apart they make no progress.

A palm that yields to a finger and is pulled back by the next program can do so for ever, without one step that fails.
The energy of the coupling tells, which the step of a shared program brings down. So a tick that lags and has not
brought it down lets palm and fingers share a program, as does one whose steps apart all end inside the object. They
share it until the user's hand has left the place: apart they would do the same again from where they come to rest.
"""

from hhsim.kernels.copy import copy_values
from hhsim.kernels.hand.kinematics import FINGER_COUNT, PHALANX_COUNT
from hhsim.kernels.hand.pose import farthest_joint
from hhsim.kernels.jit import Record, jit
from hhsim.kernels.rotation import rotation_vector_between
from hhsim.kernels.tick.options import TickOptions

SUSPENSION_MARGINS = 10.0
"""Motion of the haptic hand after which palm and fingers are solved apart again, in margins."""
PROGRESS = 0.9
"""Share of the coupling's energy to which a lagging tick must at least bring it down."""


@jit
def stays_suspended(options: TickOptions, state: Record) -> bool:
    """Return whether the user's hand is still near where palm and fingers apart made no progress."""
    decoupling = state.decoupling
    if not decoupling.is_suspended:
        return False
    moved = farthest_joint(decoupling.suspended_joints, state.haptic.joints)
    return moved <= SUSPENSION_MARGINS * options.margin


@jit
def palm_yielded(state: Record) -> bool:
    """Return True if a finger has joined the palm's program: its own multipliers then grow without bound, no forces."""
    return state.progressive.variables > 6


@jit
def suspend_decoupling(state: Record) -> None:
    """Let palm and fingers share a program in this tick, and as long as the user's hand stays near."""
    state.program.is_coupled = True
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
    if state.program.is_coupled:
        return False
    return coupling_energy(state.pose, state) > PROGRESS * coupling_energy(state.prediction.start, state)
