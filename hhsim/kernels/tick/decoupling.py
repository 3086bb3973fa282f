"""When palm and fingers that are solved apart share a program: where they oscillate, or find no step.

A palm that yields to a finger and is pulled back by the next program can do so for ever, without one step that fails.
That is told from the path of the hand, which is long for what it reaches. From then on palm and fingers share a program
until the user's hand has left the place, since apart they would do the same again from where the shared program leads.
"""

from hhsim.kernels.copy import copy_values
from hhsim.kernels.hand.pose import farthest_joint
from hhsim.kernels.jit import Record, jit, jit_once
from hhsim.kernels.tick.method import Progressive, is_oscillating
from hhsim.kernels.tick.options import TickOptions
from hhsim.kernels.tick.state import WORK_LINEARISATIONS

SUSPENSION_MARGINS = 10.0
"""How far the user's hand goes before palm and fingers are solved apart again, in margins."""
WINDOW_STEPS = 6
"""Linearisations after which a path that is long for what it reaches is an oscillation."""
OSCILLATION_RATIO = 3.0
"""Ratio of a window's path to the distance between its ends from which on it is one."""
MOST_DEPARTURES = 10
"""How often the hand may begin to lag anew while the user's rests."""
REST_RATIO = 5.0
REST_MARGINS = 10.0
"""Longest path of lagging ticks while the user's hand rests: so many times the distance to it, and so many margins."""


@jit_once
def stays_suspended(options: TickOptions, state: Record) -> bool:
    """Return whether the user's hand is still near where palm and fingers apart found nothing."""
    decoupling = state.decoupling
    if not decoupling.is_suspended:
        return False
    moved = farthest_joint(decoupling.suspended_joints, state.haptic.joints)
    return moved <= SUSPENSION_MARGINS * options.margin


@jit
def suspend_decoupling(state: Record) -> None:
    """Let palm and fingers share a program in this tick, and as long as the user's hand stays near."""
    state.program.is_coupled = True
    state.decoupling.is_suspended = True
    copy_values(state.haptic.joints[:], state.decoupling.suspended_joints[:])


@jit_once
def follow_path(options: TickOptions, state: Record) -> None:
    """Add the last tick to the path of lagging ticks, before its counters are reset."""
    decoupling, progress = state.decoupling, state.progress
    lags = progress.lag > 0.0
    if lags:
        if farthest_joint(decoupling.rest_joints, state.haptic.joints) <= options.step_tolerance:
            decoupling.departures += 0 if decoupling.lagged else 1
            decoupling.rest_path += progress.path
        else:
            copy_values(state.haptic.joints[:], decoupling.rest_joints[:])
            decoupling.rest_distance = farthest_joint(state.pose.joints, state.haptic.joints)
            decoupling.rest_path = 0.0
            decoupling.departures = 0
    decoupling.lagged = lags
    # A tick of few linearisations is too short to show an oscillation: several make one window.
    if lags and decoupling.window_steps < WINDOW_STEPS:
        decoupling.window_steps += state.work[WORK_LINEARISATIONS]
        decoupling.window_path += progress.path
    else:
        decoupling.window_steps = 0
        decoupling.window_path = 0.0
        copy_values(state.pose.joints[:], decoupling.window_joints[:])


@is_oscillating.of(Progressive)
@jit
def _is_oscillating(method: Progressive, state: Record, done: int) -> bool:
    """Return whether the path of the hand, with this tick's first `done` linearisations, is too long."""
    decoupling = state.decoupling
    if state.program.is_coupled:
        return False
    longest = REST_RATIO * (decoupling.rest_distance + REST_MARGINS * method.options.margin)
    if decoupling.departures > MOST_DEPARTURES or decoupling.rest_path > longest:
        return True
    if decoupling.window_steps + done < WINDOW_STEPS:
        return False
    path = decoupling.window_path + state.progress.path
    return path > OSCILLATION_RATIO * farthest_joint(state.pose.joints, decoupling.window_joints)
