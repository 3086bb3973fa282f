"""Shapes by formula: the five simple objects, and the table of all generators.

Every generator returns a closed mesh [m], wound outward, z up, with the centre of its bounding box at the origin; the
same arguments give the same bytes.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from hhsim.mesh.mesh import Mesh
from tools.shapes.cup import cup
from tools.shapes.handle_box import handle_box
from tools.shapes.rock import rock
from tools.shapes.shamrock import shamrock
from tools.shapes.surface_parts import band, circle, fan, finished_mesh, icosphere

__all__ = [
    "GENERATORS",
    "cube",
    "cup",
    "cylinder",
    "handle_box",
    "hexagonal_prism",
    "rock",
    "shamrock",
    "sphere",
    "triangular_prism",
]


def sphere(diameter: float = 0.076, subdivisions: int = 4) -> Mesh:
    """Sphere of a diameter [m]; the vertices lie on it, the triangles up to diameter/3000 inside at 4 subdivisions."""
    vertices, faces = icosphere(subdivisions)
    return finished_mesh(
        vertices * (diameter / 2.0), faces, "sphere", f"sphere(diameter={diameter}, subdivisions={subdivisions})"
    )


def cylinder(diameter: float = 0.06, height: float = 0.12, segments: int = 96) -> Mesh:
    """Upright cylinder of a diameter and a height [m]."""
    source = f"cylinder(diameter={diameter}, height={height}, segments={segments})"
    return _prism(circle(segments) * (diameter / 2.0), height, "cylinder", source)


def triangular_prism(side: float = 0.08, height: float = 0.1) -> Mesh:
    """Upright prism on an equilateral triangle of a side [m], one edge towards +y."""
    outline = circle(3) @ np.array([[0.0, 1.0], [-1.0, 0.0]]) * (side / 3.0**0.5)
    return _prism(outline, height, "triangular-prism", f"triangular_prism(side={side}, height={height})")


def cube(side: float = 0.07) -> Mesh:
    """Cube of a side [m]."""
    outline = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]]) * (side / 2.0)
    return _prism(outline, side, "cube", f"cube(side={side})")


def hexagonal_prism(side: float = 0.04, height: float = 0.1) -> Mesh:
    """Upright prism on a regular hexagon of a side [m], two of its edges on the x axis."""
    return _prism(circle(6) * side, height, "hexagonal-prism", f"hexagonal_prism(side={side}, height={height})")


GENERATORS: dict[str, Callable[..., Mesh]] = {
    "sphere": sphere,
    "cylinder": cylinder,
    "triangular-prism": triangular_prism,
    "cube": cube,
    "hexagonal-prism": hexagonal_prism,
    "rock": rock,
    "shamrock": shamrock,
    "cup": cup,
    "handle-box": handle_box,
}
"""The generators by the name of the object they make."""


def _prism(outline: NDArray[np.float64], height: float, name: str, source: str) -> Mesh:
    """Upright prism on a convex counter-clockwise outline [m], shape (n, 2)."""
    count = len(outline)
    bottom = np.column_stack([outline, np.full(count, -height / 2.0)])
    top = np.column_stack([outline, np.full(count, height / 2.0)])
    lower, upper = np.arange(count), np.arange(count, 2 * count)
    if count <= 6:
        # Few corners need no centre vertex: a fan from one corner covers the face.
        caps = [fan(0, lower)[1:-1][:, ::-1], fan(count, upper)[1:-1]]
        return finished_mesh(np.concatenate([bottom, top]), [band(lower, upper), *caps], name, source)
    middle = np.array([[0.0, 0.0, -height / 2.0], [0.0, 0.0, height / 2.0]])
    caps = [fan(2 * count, lower)[:, ::-1], fan(2 * count + 1, upper)]
    return finished_mesh(np.concatenate([bottom, top, middle]), [band(lower, upper), *caps], name, source)
