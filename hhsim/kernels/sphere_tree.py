"""Trees of bounding spheres over the pieces of a surface, and queries for the pieces near a body and for the nearest.

A piece is one of the spheres at the leaves themselves, or a triangle inside of it. Every node encloses the pieces below
it, so the distance of a body to the node is a lower bound of its distance to each of them.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from hhsim.kernels.arithmetic import fused, product
from hhsim.kernels.by_reference import by_reference
from hhsim.kernels.jit import Array, Indices, generic, jit, jit_inline
from hhsim.kernels.memory import prefetch
from hhsim.kernels.round_cone import RoundCone, round_cone_parameter

MOST_WAITING = 1024
"""A depth-first walk holds at most (branching - 1) · depth + 1 nodes; trees have at most 5 levels."""
MOST_AT_ONCE = 64
"""Largest number of children whose distances the vector unit computes at once."""
STACK_SIZE = MOST_WAITING + MOST_AT_ONCE
"""Size of a walk's stack: the nodes that wait, then those distances."""
NUMBER_BYTES = 8
"""Size of a number of the tree."""


@by_reference
class TreeArrays(NamedTuple):
    """A tree of N spheres, breadth first: node 0 is the root, children are contiguous."""

    x: Array  # centres [m], (N,)
    y: Array
    z: Array
    radius: Array  # [m], (N,)
    first_child: Indices  # (N,), -1 - piece for a leaf; where spheres are the pieces, a piece is its node
    child_count: Indices  # (N,), 0 for a leaf


@generic
def tree_of(surface: Any) -> TreeArrays:
    """Return the tree over the pieces of a surface."""


@generic
def piece_distance(surface: Any, piece: int, cone: RoundCone) -> tuple[float, float]:
    """Compute the signed distance [m] of a round cone to a piece, and where on the axis the nearest sphere is [m]."""


@tree_of.of(TreeArrays)
@jit_inline
def _tree_of(tree: TreeArrays) -> TreeArrays:
    return tree


@jit_inline
def node_distance(tree: TreeArrays, cone: RoundCone, node: int) -> float:
    """Compute the signed distance [m] of a round cone to a node's sphere."""
    ax, ay, az, ux, uy, uz, length, tan_slope, inverse_length, radius_a, radius_drop = cone
    dx, dy, dz = tree.x[node] - ax, tree.y[node] - ay, tree.z[node] - az
    s = round_cone_parameter(dx, dy, dz, ux, uy, uz, tan_slope, inverse_length)
    along = -s * length
    qx, qy, qz = fused(along, ux, dx), fused(along, uy, dy), fused(along, uz, dz)
    return math.sqrt(product(qx, qy, qz, qx, qy, qz)) + fused(s, radius_drop, -radius_a) - tree.radius[node]


@piece_distance.of(TreeArrays)
@jit_inline
def _sphere_distance(tree: TreeArrays, node: int, cone: RoundCone) -> tuple[float, float]:
    dx, dy, dz = tree.x[node] - cone.x, tree.y[node] - cone.y, tree.z[node] - cone.z
    s = round_cone_parameter(dx, dy, dz, cone.ux, cone.uy, cone.uz, cone.tan_slope, cone.inverse_length)
    return node_distance(tree, cone, node), s * cone.length


@jit
def _child_distances(tree: TreeArrays, cone: RoundCone, first: int, last: int, distance_out: Array) -> None:
    # Signed indices would be checked for negative values, which keeps the loop off the vector unit.
    for i in range(np.uint64(first), np.uint64(last)):
        distance_out[i - np.uint64(first)] = node_distance(tree, cone, i)


@jit
def gather_pieces(
    tree: TreeArrays, cone: RoundCone, reach: float, look_out: float, stack: Indices, piece_out: Indices
) -> tuple[int, float, int]:
    """Gather the pieces whose leaves are at most `reach` [m] from a round cone.

    Groups up to `look_out` [m], at least `reach`, are visited for a clearance that is not their own. The stack has
    STACK_SIZE places. Returns (count, clearance, node tests): `piece_out[:count]` are the pieces; every other one is at
    least `clearance` [m] away (more than the reach; infinite if there is no other). The count is -1 where `piece_out`
    is too small.
    """
    clearance, count, tests = np.inf, 0, 0
    away = stack[stack.shape[0] - MOST_AT_ONCE :].view(np.float64)
    first, last, top = 0, 1, 0
    while True:
        tests += last - first
        at_once = last - first <= MOST_AT_ONCE
        if at_once:
            _child_distances(tree, cone, first, last, away)
        spare = count + last - first <= piece_out.shape[0]
        # A group farther than the clearance cannot change it. Without branches, which could not be predicted.
        far = max(reach, min(look_out, clearance))
        waiting = top
        for child in range(first, last):
            distance = away[child - first] if at_once else node_distance(tree, cone, child)
            below = tree.first_child[child]
            group = below >= 0 and distance <= far
            leaf = below < 0 and distance <= reach
            clearance = min(clearance, np.inf if group or leaf else distance)
            stack[top] = child
            top += 1 if group else 0
            if leaf and not spare and count >= piece_out.shape[0]:
                return -1, 0.0, tests
            if spare or leaf:
                piece_out[count] = -1 - below
            count += 1 if leaf else 0
        for i in range(waiting, top):
            below, size = tree.first_child[stack[i]], NUMBER_BYTES * tree.child_count[stack[i]]
            prefetch(tree.x, below, size)
            prefetch(tree.y, below, size)
            prefetch(tree.z, below, size)
            prefetch(tree.radius, below, size)
            prefetch(tree.first_child, below, size)
        if top == 0:
            return count, clearance, tests
        top -= 1
        first = tree.first_child[stack[top]]
        last = first + tree.child_count[stack[top]]


@jit
def nearest_piece(surface: Any, cone: RoundCone, limit: float, stack: Indices) -> tuple[float, int, float]:
    """Compute the least signed distance [m] of a round cone to a surface below a limit, its piece, where on the axis.

    Where none is below, (limit, -1, 0.0). The place on the axis is in metres.
    """
    tree = tree_of(surface)
    best, found, parameter = limit, -1, 0.0
    first, last, top = 0, 1, 0
    while True:
        nearest = np.inf
        for child in range(first, last):
            away = node_distance(tree, cone, child)
            if not away <= best:
                continue
            piece = -1 - tree.first_child[child]
            if piece >= 0:
                distance, s = piece_distance(surface, piece, cone)
                # Among equally near pieces the last one, in whatever order they are visited.
                if distance < best or (distance == best and 0 <= found < piece):
                    best, found, parameter = distance, piece, s
                continue
            stack[top] = child
            if nearest < away:
                # The nearest stays on top and is visited first: the others may then be too far.
                stack[top], stack[top - 1] = stack[top - 1], stack[top]
            else:
                nearest = away
            top += 1
        if top == 0:
            return best, found, parameter
        top -= 1
        first = tree.first_child[stack[top]]
        last = first + (tree.child_count[stack[top]] if node_distance(tree, cone, stack[top]) <= best else 0)
