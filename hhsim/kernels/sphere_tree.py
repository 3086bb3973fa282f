"""Sphere trees and the queries on them: which leaves lie within a margin, and how deep is the deepest.

Every inner node encloses the balls of its descendant leaves, so the distance of a query body to a node is a lower bound
of its distance to every leaf below: a node farther than the margin is left out with all that is under it.
"""

import math
from typing import NamedTuple

import numpy as np

from hhsim.kernels.jit import Array, Indices, as_int64, jit, jit_inline, jit_vector
from hhsim.kernels.round_cone_distance import RoundCone, round_cone_parameter

MOST_WAITING = 1024
"""A depth-first walk holds at most (branching - 1) · depth + 1 nodes; trees have at most 5 levels."""
MOST_AT_ONCE = 64
"""Children whose distances the vector unit computes at once, where a node has no more."""
STACK_SIZE = MOST_WAITING + MOST_AT_ONCE
"""Behind the nodes that wait, a walk's stack has room for these distances."""


class TreeArrays(NamedTuple):
    """A sphere tree, breadth first: node 0 is the root, the children of a node are contiguous, the leaves come last.

    | field | meaning | shape |
    |---|---|---|
    | x, y, z | sphere centres [m] | (N,) |
    | radius | [m] | (N,) |
    | first_child | index of the first child, -1 for a leaf | (N,) |
    | child_count | 0 for a leaf | (N,) |
    | leaf_start | index of the first leaf; leaf i of the tree is node leaf_start + i | int |
    """

    x: Array
    y: Array
    z: Array
    radius: Array
    first_child: Indices
    child_count: Indices
    leaf_start: int


@jit_inline
def node_distance(tree: TreeArrays, cone: RoundCone, node: int) -> float:
    """Signed distance [m] of a round cone to a node's sphere."""
    ax, ay, az, ux, uy, uz, length, tan_slope, inverse_length, radius_a, radius_drop = cone
    dx, dy, dz = tree.x[node] - ax, tree.y[node] - ay, tree.z[node] - az
    s = round_cone_parameter(dx, dy, dz, ux, uy, uz, tan_slope, inverse_length)
    qx, qy, qz = dx - s * length * ux, dy - s * length * uy, dz - s * length * uz
    return math.sqrt(qx * qx + qy * qy + qz * qz) - radius_a + s * radius_drop - tree.radius[node]


@jit_vector
def _child_distances(tree: TreeArrays, cone: RoundCone, first: int, last: int, distance_out: Array) -> None:
    # An index that might be negative is looked at first, and the vector unit left out.
    for i in range(np.uint64(first), np.uint64(last)):
        distance_out[i - np.uint64(first)] = node_distance(tree, cone, i)


@jit
def gather_round_cone(
    tree: TreeArrays, cone: RoundCone, margin: float, stack: Indices, index_out: Indices
) -> tuple[int, float, int]:
    """Leaves whose signed distance to a round cone is at most `margin` [m].

    Args:
        tree: The tree.
        cone: The body.
        margin: [m].
        stack: Workspace, shape (>= STACK_SIZE,).
        index_out: The leaves; as many as there is room for.

    Returns:
        (count, clearance, node tests): `index_out[:count]` holds the node indices of the leaves; every leaf left out is
        at least `clearance` [m] away (more than the margin; infinite when none was left out). count is -1 where
        `index_out` is too small.
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
        # Leaves are listed at once where there is room for all. Which child is near is no branch: nobody can guess it.
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
    """Least signed distance [m] of a round cone to the leaves, and that leaf's node index.

    Only distances below `limit` are looked for; (limit, -1) where there is none.
    """
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
            # Of leaves as near the last one, in whatever order they are met.
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
                # The nearest stays on top and is looked at first: the others may then be too far.
                stack[top], stack[top - 1] = stack[top - 1], stack[top]
            else:
                nearest = distance
            top += 1
    return best, best_leaf
