"""Closed mesh of the palm, generated from a few sizes.

The palm is the four finger metacarpals, the carpus and the flesh on them, without the thumb's metacarpal (paper,
Section III-B): the zero set of a smooth union of round cones, namely bones, pads, hypothenar, thenar base and heel.
Seen from its middle it is star-shaped, so one vertex per ray gives a mesh that is closed by construction.
"""

import functools
from itertools import product
from typing import NamedTuple

import numpy as np

from hhsim.arrays import BoolArray, FloatArray, IntArray
from hhsim.errors import InputError
from hhsim.mesh.mesh import Mesh
from hhsim.reproducible import exponential, norm, sine_and_cosine

RAYS_PER_EDGE = (16, 16, 8)
"""Squares along x, y and z of the box whose grid names the rays: 4 (16·16 + 16·8 + 8·16) = 2,048 triangles."""

HALF_EXTENT = (0.43, 0.265, 0.145)
"""Half edges of that box: breadth [HB], length [HL], thickness [HB]; its edges run along the palm's rounded rims."""

CENTER_HEIGHT = -0.045
"""Origin of the rays over the palm frame's origin [HB]: halfway between the back and the pads."""

BLEND_SHARE = 0.035
"""Width of the blend between two round cones, as a share of hand breadth."""


class RoundCones(NamedTuple):
    """Round cones (hulls of two spheres) in a right hand's palm frame: centres (n, 3), radii (n,) of their ends [m]."""

    a: FloatArray
    b: FloatArray
    radius_a: FloatArray
    radius_b: FloatArray

    def distance(self, points: FloatArray) -> FloatArray:
        """Return the distance [m] of points, shape (m, 3), to each cone, shape (m, n); linear taper."""
        # Coordinate by coordinate: numpy sums along an axis of three in three times the time.
        ax, ay, az = (self.b - self.a).T[..., None]
        x, y, z = points.T[:, None] - self.a.T[..., None]
        share = np.clip((x * ax + y * ay + z * az) / (ax * ax + ay * ay + az * az), 0.0, 1.0)
        x, y, z = x - share * ax, y - share * ay, z - share * az
        radius = self.radius_a[:, None], (self.radius_b - self.radius_a)[:, None]
        gap = np.sqrt(x * x + y * y + z * z) - radius[0] - share * radius[1]
        return np.ascontiguousarray(gap.T, dtype=np.float64)


def palm_parts(hand_length: float, hand_breadth: float, knuckle: FloatArray, knuckle_radius: FloatArray) -> RoundCones:
    """Return the bones and pads of a right palm.

    Length is from wrist crease to middle fingertip, breadth across the knuckles; `knuckle` are the first joints of
    index to little finger (4, 3), palm frame, with the fingers' radii there (4,), all in m.
    """
    along, across = hand_length, hand_breadth
    carpus = -0.150 * along
    # Flesh fills the gaps between the bones: every other strand runs between two fingers and ends in their web.
    joint, radius = np.repeat(knuckle, 2, axis=0)[:-1], np.repeat(knuckle_radius, 2)[:-1]
    joint[1::2] = 0.5 * (knuckle[:-1] + knuckle[1:]) + np.array([0.0, 0.022 * along, -0.015 * across])
    radius[1::2] = 0.42 * (knuckle_radius[:-1] + knuckle_radius[1:])
    wrist_x = np.linspace(-0.180, 0.180, len(joint)) * across
    rows: list[tuple[FloatArray, float, FloatArray, float]] = []
    for x, end, r in zip(wrist_x, joint, radius):
        rows.append((np.array([x, carpus, 0.0]), 0.115 * across, end, 0.78 * r))
        pad = end - np.array([0.0, 0.030 * along, 0.070 * across])
        rows.append((np.array([x, carpus, -0.070 * across]), 0.110 * across, pad, 0.86 * r))
    heel = np.array([0.0, carpus - 0.010 * along, -0.030 * across])
    side = np.array([0.150 * across, 0.0, 0.0])
    rows.append((heel - side, 0.145 * across, heel + side, 0.145 * across))
    hypothenar = np.array([0.245 * across, carpus + 0.020 * along, -0.080 * across])
    rows.append(
        (hypothenar, 0.150 * across, np.array([0.320 * across, 0.060 * along, -0.050 * across]), 0.110 * across)
    )
    thenar = np.array([-0.215 * across, carpus + 0.020 * along, -0.070 * across])
    rows.append((thenar, 0.150 * across, np.array([-0.290 * across, 0.090 * along, -0.025 * across]), 0.105 * across))
    a, radius_a, b, radius_b = (np.array(column) for column in zip(*rows))
    return RoundCones(a, b, radius_a, radius_b)


def palm_mesh(hand_length: float, hand_breadth: float, knuckle: FloatArray, knuckle_radius: FloatArray) -> Mesh:
    """Return the closed mesh of a right palm as `palm_parts`; InputError if no palm fits around the knuckles."""
    # A process that makes a hand usually makes the same one again, and its palm takes a tenth of a second.
    return _palm_mesh(hand_length, hand_breadth, tuple(knuckle.ravel().tolist()), tuple(knuckle_radius.tolist()))


@functools.lru_cache(maxsize=8)
def _palm_mesh(
    hand_length: float, hand_breadth: float, knuckle: tuple[float, ...], knuckle_radius: tuple[float, ...]
) -> Mesh:
    parts = palm_parts(hand_length, hand_breadth, np.array(knuckle).reshape(-1, 3), np.array(knuckle_radius))
    blend = BLEND_SHARE * hand_breadth
    center = np.array([0.0, 0.0, CENTER_HEIGHT * hand_breadth])
    half_extent = np.array([HALF_EXTENT[0] * hand_breadth, HALF_EXTENT[1] * hand_length, HALF_EXTENT[2] * hand_breadth])
    rays, faces = box_rays(half_extent)

    def inside(distance: FloatArray) -> BoolArray:
        d = parts.distance(center + distance[:, None] * rays)
        least = d.min(axis=1)
        # least - blend ln Σ exp((least - d) / blend) < 0, without the logarithm.
        return np.asarray(exponential((least[:, None] - d) / blend).sum(axis=1) > exponential(least / blend))

    if not inside(np.zeros(len(rays))).all():
        line = f"y = {0.2 * hand_length:.3g} m from the palm's origin"
        raise InputError(f"the finger bases leave the palm's middle empty: expected them around {line}")
    near, far = np.zeros(len(rays)), np.full(len(rays), 0.6 * hand_length)
    for _ in range(48):
        middle = 0.5 * (near + far)
        hit = inside(middle)
        near, far = np.where(hit, middle, near), np.where(hit, far, middle)
    return Mesh(
        vertices=center + rays * (0.5 * (near + far))[:, None],
        faces=faces,
        name="palm",
        source=f"generated, hand length {hand_length:g} m, breadth {hand_breadth:g} m",
    )


def box_rays(half_extent: FloatArray) -> tuple[FloatArray, IntArray]:
    """Return unit rays through a rounded box's grid, shape (n, 3), and the outward triangles between them, (m, 3)."""
    cells: dict[tuple[int, ...], int] = {}
    faces: list[tuple[int, int, int]] = []
    for axis, end in product(range(3), (0, 1)):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for i, j in product(range(RAYS_PER_EDGE[u]), range(RAYS_PER_EDGE[v])):
            square = []
            for di, dj in ((0, 0), (1, 0), (1, 1), (0, 1)):
                cell = [0, 0, 0]
                cell[axis], cell[u], cell[v] = end * RAYS_PER_EDGE[axis], i + di, j + dj
                square.append(cells.setdefault(tuple(cell), len(cells)))
            a, b, c, d = square if end else square[::-1]
            faces += [(a, b, c), (a, c, d)]
    # The tangent spreads the rays of a box's face evenly over the sphere.
    sine, cosine = sine_and_cosine(0.25 * np.pi * (2.0 * np.array(list(cells)) / np.array(RAYS_PER_EDGE) - 1.0))
    corner = sine / cosine
    directions = corner / norm(corner)[:, None] * half_extent
    return directions / np.linalg.norm(directions, axis=1, keepdims=True), np.array(faces, dtype=np.int64)
