"""From where a hand on an object is seen best: a coarse look at points of their surfaces from many sides."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hhsim.rendering import look_from

FloatArray = NDArray[np.float64]

AZIMUTHS, ELEVATIONS = tuple(range(0, 360, 30)), (10.0, 35.0)
"""Views that are tried [degrees]."""
CELLS = 40
"""Rows and columns of a trial."""
GAIN = 0.5
"""Of a score of at most about 2.5."""
MOST_POINTS = 20_000
"""Of a surface; of one with more, so many evenly spread."""


class View(NamedTuple):
    """Azimuth from x to y, and elevation [degrees], of a viewer."""

    azimuth: float
    elevation: float

    @property
    def towards(self) -> FloatArray:
        """The direction to the viewer, unit, shape (3,)."""
        a, e = np.radians(self)
        return np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])


def clear_view(
    hand: FloatArray, body: FloatArray, marks: FloatArray, forces: FloatArray, usual: View | None = None
) -> View:
    """The view in which most is seen of the marks, then of hand and object, and forces are not seen end on.

    Args:
        hand: points of the hand's surface [m], shape (n, 3).
        body: of the object's, shape (m, 3).
        marks: that should not be hidden by the object, shape (k, 3); may be none.
        forces: vectors, shape (j, 3); may be none.
        usual: that another picture has; another view must be better by `GAIN` to be chosen.
    """
    skin, stone = (points[:: max(1, len(points) // MOST_POINTS)] for points in (hand, body))
    views = [View(float(azimuth), elevation) for elevation in ELEVATIONS for azimuth in AZIMUTHS]
    return max(views, key=lambda view: _seen(view, skin, stone, marks, forces) + GAIN * (view == usual))


def _seen(view: View, skin: FloatArray, stone: FloatArray, marks: FloatArray, forces: FloatArray) -> float:
    rotation = look_from(view.towards)
    low, high = np.array([np.min(skin @ rotation.T, axis=0), np.max(skin @ rotation.T, axis=0)])
    scale = CELLS / max(float((high - low)[:2].max()), 1e-9)

    def depths(points: FloatArray) -> tuple[NDArray[np.int64], FloatArray]:
        seen = points @ rotation.T
        cell = np.clip(((seen[:, :2] - low[:2]) * scale).astype(np.int64) + 1, 0, CELLS + 2)
        return cell[:, 0] * (CELLS + 3) + cell[:, 1], seen[:, 2]

    nearest = {}
    for name, points in (("skin", skin), ("stone", stone)):
        cell, depth = depths(points)
        nearest[name] = np.full((CELLS + 3) ** 2, -np.inf)
        np.maximum.at(nearest[name], cell, depth)
    hand_cells = int((nearest["skin"] > nearest["stone"]).sum())
    body_cells = int((nearest["stone"] > nearest["skin"]).sum())
    score = 1.5 * min(hand_cells, 1.5 * body_cells) / CELLS**2
    if len(marks):
        cell, depth = depths(marks)
        score += float(np.mean(depth > nearest["stone"][cell] - 2e-3))
    if len(forces):
        size = np.linalg.norm(forces, axis=1)
        across = np.linalg.norm((forces @ rotation.T)[:, :2], axis=1)
        score += 0.5 * float(across.sum() / max(float(size.sum()), 1e-12))
    return score
