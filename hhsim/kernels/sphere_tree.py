"""Sphere trees, and queries for the leaves within a margin and for the nearest leaf.

Every inner node encloses the balls of its descendant leaves, so the distance of a query body to a node is a lower bound
of its distance to every leaf below.
"""

import math
from typing import NamedTuple

import numpy as np

from hhsim.kernels.arithmetic import fused, product
from hhsim.kernels.by_reference import by_reference
from hhsim.kernels.jit import Array, Indices, as_int64, jit, jit_inline
from hhsim.kernels.round_cone import RoundCone, round_cone_parameter

MOST_WAITING = 1024
"""A depth-first walk holds at most (branching - 1) · depth + 1 nodes; trees have at most 5 levels."""
MOST_AT_ONCE = 64
"""Largest number of children whose distances the vector unit computes at once."""
STACK_SIZE = MOST_WAITING + MOST_AT_ONCE
"""Size of a walk's stack: the nodes that wait, then those distances."""


@by_reference
class TreeArrays(NamedTuple):
    """A sphere tree of N nodes, breadth first: node 0 is the root, children are contiguous, the leaves come last."""

    x: Array  # centres [m], (N,)
    y: Array
    z: Array
    radius: Array  # [m], (N,)
    first_child: Indices  # (N,), -1 for a leaf
    child_count: Indices  # (N,), 0 for a leaf
    leaf_start: int  # leaf i of the tree is node leaf_start + i


@jit_inline
def node_distance(tree: TreeArrays, cone: RoundCone, node: int) -> float:
    """Compute the signed distance [m] of a round cone to a node's sphere."""
    ax, ay, az, ux, uy, uz, length, tan_slope, inverse_length, radius_a, radius_drop = cone
    dx, dy, dz = tree.x[node] - ax, tree.y[node] - ay, tree.z[node] - az
    s = round_cone_parameter(dx, dy, dz, ux, uy, uz, tan_slope, inverse_length)
    along = -s * length
    qx, qy, qz = fused(along, ux, dx), fused(along, uy, dy), fused(along, uz, dz)
    return math.sqrt(product(qx, qy, qz, qx, qy, qz)) + fused(s, radius_drop, -radius_a) - tree.radius[node]


@jit
def _child_distances(tree: TreeArrays, cone: RoundCone, first: int, last: int, distance_out: Array) -> None:
    # Signed indices would be checked for negative values, which keeps the loop off the vector unit.
    for i in range(np.uint64(first), np.uint64(last)):
        distance_out[i - np.uint64(first)] = node_distance(tree, cone, i)


@jit
def gather_round_cone(
    tree: TreeArrays, cone: RoundCone, margin: float, stack: Indices, index_out: Indices
) -> tuple[int, float, int]:
    """Gather the nodes of the leaves whose signed distance to a round cone is at most `margin` [m].

    The stack has STACK_SIZE places. Returns (count, clearance, node tests): `index_out[:count]` are the leaves; every
    other leaf is at least `clearance` [m] away (more than the margin; infinite if there is no other). The count is -1
    where `index_out` is too small.
    """
    clearance = np.inf
    count = 0
    tests = 1
    distance = node_distance(tree, cone, as_int64(0))
    if distance > margin:
        return 0, distance, tests
    away = stack[stack.shape[0] - MOST_AT_ONCE :].view(np.float64)
    stack[0] = 0
    top = 1
    while top > 0:
        top -= 1
        node = stack[top]
        first = tree.first_child[node]
        if first < 0:
            if count >= index_out.shape[0]:
                return -1, 0.0, tests
            index_out[count] = node
            count += 1
            continue
        last = first + tree.child_count[node]
        tests += last - first
        at_once = last - first <= MOST_AT_ONCE
        if at_once:
            _child_distances(tree, cone, first, last, away)
        # Leaves are listed at once where there is room for all. Without a branch, which could not be predicted.
        leaves = first >= tree.leaf_start and count + last - first <= index_out.shape[0]
        for i in range(last - first):
            child = first + i if leaves else last - 1 - i
            distance = away[child - first] if at_once else node_distance(tree, cone, child)
            near = distance <= margin
            clearance = min(clearance, np.inf if near else distance)
            if leaves:
                index_out[count] = child
                count += 1 if near else 0
            else:
                stack[top] = child
                top += 1 if near else 0
    return count, clearance, tests


@jit
def nearest_leaf_round_cone(tree: TreeArrays, cone: RoundCone, limit: float, stack: Indices) -> tuple[float, int]:
    """Compute the least signed distance [m] of a round cone to the leaves, and its node; (limit, -1) if not below."""
    best = limit
    best_leaf = -1
    stack[0] = 0
    top = 1
    while top > 0:
        top -= 1
        node = stack[top]
        distance = node_distance(tree, cone, node)
        first = tree.first_child[node]
        if first < 0:
            # Among equally near leaves the last one, in whatever order they are visited.
            if distance < best or (distance == best and 0 <= best_leaf < node):
                best = distance
                best_leaf = node
            continue
        if distance > best:
            continue
        nearest = np.inf
        for child in range(first, first + tree.child_count[node]):
            distance = node_distance(tree, cone, child)
            if not distance <= best:
                continue
            stack[top] = child
            if nearest < distance:
                # The nearest stays on top and is visited first: the others may then be too far.
                stack[top], stack[top - 1] = stack[top - 1], stack[top]
            else:
                nearest = distance
            top += 1
    return best, best_leaf
