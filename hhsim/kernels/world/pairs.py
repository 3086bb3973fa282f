"""Pairs of a world: arguments of its ticks, stages called by address, and bounds of the shown hands.

A hand is kept as each body sees it, and so is each body as another one sees it: as a palm without fingers, of spheres
or points (`kernels.world.columns` says what a pair is).

Where nothing else moves, a hand that would go beyond the bound of its way in a tick makes a share of its step
(`keep_bound` of `kernels.tick.step`). A share of a step would hold back the bodies, too, as if they met something. So
the hands are damped instead: with q₀ where a hand stood at the start of the tick, the program's objective becomes

    ½ |q - user|²_G + ½ s |q - q₀|²_G,

and s, usually 0, is raised until no joint goes beyond the bound. Contact forces and the bodies' motion stay in balance.
"""

import math
from collections import namedtuple
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.by_reference import by_reference
from hhsim.kernels.contact.detection import SurfaceCode
from hhsim.kernels.contact.hand_pairs import EXACT, MEASURE_PAIRS, ask_pairs
from hhsim.kernels.hand.kinematics import DOF, FINGER_COUNT, PHALANX_COUNT, HandArrays
from hhsim.kernels.hand.pose import farthest_joint
from hhsim.kernels.jit import Array, Record, as_bool, as_int64, jit, jit_inline, jit_noinline
from hhsim.kernels.machine_code import number_of_code
from hhsim.kernels.memory import copy_values
from hhsim.kernels.rotation import rotation_vector_between, turned
from hhsim.kernels.tick.evaluation import evaluate_pose, forget_lists
from hhsim.kernels.tick.options import TickOptions
from hhsim.kernels.tick.step import IN_THE_AIR, snap_step
from hhsim.kernels.world.body import Support
from hhsim.kernels.world.columns import States, hand_column
from hhsim.kernels.world.edges import Edges

Stage = namedtuple(
    "Stage",
    "BEGIN_TICK PLACE_PAIRS MEASURE_EDGES SET_TARGETS RECORD_EDGES KEEP_LOWEST WRITE_COLUMNS REWRITE_COLUMNS "
    "CLIP_TARGETS TAKE_STEPS MOVE_BODIES MEASURE_TABLE DAMP_HANDS ACCEPT_STEP RESTORE_POSES END_TICK MARK_SNAP",
)
STAGE = Stage(*map(as_int64, range(len(Stage._fields))))
"""What `ask_bodies` is asked to do."""


@by_reference
class World(NamedTuple):
    """Method that solves hands and bodies together; tuples are padded to their capacity with their last entry."""

    options: TickOptions
    supports: tuple[Support, ...]  # of each body, its parts that can stand on a table
    states: States  # of each pair; a tick is given the first one
    world: NDArray[np.void]  # one record of `kernels.world.state.world_dtype`
    edge_pairs: NDArray[np.void]  # of each pair
    movers: tuple[HandArrays, ...]  # of each hand; then, of several bodies, each as a palm without fingers
    surfaces: tuple[SurfaceCode, ...]  # of each hand where no body is free, else of each body
    edges: tuple[Edges, ...]  # of each body
    # Machine code by `code_of`, 0 where a scene has none of it, so that a tick is compiled without.
    bodies: int = 0  # what bodies that move add to a tick, `kernels.world.bodies.do_bodies`
    pairs: int = 0  # what further pairs add to a program, `kernels.world.linearisation.write_other_pairs`
    solver: int = 0  # in place of `solve_plain`: `solve_free`, `solve_progressive`, or `hhsim.solver.qp.backend_code`
    parts_tick: int = 0  # what comes first where parts have moved, `kernels.parts.tick.give_way`
    parts: Any = 0  # address of the parts; where nothing is compiled the parts themselves
    recorder: int = 0  # `kernels.world.record.record_bodies`


@jit_inline
def ask_bodies(method: World, asked: int, value: float) -> float:
    """Do what `kernels.world.bodies.do_bodies` does; nothing, and return 0, where no body moves."""
    return number_of_code(method.bodies, (method, as_int64(asked), value)) if method.bodies != 0 else 0.0


@jit_inline
def mover_of(method: World, p: int) -> HandArrays:
    """Return the arrays of what moves in a pair: of a hand, or of a body as a palm without fingers."""
    problem = method.world[0].problem
    other = problem.other[p]
    return method.movers[problem.hand[p] if other < 0 else problem.hands + other]


@jit_inline
def surface_at(method: World, p: int) -> SurfaceCode:
    """Return the surface of the body of a pair."""
    return method.surfaces[method.world[0].problem.surface[p]]


@jit
def measure(method: World) -> bool:
    """Compute the distances of each pair; False where they do not fit into the arrays."""
    fits = True
    for p in range(method.world[0].problem.pairs):
        arrays, its = mover_of(method, p), surface_at(method, p)
        fits = evaluate_pose(arrays, its, method.options, method.states[p]) and fits
    ask_pairs(method.options.pairs, MEASURE_PAIRS, EXACT, 0.0)
    ask_bodies(method, STAGE.MEASURE_EDGES, 0.0)
    method.states[0].progress.pairs_overflow = not fits
    return fits


@jit
def rebuild(method: World) -> bool:
    """Take the poses of hands and bodies as they now stand, as each sees what is near; returns whether pairs fit."""
    ask_bodies(method, STAGE.PLACE_PAIRS, 0.0)
    for p in range(method.world[0].problem.pairs):
        forget_lists(method.states[p])
    return measure(method)


MOST_RAISES = 5
"""Most times in a tick that damping is raised; what is left beyond the bound then is a jump."""
MOST_DAMPING = 30.0
"""Largest s: a hand that is held would hit what moves into it like a wall."""
AIMED = 0.9
"""Share of the bound that a raised damping aims at."""
DAMPING_KEPT, LEAST_DAMPING = 0.5, 0.5
"""Share of a tick's damping that the next one begins with, since to raise it takes programs; less than that is none."""
LEAST_RAISE = 2.0
"""Least factor by which a raise multiplies the hands' stiffness."""


@jit
def _to_world(body: Record, joints: Array, joints_out: Array) -> None:
    """Write joints of a body's frame in the world, shapes (5, 4, 3)."""
    center, place = body.center, body.position
    for f in range(FINGER_COUNT):
        for k in range(PHALANX_COUNT + 1):
            joint = joints[f, k]
            x, y, z = turned(body.rotation, joint[0] - center[0], joint[1] - center[1], joint[2] - center[2])
            joints_out[f, k, 0], joints_out[f, k, 1], joints_out[f, k, 2] = x + place[0], y + place[1], z + place[2]


@jit
def _carried(body: Record, joints: Array) -> float:
    """Return how far a body's motion in this tick takes the farthest of these joints along, world [m]."""
    turn, place, start, farthest = body.vector, body.position, body.start_position, 0.0
    rotation_vector_between(body.start_orientation[:], body.orientation[:], turn[:])
    for f in range(FINGER_COUNT):
        for k in range(PHALANX_COUNT + 1):
            joint = joints[f, k]
            x, y, z = joint[0] - start[0], joint[1] - start[1], joint[2] - start[2]
            vx = place[0] - start[0] + turn[1] * z - turn[2] * y
            vy = place[1] - start[1] + turn[2] * x - turn[0] * z
            vz = place[2] - start[2] + turn[0] * y - turn[1] * x
            farthest = max(farthest, vx * vx + vy * vy + vz * vz)
    return math.sqrt(farthest)


@jit
def take_hands(states: States, world: Record) -> None:
    """Take the user's hands, which are the world's before a tick begins, and how far each has moved [m].

    The joints of the last sample are in the frame of the first body as it stands now, those of the newest in the world.
    """
    for h in range(world.problem.hands):
        sample, haptic = states[h].input, states[h].haptic
        sample.motion = 0.0
        if sample.is_valid:
            _to_world(world.bodies[0], sample.joints, world.joints)
            sample.motion = farthest_joint(world.joints, haptic.joints)
            copy_values(haptic.position[:], world.palm_position[h])
            copy_values(haptic.orientation[:], world.palm_orientation[h])


@jit
def begin_bounds(options: TickOptions, states: States, world: Record) -> None:
    """Begin a tick from where the hands stand in the world, with a share of the last one's damping where they touch.

    Where they lag for lack of work they follow later on: beside bodies that is no reason for a longer way.
    """
    for h in range(world.problem.hands):
        progress = states[h].progress
        _to_world(world.bodies[0], states[h].pose.joints, progress.start)
        progress.bound = snap_step(options, progress) + states[h].input.motion
    world.raises = 0
    if world.damping > 0.0:
        rows, damping = 0, DAMPING_KEPT * world.damping
        for p in range(world.problem.pairs):
            rows += world.problem.last[p] - world.problem.first[p] if world.problem.other[p] < 0 else 0
        damp(states, world, damping if rows > 0 and damping > LEAST_DAMPING else 0.0)


@jit
def damp(states: States, world: Record, damping: float) -> None:
    """Set the damping s of all hands: their stiffness becomes (1 + s) G."""
    problem = world.problem
    world.damping = damping
    for j in range(DOF):
        problem.inverse_root[j] = 1.0 / math.sqrt((1.0 + damping) * states[0].stiffness[j])
        for p in range(problem.pairs):
            states[p].problem.inverse_root[j] = problem.inverse_root[j]


@jit
def damped_target(world: Record, h: int, first: int, stop: int) -> None:
    """Bring the target of a hand's variables `first` to `stop` from the user's to that of the damped objective."""
    problem, damping = world.problem, world.damping
    if damping == 0.0:
        return
    target = problem.hand_target
    for j in range(first, stop):
        moved = problem.total[hand_column(problem, h, j)]
        target[DOF * h + j] = (target[DOF * h + j] - damping * moved) / (1.0 + damping)


@jit_noinline
def beyond_bound(states: States, world: Record) -> float:
    """Compute the largest ratio of a hand's motion in the tick to its bound; a hand with a ratio above 1 snaps.

    The bound includes the motion of the bodies at the hand. A hand without contacts has none, unless it snapped in the
    last tick.
    """
    problem, worst = world.problem, 0.0
    for h in range(problem.hands):
        each, carried, near = states[h], 0.0, as_bool(False)
        for p in range(problem.pairs):
            if problem.hand[p] != h or problem.other[p] >= 0:
                continue
            near = near or problem.last[p] > problem.first[p] or each.hand_contact.rows > 0
            body = problem.body[p]
            if problem.last[p] > problem.first[p] and world.bodies[body].is_free == 1:
                carried = max(carried, _carried(world.bodies[body], each.progress.start))
        bound = each.progress.bound + carried
        if not near:
            if each.progress.snapped == 0:
                continue
            bound += IN_THE_AIR * each.progress.behind
        _to_world(world.bodies[0], each.pose.joints, world.joints)
        ratio = farthest_joint(world.joints, each.progress.start) / bound
        if ratio > 1.0:
            each.progress.snaps = True
        worst = max(worst, ratio)
    return worst


@jit
def mark_snap(state: Record, world: Record) -> None:
    """Mark a hand as snapping; its lag is the distance that it would still have to go without damping [m]."""
    progress = state.progress
    progress.snaps = True
    _to_world(world.bodies[0], state.pose.joints, world.joints)
    left = world.damping * farthest_joint(world.joints, progress.start)
    progress.lag = max(progress.lag, min(left, farthest_joint(state.pose.joints, state.haptic.joints)))
