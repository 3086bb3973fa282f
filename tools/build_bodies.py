"""Meshes of the bodies of the shipped files of bodies, by formula; for maintainers and the tests.

    python -m tools.build_bodies

writes them to objects/bodies/. They are closed, wound outward, z up, without slivers; the same formula gives the same
bytes. But for the scissors, whose origin is on the pin, the centre of the bounding box is at the origin [mm]:

| file | shape |
|---|---|
| scissors-half | blade, shank and finger ring, 4 thick, from z = 0 up; the other half is it turned about y by 180° |
| block | cube of 40 |
| peg | prism of 48 sides on a circle of 10, 60 long, its lower end chamfered by 2 |
| hole | block of 60 × 60 × 40 with a hole of 48 sides around a circle of 10.5, both rims chamfered by 2 |
| pot | 48 sides on a circle of 50, wall and bottom 4, 60 high |
| lid | flange of 50 that rests on the rim, knob of 12 and 20 high, ring that enters the pot by 6 with 1 to spare |
"""

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.mesh.mesh import Mesh
from tools.build_catalogue import ply_bytes
from tools.import_graph import REPOSITORY
from tools.shapes.generators import cube
from tools.shapes.surface_parts import band, circle, fan, finished_mesh

SIDES = 48
INSCRIBED = float(np.cos(np.pi / SIDES))
"""Radius of the circle in a prism over that of the circle around it."""
PEG, HOLE, CHAMFER = 0.010, 0.0105, 0.002
POT, WALL, POT_HEIGHT = 0.050, 0.004, 0.060
SPARE, ENTERS, FLANGE, RING = 0.001, 0.006, 0.004, 0.004
KNOB, KNOB_HEIGHT = 0.012, 0.020
RING_CENTER, RING_INNER, RING_OUTER, RING_SIDES = (0.021, -0.068), 0.0135, 0.019, 24
"""Of a finger ring of the scissors [m]."""
BLADE = [
    *((0.010, -0.040, 0.006), (0.003, -0.018, 0.007), (0.0, 0.0, 0.008), (0.0, 0.018, 0.0075)),
    *((0.0, 0.036, 0.006), (0.0, 0.054, 0.0045), (0.0, 0.070, 0.002)),
]
"""Middle and half width of the shank and the blade, from the ring to the tip [m]."""
THICKNESS = 0.004


def ring(radius: float, z: float, sides: int = SIDES) -> FloatArray:
    """Return the corners of a level polygon on a circle about z, counter-clockwise, shape (sides, 3) [m]."""
    return np.column_stack([radius * circle(sides), np.full(sides, z)])


def square(half: float, z: float, sides: int) -> FloatArray:
    """Return points of a level square in the directions of a polygon's corners, shape (sides, 3) [m]."""
    directions = circle(sides)
    return np.column_stack([half * directions / np.abs(directions).max(axis=1, keepdims=True), np.full(sides, z)])


def rows(lower: FloatArray, upper: FloatArray, count: int) -> list[FloatArray]:
    """Return the rings from one to another one of as many corners, both ends included, in `count` equal steps."""
    return [lower + (upper - lower) * step / count for step in range(count + 1)]


def disc(radius: float, z: float, sides: int = SIDES) -> list[FloatArray]:
    """Return rings from a polygon inwards, each of half the corners of the one before."""
    found = [ring(radius, z, sides)]
    while sides > 6 and sides % 2 == 0:
        sides //= 2
        found.append(ring(radius * sides / (sides + 6.0), z, sides))
        radius = radius * sides / (sides + 6.0)
    return found


def between(lower: IntArray, upper: IntArray) -> IntArray:
    """Triangles between rings of equally many corners, or one of half as many, as `band` winds them."""
    if len(lower) == len(upper):
        return band(lower, upper)
    if len(lower) < len(upper):
        return between(upper, lower)[:, ::-1]
    even, odd, following = lower[::2], lower[1::2], np.roll(lower, -2)[::2]
    turned = np.roll(upper, -1)
    parts = [(even, odd, upper), (odd, turned, upper), (odd, following, turned)]
    return np.concatenate([np.stack(corners, axis=1) for corners in parts])


def stitched(rings: Sequence[FloatArray], name: str, *, hollow: bool = False) -> Mesh:
    """Make the solid whose surface passes through rings one after the other, and back to the first where it is hollow.

    Else a point in the middle of the first and of the last ring closes it.
    """
    start = np.cumsum([0, *map(len, rings)])
    corners = [np.arange(first, last) for first, last in pairwise(start)]
    faces = [between(one, other) for one, other in pairwise([*corners, *([corners[0]] if hollow else [])])]
    points = list(rings)
    if not hollow:
        faces += [fan(start[-1], corners[0])[:, ::-1], fan(start[-1] + 1, corners[-1])]
        points += [rings[0].mean(axis=0)[None], rings[-1].mean(axis=0)[None]]
    return finished_mesh(np.concatenate(points), faces, name, f"tools.build_bodies: {name}")


def peg() -> Mesh:
    """Return a peg whose lower end is chamfered."""
    tip, end = ring(PEG, CHAMFER), 0.060
    return stitched([*disc(PEG - CHAMFER, 0.0)[::-1], *rows(tip, ring(PEG, end), 14), *disc(PEG, end)[1:]], "peg")


def hole() -> Mesh:
    """Return a block with a hole from top to bottom."""
    radius, half = HOLE / INSCRIBED, 0.020
    rim, wide = radius + CHAMFER, 0.019
    wall = rows(ring(radius, half - CHAMFER), ring(radius, CHAMFER - half), 9)
    top, low = ([ring(wide, z, 24), ring(rim, z)] for z in (half, -half))
    sides = rows(square(0.030, -half, 24), square(0.030, half, 24), 4)
    return stitched([*sides, *top, *wall, *low[::-1]], "hole", hollow=True)


def pot() -> Mesh:
    """Return an open pot."""
    inside, top = POT - WALL, POT_HEIGHT
    outer, inner = rows(ring(POT, 0.0), ring(POT, top), 6), rows(ring(inside, top), ring(inside, WALL), 6)
    return stitched([*disc(POT, 0.0)[:0:-1], *outer, *inner, *disc(inside, WALL)[1:]], "pot")


def lid() -> Mesh:
    """Return the pot's lid."""
    enters = (POT - WALL) * INSCRIBED - SPARE
    under = [ring(enters - RING, 0.0), ring(enters - RING, -ENTERS), ring(enters, -ENTERS), ring(enters, 0.0)]
    top = [ring(POT, 0.0), ring(POT, FLANGE), ring(0.6 * POT, FLANGE, 24), ring(0.4 * POT, FLANGE, 24)]
    knob = rows(ring(KNOB, FLANGE, 24), ring(KNOB, FLANGE + KNOB_HEIGHT, 24), 4)
    end = disc(KNOB, FLANGE + KNOB_HEIGHT, 24)[1:]
    return stitched([*disc(enters - RING, 0.0)[:0:-1], *under, *top, *knob, *end], "lid")


def scissors_half() -> Mesh:
    """Return half of a pair of scissors, about the pin, its blade along y and its ring at x > 0."""
    turned = circle(RING_SIDES)
    inner, outer = (np.array(RING_CENTER) + radius * turned for radius in (RING_INNER, RING_OUTER))
    numbers = np.arange(2 * RING_SIDES)
    flat = [band(numbers[RING_SIDES:], numbers[:RING_SIDES])]
    # The shank goes on from the edges of the ring that look at it.
    first = round(RING_SIDES * 100.0 / 360.0)
    joint = [RING_SIDES + first + step for step in range(4)]
    strip = [np.array([[x + half, y], [x - half, y]]) for x, y, half in BLADE]
    points = np.concatenate([inner, outer, *strip])
    right, left = (2 * RING_SIDES + side + 2 * np.arange(len(BLADE)) for side in (0, 1))
    a, b, c, d = joint
    flat.append(np.array([[b, a, right[0]], [c, b, right[0]], [left[0], c, right[0]], [d, c, left[0]]]))
    flat += [
        np.array([[near, start, end], [far, near, end]])
        for start, near, end, far in zip(right, left, right[1:], left[1:])
    ]
    return extruded(points, np.concatenate(flat), THICKNESS, "scissors-half")


def extruded(points: FloatArray, faces: IntArray, height: float, name: str) -> Mesh:
    """Make the prism from z = 0 to a height on level triangles, counter-clockwise, of points (n, 2) [m]."""
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    known = {tuple(edge) for edge in edges.tolist()}
    a, b = np.array([edge for edge in edges.tolist() if (edge[1], edge[0]) not in known]).T
    count = len(points)
    sides = [np.stack([a, b, b + count], axis=1), np.stack([a, b + count, a + count], axis=1)]
    vertices = np.concatenate([np.column_stack([points, np.full(count, z)]) for z in (0.0, height)])
    mesh = finished_mesh(vertices, [faces[:, ::-1], faces + count, *sides], name, f"tools.build_bodies: {name}")
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    return Mesh(np.round(mesh.vertices + (low + high) / 2.0, 9) + 0.0, mesh.faces, name=name, source=mesh.source)


MESHES: dict[str, Callable[[], Mesh]] = {
    "scissors-half": scissors_half,
    "block": lambda: cube(0.040),
    "peg": peg,
    "hole": hole,
    "pot": pot,
    "lid": lid,
}
"""Makers by the name of the file."""


def main() -> None:
    """Write all meshes."""
    for name, make in MESHES.items():
        mesh, path = make(), REPOSITORY / "objects" / "bodies" / f"{name}.ply"
        path.write_bytes(ply_bytes(mesh.vertices, mesh.faces))
        print(f"{path.relative_to(REPOSITORY)} {len(mesh.faces):,} triangles, {path.stat().st_size:,} bytes")


if __name__ == "__main__":
    main()
