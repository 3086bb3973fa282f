"""Pairs of the world: what moves past which body, where both are, and how near.

A hand is kept as each body sees it, and so is each body as another one sees it: as a palm without fingers, of spheres
or points (`kernels.free.columns` says what a pair is).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.by_reference import by_reference
from hhsim.kernels.contact.surface_code import SurfaceCode
from hhsim.kernels.copy import copy_values
from hhsim.kernels.free.body import Support, see_hand, show_hand
from hhsim.kernels.free.columns import States, body_count, hand_count, other_in, pair_count
from hhsim.kernels.free.edges import Edges, measure_edges, record_edges
from hhsim.kernels.free.support import table_distances
from hhsim.kernels.hand.kinematics import PALM_BODY, HandArrays
from hhsim.kernels.hand.pose import update_kinematics
from hhsim.kernels.jit import Record, as_int64, jit, jit_inline
from hhsim.kernels.rotation import turned_back
from hhsim.kernels.tick.evaluation import evaluate_pose, rebuild_candidates, usual_reach
from hhsim.kernels.tick.options import TickOptions


@by_reference
class Free(NamedTuple):
    """Method that solves hands and bodies together; tuples are padded to their capacity with their last entry."""

    options: TickOptions
    supports: tuple[Support, ...]  # of each body, its parts that can stand on a table
    states: States  # of each pair; a tick is given the first one
    world: NDArray[np.void]  # one record of `kernels.free.state.world_dtype`
    edge_pairs: NDArray[np.void]  # of each pair
    movers: tuple[HandArrays, ...]  # of each hand; then, of several bodies, each as a palm without fingers
    surfaces: tuple[SurfaceCode, ...]  # of each body; of each hand where parts of a body have lists of their own
    edges: tuple[Edges, ...]  # of each body


@jit_inline
def mover_of(method: Free, p: int) -> HandArrays:
    """Return the arrays of what moves in a pair: of a hand, or of a body as a palm without fingers."""
    problem = method.world[0].problem
    other = problem.other[p]
    return method.movers[problem.hand[p] if other < 0 else hand_count(problem) + other]


@jit_inline
def surface_at(method: Free, p: int) -> SurfaceCode:
    """Return the surface of the body of a pair."""
    return method.surfaces[method.world[0].problem.surface[p]]


@jit
def _measure_edges(method: Free, p: int) -> None:
    """Measure a pair's edges, if two bodies meet in it, after its other distances."""
    world = method.world[0]
    each, options = method.states[p], method.options
    problem = world.problem
    other, number = other_in(problem, p), problem.body[p]
    # Each two bodies meet in two pairs: their edges once.
    if 0 <= other < number and each.modelled[PALM_BODY] == 1:
        needed = max(options.listed, max(each.trust.reach, usual_reach(options, each)))
        far = options.margin + options.skin
        measure_edges(
            method.movers[hand_count(problem) + other],
            method.edges[other],
            method.edges[number],
            world.bodies[number].center[:],
            each.pose,
            needed,
            far,
            each.candidates,
            method.edge_pairs[p],
            problem.scratch[:],
        )


@jit
def record_edges_of(method: Free, p: int) -> None:
    """Add a pair's edges within reach to its contact records, if two bodies meet in it."""
    each, problem = method.states[p], method.world[0].problem
    other, number = other_in(problem, p), problem.body[p]
    if 0 <= other < number and each.modelled[PALM_BODY] == 1:
        record_edges(
            method.edges[number], min(each.trust.reach, each.trust.radius), method.edge_pairs[p], each.contacts
        )


@jit
def place_pairs(method: Free) -> None:
    """Place what moves in each pair but the first ones where it is: there it was moved along, step by step."""
    world = method.world[0]
    problem, bodies, scratch = world.problem, world.bodies, world.problem.scratch
    for p in range(hand_count(problem), pair_count(problem)):
        each, other = method.states[p], problem.other[p]
        pose = each.pose
        if other >= 0:
            copy_values(bodies[other].position[:], scratch[0:3])
            copy_values(bodies[other].orientation[:], pose.orientation[:])
        else:
            first = method.states[problem.hand[p]].pose
            show_hand(bodies[0], first.position[:], first.orientation[:], scratch[0:3], pose.orientation[:])
            copy_values(first.flexion[:], pose.flexion[:])
            copy_values(first.abduction[:], pose.abduction[:])
        turn_here = world.scratch_turn
        copy_values(pose.orientation[:], turn_here[:])
        see_hand(bodies[problem.body[p]], scratch[0:3], turn_here[:], pose.position[:], pose.orientation[:])
        update_kinematics(mover_of(method, p), pose)


@jit
def find_turns(problem: Record, bodies: Record) -> None:
    """Find how the frame of the first body is turned to that of each pair's."""
    base = bodies[0].rotation
    for p in range(hand_count(problem), pair_count(problem)):
        own = bodies[problem.body[p]].rotation
        for j in range(3):
            x, y, z = turned_back(own, base[0, j], base[1, j], base[2, j])
            problem.turn[p, 0, j], problem.turn[p, 1, j], problem.turn[p, 2, j] = x, y, z


@jit
def measure(method: Free) -> bool:
    """Compute the distances of each pair; False where they do not fit into the arrays."""
    fits = True
    for p in range(pair_count(method.world[0].problem)):
        arrays, its = mover_of(method, p), surface_at(method, p)
        fits = evaluate_pose(arrays, its, method.options, method.states[p]) and fits
        _measure_edges(method, p)
    method.states[0].progress.pairs_overflow = not fits
    return fits


@jit
def measure_table(method: Free) -> tuple[float, int, int]:
    """Compute the distance [m] of bodies and table; also returns the lowest body, and its lowest point."""
    world = method.world[0]
    least, number, lowest = np.inf, as_int64(0), as_int64(-1)
    for k in range(body_count(world.problem)):
        body = world.bodies[k]
        body.measured_distance = np.inf
        if body.has_table == 1:
            distance, point = table_distances(body, method.supports[k])
            body.measured_distance = distance
            if distance < least:
                least, number, lowest = distance, as_int64(k), point
    return least, number, lowest


@jit
def rebuild(method: Free, states: States) -> bool:
    """Take the poses of hands and bodies as they now stand, as each sees what is near; returns whether pairs fit."""
    world = method.world[0]
    fits = True
    world.apart = 0.0
    place_pairs(method)
    measure_table(method)
    for k in range(body_count(world.problem)):
        world.bodies[k].table_distance = world.bodies[k].measured_distance
    for p in range(pair_count(world.problem)):
        given = mover_of(method, p), surface_at(method, p), method.options
        fits = rebuild_candidates(*given, states[p : p + 1]) and fits
        if p >= hand_count(world.problem):
            # A hand's own pairs are looked at in its first pair alone.
            states[p].self_contact.floor = states[p].self_contact.least = np.inf
        _measure_edges(method, p)
    return fits
