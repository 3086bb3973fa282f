"""A binary tree over points, by halving at the median of the widest axis.

It orders triangles for the mesh BVH and micro-triangles for the cover. Nodes are stored in preorder: the left child of
node i is i + 1, its right child `right[i]` (−1 for a leaf), its points `order[start[i]:end[i]]`.
"""

from typing import NamedTuple

import numpy as np

from hhsim.kernels.jit import Array, Indices, jit, jit_allocating

STACK = 128
"""Size of the stack of any walk down a median tree: halving int64 counts gives at most 64 levels."""


class MedianTree(NamedTuple):
    """Order of the points and the nodes over it; see the module."""

    order: Indices
    start: Indices
    end: Indices
    right: Indices


@jit
def select(keys: Array, order: Indices, low: int, high: int, middle: int) -> None:
    """Permute order[low:high] so that the keys before `middle` are not above those from `middle` on (Hoare)."""
    high -= 1
    while low < high:
        pivot = keys[order[(low + high) // 2]]
        i, j = low, high
        while i <= j:
            while keys[order[i]] < pivot:
                i += 1
            while keys[order[j]] > pivot:
                j -= 1
            if i <= j:
                order[i], order[j] = order[j], order[i]
                i += 1
                j -= 1
        if middle <= j:
            high = j
        elif middle >= i:
            low = i
        else:
            return


@jit
def split_widest(keys: Array, order: Indices, start: int, end: int, middle: int) -> None:
    """Split order[start:end] at `middle` along the widest of the axes, the rows of `keys`, shape (3, n)."""
    axis, widest = 0, -1.0
    for k in range(3):
        low = high = keys[k, order[start]]
        for i in range(start + 1, end):
            value = keys[k, order[i]]
            low, high = min(low, value), max(high, value)
        if high - low > widest:
            axis, widest = k, high - low
    select(keys[axis], order, start, end, middle)


@jit_allocating
def _split(
    keys: Array, leaf_size: int, order: Indices, start_out: Indices, end_out: Indices, right_out: Indices
) -> int:
    """Fill the nodes; return their number."""
    stack = np.empty((STACK, 3), np.int64)
    stack[0, 0], stack[0, 1], stack[0, 2] = 0, keys.shape[1], -1
    top = 1
    node = 0
    while top > 0:
        top -= 1
        start, end, waiting = stack[top, 0], stack[top, 1], stack[top, 2]
        if waiting >= 0:
            right_out[waiting] = node
        start_out[node], end_out[node], right_out[node] = start, end, -1
        if end - start > leaf_size:
            middle = (start + end) // 2
            split_widest(keys, order, start, end, middle)
            stack[top, 0], stack[top, 1], stack[top, 2] = middle, end, node
            stack[top + 1, 0], stack[top + 1, 1], stack[top + 1, 2] = start, middle, -1
            top += 2
        node += 1
    return node


def build_median_tree(points: Array, leaf_size: int) -> MedianTree:
    """Build the tree over points, shape (n, 3), n ≥ 1, with at most `leaf_size` points a leaf."""
    count = len(points)
    order = np.arange(count, dtype=np.int64)
    capacity = 4 * count // leaf_size + 3
    start, end, right = (np.empty(capacity, np.int64) for _ in range(3))
    nodes = _split(np.ascontiguousarray(points.T, np.float64), leaf_size, order, start, end, right)
    return MedianTree(order, start[:nodes].copy(), end[:nodes].copy(), right[:nodes].copy())


def subtrees(right: Indices, depth: int) -> list[int]:
    """Return the nodes at a depth, and the leaves above it: together they hold every point once."""
    nodes = [0]
    for _ in range(depth):
        nodes = [child for node in nodes for child in ([node] if right[node] < 0 else [node + 1, int(right[node])])]
    return nodes
