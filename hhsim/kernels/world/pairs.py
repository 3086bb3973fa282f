"""Pairs of the world: what moves past which body, where both are, and how near.

A hand is kept as each body sees it, and so is each body as another one sees it: as a palm without fingers, of spheres
or points (`kernels.world.columns` says what a pair is).
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.by_reference import by_reference
from hhsim.kernels.contact.surface_code import SurfaceCode
from hhsim.kernels.hand.kinematics import HandArrays
from hhsim.kernels.jit import as_int64, jit, jit_inline
from hhsim.kernels.machine_code import number_of_code
from hhsim.kernels.tick.evaluation import evaluate_pose, rebuild_candidates
from hhsim.kernels.tick.options import TickOptions
from hhsim.kernels.world.body import Support
from hhsim.kernels.world.columns import States, hand_count, pair_count
from hhsim.kernels.world.edges import Edges

TAKE, BEGIN, PLACE, EDGES, AIM, CONTACTS, LOWEST, COLUMNS, REWRITE, CLIP, SHIFTS, STEPS = range(12)
BEAR, MOVE, TABLE, DAMP, KEEP, HOLD, BACK, SEE, SNAP, END, TURN = range(12, 23)
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
    surfaces: tuple[SurfaceCode, ...]  # of each body; of each hand where parts of a body have lists of their own
    edges: tuple[Edges, ...]  # of each body
    # Machine code by `code_of`, 0 where a scene has none of it, so that a tick is compiled without.
    bodies: int = 0  # what bodies that move add to a tick, `kernels.world.bodies.do_bodies`
    hands: int = 0  # what a second hand adds, `kernels.world.meeting.do_hands`
    solving: int = 0  # a program other than `solve_plain`, of `kernels.world.bodies` or `kernels.tick.progressive`
    giving: int = 0  # what comes first where parts have moved, `kernels.parts.tick.give_way`
    given: Any = 0  # address of the parts; where nothing is compiled the parts themselves
    recording: int = 0  # `kernels.world.record.record_bodies`


@jit_inline
def ask_bodies(method: World, asked: int, value: float) -> float:
    """Do what `kernels.world.bodies.do_bodies` does; nothing, and return 0, where no body moves."""
    return number_of_code(method.bodies, (method, as_int64(asked), value)) if method.bodies != 0 else 0.0


@jit_inline
def ask_hands(method: World, asked: int, value: float) -> float:
    """Do what `kernels.world.meeting.do_hands` does; nothing, and return infinity, with one hand."""
    return number_of_code(method.hands, (method, as_int64(asked), value)) if method.hands != 0 else np.inf


@jit_inline
def mover_of(method: World, p: int) -> HandArrays:
    """Return the arrays of what moves in a pair: of a hand, or of a body as a palm without fingers."""
    problem = method.world[0].problem
    other = problem.other[p]
    return method.movers[problem.hand[p] if other < 0 else hand_count(problem) + other]


@jit_inline
def surface_at(method: World, p: int) -> SurfaceCode:
    """Return the surface of the body of a pair."""
    return method.surfaces[method.world[0].problem.surface[p]]


@jit
def measure(method: World) -> bool:
    """Compute the distances of each pair; False where they do not fit into the arrays."""
    fits = True
    for p in range(pair_count(method.world[0].problem)):
        arrays, its = mover_of(method, p), surface_at(method, p)
        fits = evaluate_pose(arrays, its, method.options, method.states[p]) and fits
    ask_bodies(method, EDGES, 0.0)
    method.states[0].progress.pairs_overflow = not fits
    return fits


@jit
def rebuild(method: World, states: States) -> bool:
    """Take the poses of hands and bodies as they now stand, as each sees what is near; returns whether pairs fit."""
    world = method.world[0]
    fits = True
    world.apart = 0.0
    ask_bodies(method, PLACE, 0.0)
    for p in range(pair_count(world.problem)):
        given = mover_of(method, p), surface_at(method, p), method.options
        fits = rebuild_candidates(*given, states[p : p + 1]) and fits
        if p >= hand_count(world.problem):
            # A hand's own pairs are looked at in its first pair alone.
            states[p].self_contact.floor = states[p].self_contact.least = np.inf
    ask_bodies(method, EDGES, 0.0)
    return fits
