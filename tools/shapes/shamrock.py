"""A shamrock by formula: three heart-shaped leaves on a stem, with notches, gaps and grooves."""

import numpy as np
from numpy.typing import NDArray

from hhsim.arrays import FloatArray, IntArray
from hhsim.mesh.mesh import Mesh
from tools.shapes.surface_parts import finished_mesh

SHAMROCK_LEAVES_DEG = (198.0, 342.0, 90.0)
SHAMROCK_RIM = 4.5
SHAMROCK_SPACING = 1.9


def shamrock(size: float = 0.105, thickness: float = 0.013) -> Mesh:
    """Three heart-shaped leaves on a stem, upright in the x–z plane, the rim rounded, a groove along each midrib.

    Args:
        size: Longest extent [m], leaf to stem.
        thickness: Largest thickness along y [m].
    """
    # Drawn in millimetres, 100 mm high, and scaled at the end.
    outline, outward = _belt(_shamrock_pulleys(), SHAMROCK_SPACING)
    points, inset = _shamrock_points(outline, outward)
    triangles = _triangles_inside(points, outline)
    rise = np.sqrt(np.clip(1.0 - (1.0 - np.minimum(inset / SHAMROCK_RIM, 1.0)) ** 2, 0.0, None))
    rise *= 1.0 - 0.38 * _midrib(points, inset)
    scale = size / np.ptp(points, axis=0).max()
    height = rise * (thickness / 2.0)
    front = np.column_stack([points[:, 0] * scale, -height, points[:, 1] * scale])
    back = np.column_stack([points[:, 0] * scale, height, points[:, 1] * scale])
    # The outline comes first and lies in both sheets: the back shares it.
    count = len(outline)
    twin = np.concatenate([np.arange(count), np.arange(count, len(points)) + len(points) - count])
    vertices = np.concatenate([front, back[count:]])
    return finished_mesh(
        vertices, [triangles, twin[triangles][:, ::-1]], "shamrock", f"shamrock(size={size}, thickness={thickness})"
    )


def _shamrock_pulleys() -> FloatArray:
    """Circles that a belt drawn around them makes a shamrock: x, y, signed radius [mm], shape (n, 3)."""
    pulleys: list[tuple[float, float, float]] = []

    def polar(distance: float, degrees: float, radius: float) -> None:
        angle = np.radians(degrees)
        pulleys.append((distance * float(np.cos(angle)), distance * float(np.sin(angle)), radius))

    left, right, top = SHAMROCK_LEAVES_DEG
    for leaf, gap in ((right, (right - 360.0 + top) / 2.0), (top, (top + left) / 2.0), (left, None)):
        polar(32.0, leaf - 20.0, 13.5)
        polar(44.0, leaf, -3.0)
        polar(32.0, leaf + 20.0, 13.5)
        if gap is not None:
            polar(12.0, gap, -2.0)
    # The stem: concave where it leaves the leaves, a blunt foot bent to the left.
    pulleys += [(-7.2, -15.5, -2.0), (-45.0, -38.0, -40.0), (-4.5, -58.5, 4.4), (7.2, -15.5, -2.0)]
    return np.array(pulleys)


def _belt(pulleys: FloatArray, spacing: float) -> tuple[FloatArray, FloatArray]:
    """Closed counter-clockwise belt around circles, in their order.

    A positive radius keeps its circle inside the belt, a negative one outside. With n the outward normal of the
    straight piece between two circles, both touch the same line: n·(c₂ − c₁) = r₁ − r₂.

    Args:
        pulleys: x, y, signed radius of each circle, shape (n, 3).
        spacing: Largest distance between neighbours along the belt.

    Returns:
        Points and outward unit normals at even steps of length, both shape (m, 2).
    """
    center, radius = pulleys[:, :2], pulleys[:, 2]
    way = np.roll(center, -1, axis=0) - center
    length = np.linalg.norm(way, axis=1)
    along = (radius - np.roll(radius, -1)) / length
    right = np.stack([way[:, 1], -way[:, 0]], axis=1)
    leaving = (along[:, None] * way + np.sqrt(1.0 - along**2)[:, None] * right) / length[:, None]
    arriving = np.roll(leaving, 1, axis=0)
    start = np.arctan2(arriving[:, 1], arriving[:, 0])
    turn = np.arctan2(leaving[:, 1], leaving[:, 0]) - start
    turn = np.where(radius > 0.0, np.mod(turn, 2.0 * np.pi), -np.mod(-turn, 2.0 * np.pi))
    arc = np.abs(radius * turn)
    straight = length * np.sqrt(1.0 - along**2)
    ends = np.cumsum(np.stack([arc, straight], axis=1).ravel())
    count = int(np.ceil(ends[-1] / spacing))
    at = ends[-1] * np.arange(count) / count
    piece = np.searchsorted(ends, at, side="right")
    index, rest = piece // 2, at - np.concatenate([[0.0], ends])[piece]
    on_arc = piece % 2 == 0
    angle = start[index] + np.where(on_arc, rest / arc[index], 1.0) * turn[index]
    normal = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    forward = np.stack([-normal[:, 1], normal[:, 0]], axis=1)
    points = center[index] + radius[index, None] * normal + np.where(on_arc, 0.0, rest)[:, None] * forward
    return points, normal


def _shamrock_points(outline: FloatArray, outward: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Points to triangulate: the outline, rings inside it, a triangular lattice; and their distances to the outline."""
    rings = [outline]
    middle = (outline + np.roll(outline, -1, axis=0)) / 2.0
    middle_normal = outward + np.roll(outward, -1, axis=0)
    middle_normal /= np.linalg.norm(middle_normal, axis=1, keepdims=True)
    for number, slope in enumerate((0.3, 0.62, 0.95)):
        # Every other ring is shifted by half a step: no four points on a circle, so one triangulation only.
        base, base_normal = (middle, middle_normal) if number % 2 == 0 else (outline, outward)
        depth = SHAMROCK_RIM * (1.0 - np.cos(slope * np.pi / 2.0))
        moved = base - depth * base_normal
        clear = _distance_to_outline(moved, outline) > 0.9 * depth
        rings.append(_spread(moved[clear], 0.5 * SHAMROCK_SPACING))
    low, high = outline.min(axis=0), outline.max(axis=0)
    step = 1.5 * SHAMROCK_SPACING
    rows = np.arange(low[1], high[1], step * 3.0**0.5 / 2.0)
    lattice = np.concatenate(
        [
            np.column_stack([(x := np.arange(low[0] + step / 2.0 * (row % 2), high[0], step)), np.full(len(x), y)])
            for row, y in enumerate(rows)
        ]
    )
    inner = _is_inside(lattice, outline) & (_distance_to_outline(lattice, outline) > SHAMROCK_RIM + 0.6 * step)
    points = np.concatenate([*rings, lattice[inner]])
    return points, np.concatenate([np.zeros(len(outline)), _distance_to_outline(points[len(outline) :], outline)])


def _spread(points: FloatArray, spacing: float) -> FloatArray:
    """Leave out points of a path, shape (n, 2), that crowd the one kept before them."""
    kept = [0]
    for index in range(1, len(points)):
        if np.linalg.norm(points[index] - points[kept[-1]]) >= spacing:
            kept.append(index)
    return points[kept]


def _midrib(points: FloatArray, inset: FloatArray) -> FloatArray:
    """Depth of the groove along each leaf's axis, 0 to 1, at points [mm], shape (n,)."""
    groove = np.zeros(len(points))
    for degrees in SHAMROCK_LEAVES_DEG:
        axis = np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])
        along = points @ axis
        across = points @ np.array([-axis[1], axis[0]])
        fade = np.clip((along - 4.0) / 8.0, 0.0, 1.0)
        groove = np.maximum(groove, np.exp(-((across / 4.0) ** 2)) * fade * fade * (3.0 - 2.0 * fade))
    return groove * np.minimum(inset / SHAMROCK_RIM, 1.0)


def _triangles_inside(points: FloatArray, outline: FloatArray) -> IntArray:
    """Counter-clockwise Delaunay triangles within the outline, which the first points are, in order."""
    from scipy.spatial import Delaunay

    triangles = Delaunay(points).simplices.astype(np.int64)
    triangles = triangles[_is_inside(points[triangles].mean(axis=1), outline)]
    a, b, c = (points[triangles[:, corner]] for corner in range(3))
    area = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    triangles[area < 0.0] = triangles[area < 0.0][:, ::-1]
    return triangles


def _is_inside(points: FloatArray, outline: FloatArray) -> NDArray[np.bool_]:
    """Whether points lie within a closed polygon, by crossings of a ray to +x; shapes (n, 2) and (m, 2)."""
    x, y = points[:, 0, None], points[:, 1, None]
    x1, y1 = outline.T
    x2, y2 = np.roll(outline, -1, axis=0).T
    spans = (y1 > y) != (y2 > y)
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing = x1 + (y - y1) / (y2 - y1) * (x2 - x1)
    return np.asarray(np.count_nonzero(spans & (x < crossing), axis=1) % 2 == 1)


def _distance_to_outline(points: FloatArray, outline: FloatArray) -> FloatArray:
    """Distance from points, shape (n, 2), to a closed polygon, shape (m, 2)."""
    edge = np.roll(outline, -1, axis=0) - outline
    offset = points[:, None] - outline
    part = np.clip(np.einsum("nmi,mi->nm", offset, edge) / np.einsum("mi,mi->m", edge, edge), 0.0, 1.0)
    return np.asarray(np.linalg.norm(offset - part[:, :, None] * edge, axis=2).min(axis=1))
