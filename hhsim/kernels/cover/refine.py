"""Improvement of a cover: descent of its spheres, and a choice of spheres that can be removed."""

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.cover.micro_triangle import MicroTriangles
from hhsim.kernels.cover.sphere_descent import WORK, descend_sphere
from hhsim.kernels.jit import Array, Indices, jit, jit_allocating
from hhsim.kernels.kd_tree import STACK
from hhsim.kernels.mesh.bvh import MeshBvh

Flags = NDArray[np.bool_]


@jit
def group_by_owner(owner: Indices, first_out: Indices, order_out: Indices) -> None:
    """Sort micro-triangles by owner: those of sphere j are order_out[first_out[j]:first_out[j + 1]]."""
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


@jit_allocating
def move_spheres(
    bvh: MeshBvh,
    micro: MicroTriangles,
    first: Indices,
    order: Indices,
    trials: int,
    center: Array,
    depth: Array,
    step: Array,
) -> int:
    """Move every sphere that has micro-triangles, grouped by owner, by at most `trials` steps; in place.

    Centres, depths and step lengths are in metres; a new sphere's step is not positive. Returns the number of good
    steps.
    """
    stack, stack_distance2 = np.empty(STACK, np.int64), np.empty(STACK)
    work = np.empty((WORK, 8))
    total = 0
    for j in range(depth.shape[0]):
        begin, end = first[j], first[j + 1]
        if begin < end:
            _, depth[j], step[j], good = descend_sphere(
                bvh, micro, order[begin:end], trials, step[j], center[j], work, stack, stack_distance2
            )
            total += good
    return total


@jit
def removal_cost(owner: Indices, second_cost: Array, cost_out: Array) -> None:
    """Compute the cost [m] of the cover without each sphere: the largest of its micro-triangles' second costs.

    −inf for a sphere without micro-triangles.
    """
    cost_out[:] = -np.inf
    for i in range(owner.shape[0]):
        cost_out[owner[i]] = max(cost_out[owner[i]], second_cost[i])


@jit_allocating
def spare_spheres(
    candidates: Indices, first: Indices, order: Indices, second_owner: Indices, most: int, spared_out: Flags
) -> int:
    """Mark at most `most` spheres to remove, such that no micro-triangle loses both its best and its second.

    Candidates are in order of preference; first and order are as of `group_by_owner`. Returns the number of spheres.
    """
    needed = np.zeros(spared_out.shape[0], np.bool_)
    spared_out[:] = False
    count = 0
    for j in candidates:
        if count >= most:
            break
        possible = not needed[j]
        for k in range(first[j], first[j + 1]):
            possible = possible and not spared_out[second_owner[order[k]]]
        if possible:
            for k in range(first[j], first[j + 1]):
                needed[second_owner[order[k]]] = True
            spared_out[j] = True
            count += 1
    return count
