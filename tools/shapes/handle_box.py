"""A box with a handle on either side, by formula: cells of a grid that are filled or empty."""

import itertools

import numpy as np

from hhsim.mesh.mesh import Mesh
from tools.shapes.surface_parts import finished_mesh


def handle_box(
    length: float = 0.12, width: float = 0.11, height: float = 0.12, bar: float = 0.012, gap: float = 0.03
) -> Mesh:
    """Box with a level bar along y at half its height before each of its sides, between two posts.

    Args:
        length, width, height: Of the box along x, y and z [m].
        bar: Edge of the square section of bars and posts [m].
        gap: Way between the box and a bar [m].
    """
    half, side, top = length / 2.0, width / 2.0, height / 2.0
    x = [-half - gap - bar, -half - gap, -half, 0.0, half, half + gap, half + gap + bar]
    y = [-side, bar - side, *np.linspace(bar - side, side - bar, 5)[1:], side]
    z = [-top, -bar / 2.0, bar / 2.0, top]
    filled = np.zeros((len(x) + 1, len(y) + 1, len(z) + 1), bool)  # with an empty rim
    filled[3:5, 1:-1, 1:-1] = True
    filled[[1, -2], 1:-1, 2] = True
    filled[[2, -3], 1, 2] = filled[[2, -3], -2, 2] = True
    number = np.arange(len(x) * len(y) * len(z)).reshape(len(x), len(y), len(z))
    faces = []
    for axis, (i, j, k) in itertools.product(range(3), np.argwhere(filled).tolist()):
        for step in (0, 1):
            beyond = [i, j, k]
            beyond[axis] += 2 * step - 1
            if filled[tuple(beyond)]:
                continue
            corners = [[i - 1, i], [j - 1, j], [k - 1, k]]
            corners[axis] = [corners[axis][step]]
            a, b, c, d = number[np.ix_(*corners)].ravel().tolist()
            quad = [[a, c, d], [a, d, b]] if (step == 1) != (axis == 1) else [[a, d, c], [a, b, d]]
            faces += quad
    vertices = np.stack(np.meshgrid(x, y, z, indexing="ij"), axis=-1).reshape(-1, 3)
    source = f"handle_box(length={length}, width={width}, height={height}, bar={bar}, gap={gap})"
    return finished_mesh(vertices, np.array(faces), "handle-box", source)
