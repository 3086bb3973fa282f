"""Choice of the viewpoint that shows most of a hand on an object, from points of their surfaces."""

from typing import NamedTuple

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.mesh.topology import face_samples
from hhsim.render.rasterizer import look_from
from hhsim.render.triangle_soup import Surface

AZIMUTHS, ELEVATIONS = tuple(range(0, 360, 30)), (10.0, 35.0)
"""Views that are tried [degrees]."""
CELLS = 48
GAIN = 0.5
"""Score, of at most about 2.5, by which another view must be better than the usual one."""
POINTS = 10_000
"""Least number of points that stand for a surface: several to each cell that it fills."""


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
    usual: View | None = None,
    below: float = np.inf,
) -> View:
    """Return the view that shows most of the marks, then of hand and object, with forces not seen end on.

    Marks are points that the object should not hide [m], shape (k, 3); forces are vectors, (j, 3). Only a view better
    by `GAIN` replaces the usual one of another picture; from `below` [m] under its surface the hand hides marks.
    """
    rng = np.random.default_rng(0)
    sampled = [face_samples(surface.points, surface.faces, POINTS, rng)[0] for surface in (hand, body)]
    # A fine mesh has a point on each of very many faces, of which some suffice.
    skin, stone = (points[:: max(1, len(points) // POINTS)] for points in sampled)
    views = [View(float(azimuth), elevation) for elevation in ELEVATIONS for azimuth in AZIMUTHS]
    return max(views, key=lambda view: _seen(view, skin, stone, marks, forces, below) + GAIN * (view == usual))


def _seen(
    view: View, skin: FloatArray, stone: FloatArray, marks: FloatArray, forces: FloatArray, below: float
) -> float:
    rotation = look_from(view.towards)
    whole = np.concatenate([skin, stone]) @ rotation[:2].T
    low, scale = whole.min(axis=0), CELLS / max(float(np.ptp(whole, axis=0).max()), 1e-9)

    def depths(points: FloatArray) -> tuple[IntArray, FloatArray]:
        seen = points @ rotation.T
        cell = np.clip(((seen[:, :2] - low) * scale).astype(np.int64), 0, CELLS)
        return cell[:, 0] * (CELLS + 1) + cell[:, 1], seen[:, 2]

    nearest = {}
    for name, points in (("skin", skin), ("stone", stone)):
        cell, depth = depths(points)
        nearest[name] = np.full((CELLS + 1) ** 2, -np.inf)
        np.maximum.at(nearest[name], cell, depth)
    hand_cells = int((nearest["skin"] > nearest["stone"]).sum())
    body_cells = int((nearest["stone"] > nearest["skin"]).sum())
    score = 1.5 * min(hand_cells, 1.5 * body_cells) / CELLS**2
    if len(marks):
        cell, depth = depths(marks)
        hidden = np.maximum(nearest["stone"][cell] - 2e-3, nearest["skin"][cell] - below)
        score += float(np.mean(depth > hidden))
    if len(forces):
        size = np.linalg.norm(forces, axis=1)
        across = np.linalg.norm((forces @ rotation.T)[:, :2], axis=1)
        score += 0.5 * float(across.sum() / max(float(size.sum()), 1e-12))
    return score
