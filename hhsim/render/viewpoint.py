"""Forces on a hand that a picture shows, and its viewpoint.

The viewpoint is the one that shows most of the hand, chosen from points of the surfaces.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.mesh.topology import face_samples
from hhsim.render.triangle_soup import Surface, look_from

GHOST = np.array([0.25, 0.52, 0.95])

ARROW_LENGTH = 0.02
"""Length of the arrow of 1 N [m]; it grows with the square root of the force, so that small ones can be seen."""

AZIMUTHS, ELEVATIONS = tuple(range(0, 360, 30)), (10.0, 35.0)
"""Views that are tried [degrees]."""
CELLS = 48
POINTS = 10_000
"""Least number of points that stand for a surface: several to each cell that it fills."""


@dataclass(frozen=True)
class PieceForce:
    """Contact force on one piece of a hand [N], and where its arrow begins [m], shapes (3,), world."""

    name: str
    contact: FloatArray
    force: FloatArray
    is_hidden: bool = False  # True if another part of the hand is before its contact


def arrow(force: PieceForce) -> FloatArray:
    """Return the arrow of a force [m], shape (3,)."""
    return np.asarray(ARROW_LENGTH * force.force / np.sqrt(np.linalg.norm(force.force)))


class View(NamedTuple):
    """Azimuth from x to y, and elevation [degrees], of a viewer."""

    azimuth: float
    elevation: float

    @property
    def towards(self) -> FloatArray:
        """Unit direction to the viewer, shape (3,)."""
        a, e = np.radians(self)
        return np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])


def viewpoint(
    hand: Surface,
    body: Surface,
    marks: FloatArray,
    forces: FloatArray,
    below: float = np.inf,
    elevations: Sequence[float] = ELEVATIONS,
) -> View:
    """Return the view that shows most of the marks, then of hand and object, with forces not seen end on.

    Marks are points that the object should not hide [m], shape (k, 3); forces are vectors, (j, 3). From `below` [m]
    under its surface the hand hides marks.
    """
    rng = np.random.default_rng(0)
    sampled = [face_samples(surface.points, surface.faces, POINTS, rng)[0] for surface in (hand, body)]
    # A fine mesh has a point on each of very many faces, of which some suffice.
    points = [points[:: max(1, len(points) // POINTS)] for points in sampled]
    views = [View(float(azimuth), elevation) for elevation in elevations for azimuth in AZIMUTHS]
    return max(views, key=lambda view: _seen(view, points, marks, forces, below))


def _seen(view: View, points: Sequence[FloatArray], marks: FloatArray, forces: FloatArray, below: float) -> float:
    rotation = look_from(view.towards)
    whole = np.concatenate(points) @ rotation[:2].T
    low, scale = whole.min(axis=0), CELLS / max(float(np.ptp(whole, axis=0).max()), 1e-9)

    def depths(points: FloatArray) -> tuple[IntArray, FloatArray]:
        seen = points @ rotation.T
        cell = np.clip(((seen[:, :2] - low) * scale).astype(np.int64), 0, CELLS)
        return cell[:, 0] * (CELLS + 1) + cell[:, 1], seen[:, 2]

    nearest = []
    for surface in points:
        cell, depth = depths(surface)
        nearest.append(np.full((CELLS + 1) ** 2, -np.inf))
        np.maximum.at(nearest[-1], cell, depth)
    skin, stone = nearest
    score = 1.5 * min(int((skin > stone).sum()), 1.5 * int((stone > skin).sum())) / CELLS**2
    if len(marks):
        cell, depth = depths(marks)
        score += float(np.mean(depth > np.maximum(stone - 2e-3, skin - below)[cell]))
    if len(forces):
        size = np.linalg.norm(forces, axis=1)
        across = np.linalg.norm((forces @ rotation.T)[:, :2], axis=1)
        score += 0.5 * float(across.sum() / max(float(size.sum()), 1e-12))
    return score
