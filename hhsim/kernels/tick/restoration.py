"""What a tick does about steps that end inside the object and programs without solution."""

from typing import Any

from hhsim.kernels.hand.kinematics import BODY_COUNT, HandArrays
from hhsim.kernels.hand.pose import copy_configuration
from hhsim.kernels.jit import Record, jit
from hhsim.kernels.tick.evaluation import evaluate_pose
from hhsim.kernels.tick.method import Coupled, Progressive, recover

TRUST_DECAY = 0.25
"""Share of the trust radius that is left when a step has been taken back."""
LEAST_TRUST = 1e-6
"""Share of the margin that is not worth a step."""


@jit
def take_back(state: Record) -> None:
    """Return to the last configuration without penetration."""
    copy_configuration(state.safe, state.pose)
    for body in range(BODY_COUNT):
        state.progress.since_safe[body] = 0.0
    state.progress.failed_steps = 0


@recover.of(Coupled)
@recover.of(Progressive)
@jit
def make_easier(method: Any, hand: HandArrays, surface: Any, state: Record) -> bool:
    """Make the next program easier after one without solution; returns False where nothing is left to try.

    First contacts nearer than the offset may stay as near as they are, then the hand returns to the last feasible
    configuration with a smaller trust radius, then the abduction stays as it is.
    """
    program = state.program
    if not program.is_relaxed:
        program.is_relaxed = True
        program.is_coupled = True
        return True
    moved = 0.0
    for body in range(BODY_COUNT):
        moved += state.progress.since_safe[body]
    if moved > 0.0:
        if not state.prediction.is_predicted:
            state.trust.radius *= TRUST_DECAY
        state.prediction.is_predicted = False
        take_back(state)
        return evaluate_pose(hand, surface, method.options, state)
    if not program.holds_abduction:
        program.holds_abduction = True
        return True
    return False
