"""Improvement of a cover: balls move to where their micro-triangles cost less; those hardly missed are found."""

import numpy as np
from numpy.typing import NDArray

from .ball_descent import WORK, descend_ball
from .jit import jit
from .median_tree import STACK
from .mesh_bvh import MeshBvh
from .micro_triangle import MicroTriangles

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@jit
def group_by_owner(owner: Indices, first_out: Indices, order_out: Indices) -> None:
    """Sort micro-triangles by ball: those of ball j are order_out[first_out[j]:first_out[j + 1]].

    Args:
        owner: ball of each micro-triangle, shape (M,).
        first_out: shape (balls + 1,).
        order_out: shape (M,).
    """
    first_out[:] = 0
    for i in range(owner.shape[0]):
        first_out[owner[i] + 1] += 1
    for j in range(1, first_out.shape[0]):
        first_out[j] += first_out[j - 1]
    for i in range(owner.shape[0] - 1, -1, -1):
        # Counts down from the end of each group, and leaves the ends where the starts belong.
        first_out[owner[i] + 1] -= 1
        order_out[first_out[owner[i] + 1]] = i
    for j in range(first_out.shape[0] - 1):
        first_out[j] = first_out[j + 1]
    first_out[first_out.shape[0] - 1] = owner.shape[0]


@jit
def move_balls(
    bvh: MeshBvh,
    micro: MicroTriangles,
    first: Indices,
    order: Indices,
    trials: int,
    center: Array,
    depth: Array,
    step: Array,
) -> int:
    """Move every ball that has micro-triangles, by at most `trials` steps; in place.

    Args:
        bvh: over the mesh.
        micro: the micro-triangles.
        first, order: which are whose, as `group_by_owner` gives.
        trials: steps tried for each ball.
        center: ball centres [m], shape (balls, 3).
        depth: their depths [m], shape (balls,).
        step: step lengths [m], shape (balls,); not positive for a ball that is new.

    Returns:
        Number of steps that were good.
    """
    stack = np.empty(STACK, np.int64)
    stack_distance2 = np.empty(STACK)
    work = np.empty((WORK, 3))
    total = 0
    for j in range(depth.shape[0]):
        begin, end = first[j], first[j + 1]
        if begin < end:
            _, depth[j], step[j], good = descend_ball(
                bvh, micro, order, begin, end, trials, step[j], center[j], work, stack, stack_distance2
            )
            total += good
    return total


@jit
def spare_balls(
    owner: Indices, second_owner: Indices, second_cost: Array, limit: float, most: int, spare_out: Indices, cost: Array
) -> int:
    """Choose balls that are hardly missed: without one, its micro-triangles cost at most `limit` under their next best.

    Args:
        owner, second_owner, second_cost: as `assign` gives, shape (M,).
        limit: [m].
        most: how many balls to choose at most.
        spare_out: the chosen balls, shape (most,). No micro-triangle loses both its best and its second.
        cost: workspace, shape (balls,): what removing each ball costs [m].

    Returns:
        How many were chosen.
    """
    balls = cost.shape[0]
    needed = np.zeros(balls, np.bool_)
    cost[:] = -np.inf
    for i in range(owner.shape[0]):
        cost[owner[i]] = max(cost[owner[i]], second_cost[i])
    first = np.empty(balls + 1, np.int64)
    order = np.empty(owner.shape[0], np.int64)
    group_by_owner(owner, first, order)
    removed = np.zeros(balls, np.bool_)
    count = 0
    for j in np.argsort(cost, kind="mergesort"):
        if count >= most or not cost[j] < limit:
            break
        if needed[j]:
            continue
        alone = False
        for k in range(first[j], first[j + 1]):
            if removed[second_owner[order[k]]]:
                alone = True
                break
        if alone:
            continue
        for k in range(first[j], first[j + 1]):
            needed[second_owner[order[k]]] = True
        removed[j] = True
        spare_out[count] = j
        count += 1
    return count
