"""Improvement of a cover: spheres move to where their micro-triangles cost less; those hardly missed are found."""

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
    """Sort micro-triangles by sphere: those of sphere j are order_out[first_out[j]:first_out[j + 1]].

    Args:
        owner: Sphere of each micro-triangle, shape (M,).
        first_out: Shape (spheres + 1,).
        order_out: Shape (M,).
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
    """Move every sphere that has micro-triangles, by at most `trials` steps; in place.

    Args:
        bvh: Over the mesh.
        micro: The micro-triangles.
        first, order: Which are whose, as `group_by_owner` gives.
        trials: Steps tried for each sphere.
        center: Sphere centres [m], shape (spheres, 3).
        depth: Their depths [m], shape (spheres,).
        step: Step lengths [m], shape (spheres,); not positive for a sphere that is new.

    Returns:
        Number of steps that were good.
    """
    stack = np.empty(STACK, np.int64)
    stack_distance2 = np.empty(STACK)
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
    """What the cover costs without each sphere [m]: the largest cost of its micro-triangles under their next best.

    Args:
        owner: Sphere of each micro-triangle, shape (M,).
        second_cost: Cost of each under its next best sphere [m], shape (M,).
        cost_out: Shape (spheres,); −inf for a sphere without micro-triangles.
    """
    cost_out[:] = -np.inf
    for i in range(owner.shape[0]):
        cost_out[owner[i]] = max(cost_out[owner[i]], second_cost[i])


@jit_allocating
def spare_spheres(
    candidates: Indices, first: Indices, order: Indices, second_owner: Indices, most: int, spared_out: Flags
) -> int:
    """Choose spheres to take away, such that no micro-triangle loses both its best and its second.

    Args:
        candidates: Spheres, those to be taken first in front, shape (n,).
        first, order: Which micro-triangles are whose, as `group_by_owner` gives.
        second_owner: Next best sphere of each micro-triangle, shape (M,).
        most: How many spheres to choose at most.
        spared_out: Whether each sphere was chosen, shape (spheres,).

    Returns:
        How many were chosen.
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
