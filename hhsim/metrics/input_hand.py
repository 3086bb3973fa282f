"""Depth of the user's hand in the object, and the shown hand's distance from it.

A recorded hand is inside by the errors of tracker, hand model and mesh, or because its user pressed.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from hhsim.arrays import BoolArray, FloatArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.forward_kinematics import PlacedHand, forward_kinematics
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import rotation_matrix
from hhsim.kernels.hand.hand_shape import HandShape
from hhsim.kernels.mesh.bvh import build_mesh_bvh
from hhsim.kernels.mesh.features import MeshFeatures
from hhsim.mesh.mesh import Mesh
from hhsim.mesh.topology import merged_vertices
from hhsim.metrics.mesh_penetration import mesh_clearance
from hhsim.metrics.metrics import penetration

BLOCK_TICKS = 8_192
"""Hands placed at a time."""
FIRST_LOOKS = 32
"""Initial interval of the search for the deepest tick [ticks]."""
SAME_DEPTH = 1e-6
"""Tolerance of the search for the deepest tick [m]."""
AWAY = 1e3
"""Place of a finger that is not to be measured [m]."""


class Correction(NamedTuple):
    """Distances of the shown hand from the user's, in the ticks with a touching pair."""

    palm: FloatArray  # distance of the palms' origins [m], shape (N,)
    joints: FloatArray  # mean distance of the twenty joint and tip centres [m], shape (N,)
    farthest: FloatArray  # largest distance of one of them [m], shape (N,)


class InputHand(NamedTuple):
    """Measures of a run's input hand."""

    depth: float  # depth at the deepest tick [m]; 0 where the hand is never inside
    correction: Correction  # distances in the ticks in which the shown hand touches
    free: float  # largest distance of a joint or tip centre from the user's [m] in free space; NaN for no such tick


def input_hand(
    hand: HandModel, depths: "Depths", haptic: HandConfiguration, shown: PlacedHand, touch: BoolArray, near: BoolArray
) -> InputHand:
    """Measure the user's hand and the shown one of a run, both in the frame of the object, where it stands still.

    Ticks at which the user's hand is not finite are left out. `touch` has the ticks with a touching pair, `near` those
    in which the shown hand is near the object, shape (T,).
    """
    finite = np.logical_and.reduce([np.isfinite(values).all(axis=tuple(range(1, values.ndim))) for values in haptic])
    finite &= np.linalg.norm(haptic.orientation, axis=1) > 0.0
    known = np.flatnonzero(finite)
    depth, free, parts = 0.0, np.nan, [Correction(np.empty(0), np.empty(0), np.empty(0))]
    for first in range(0, len(known), BLOCK_TICKS):
        chosen = known[first : first + BLOCK_TICKS]
        placed = forward_kinematics(hand, *haptic.at(chosen))
        depth = deepest(depths, hand.palm_tree.leaf_center, placed, depth)
        touching = touch[chosen]
        parts.append(_correction(placed.at(np.flatnonzero(touching)), shown.at(chosen[touching])))
        away = np.flatnonzero(~near[chosen])
        apart = _correction(placed.at(away), shown.at(chosen[away])).farthest
        free = np.fmax(free, _farthest_outside(depths, placed.at(away), apart))
    return InputHand(depth, Correction(*(np.concatenate(values) for values in zip(*parts))), float(free))


def _farthest_outside(depths: "Depths", placed: PlacedHand, apart: FloatArray) -> float:
    """Largest of some distances at whose hand is outside the object; NaN for none."""
    for ticks in np.split(np.argsort(-apart), range(FIRST_LOOKS, len(apart), FIRST_LOOKS)):
        outside = ticks[depths(placed.at(ticks)).max(axis=1) <= 0.0] if ticks.size else ticks
        if outside.size:
            return float(apart[outside[0]])
    return np.nan


Depths = Callable[[PlacedHand], FloatArray]
"""Depths of some hands [m], (T, 6): each finger and the palm; outside 0, or negative by at most the clearance."""


def object_depths(surface: Any, mesh: Mesh, shape: HandShape, fingers: BoolArray) -> Depths:
    """Depth function of the object's leaf spheres or triangles; `fingers` (5,) selects the modelled fingers.

    In a closed mesh it is the depth of the hand's deepest point, unlike the distance to its nearest triangle.
    """
    if not isinstance(surface, MeshFeatures) or surface.multiplicity.shape[0] == 0:
        # Spheres, or triangles that enclose nothing and count as pierced.
        def in_pieces(placed: PlacedHand) -> FloatArray:
            found = penetration(surface, shape, placed, fingers)
            return np.concatenate([np.nan_to_num(found.finger), found.palm[:, None]], axis=1)

        return in_pieces
    # Where parts touch or cross, the closest face of a point in one of them may be the other's.
    by_winding = surface.pseudonormal.shape[0] == 0
    bvh = build_mesh_bvh(*merged_vertices(mesh.vertices, mesh.faces), by_winding=by_winding)
    nowhere = np.full((4, 3), AWAY)
    empty = HandShape(shape.phalanx_radius, np.empty((0, 3)), np.empty(0))

    def of(placed: PlacedHand) -> FloatArray:
        depth = np.zeros((len(placed.joints), 6))
        for part in (*np.flatnonzero(fingers), 5):
            joints = np.broadcast_to(nowhere, placed.joints.shape).copy()
            if part < 5:
                joints[:, part] = placed.joints[:, part]
            alone = PlacedHand(joints, placed.position, placed.orientation)
            depth[:, part] = -mesh_clearance(bvh, shape if part == 5 else empty, alone)
        return depth

    return of


def deepest(depths: Depths, palm_center: FloatArray, placed: PlacedHand, known: float = 0.0) -> float:
    """Depth of the deepest of T hands [m], to `SAME_DEPTH`; `known`, found elsewhere, where none is deeper.

    The palm's spheres have centres [m], palm frame, of shape (P, 3); the hands are in the order of time, and finite.
    No finger or palm is deeper than at another tick by more than its surface moves between them, so most ticks are
    skipped.
    """
    if len(placed.joints) == 0:
        return known
    moved = _moved(palm_center, placed)
    travel = np.concatenate([np.zeros((1, moved.shape[1])), np.cumsum(moved, axis=0)])
    looked = np.unique(np.append(np.arange(0, len(travel), FIRST_LOOKS), len(travel) - 1))
    depth = depths(placed.at(looked))
    best = max(known, float(depth.max()))
    while True:
        # Upper bound in between: the depths at both ends, and the travel from them.
        bound = 0.5 * (depth[:-1] + depth[1:] + np.diff(travel[looked], axis=0)).max(axis=1)
        open_ = np.flatnonzero((bound > best + SAME_DEPTH) & (np.diff(looked) > 1))
        if open_.size == 0:
            return best
        more = (looked[open_] + looked[open_ + 1]) // 2
        found = depths(placed.at(more))
        best = max(best, float(found.max()))
        looked, depth = np.insert(looked, open_ + 1, more), np.insert(depth, open_ + 1, found, axis=0)


def _moved(palm_center: FloatArray, placed: PlacedHand) -> FloatArray:
    """Upper bound of the travel of each finger's and the palm's surface to the next tick [m], shape (T - 1, 6)."""
    fingers = np.sqrt((np.diff(placed.joints, axis=0) ** 2).sum(axis=3).max(axis=2))
    low, high = palm_center.min(axis=0), palm_center.max(axis=0)
    # The palm's spheres lie in a box: none moves farther than its farthest corner.
    corners = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
    places = rotation_matrix(placed.orientation) @ corners.T + placed.position[:, :, None]
    palm = np.sqrt((np.diff(places, axis=0) ** 2).sum(axis=1).max(axis=1))
    return np.concatenate([fingers, palm[:, None]], axis=1)


def _correction(haptic: PlacedHand, shown: PlacedHand) -> Correction:
    apart = np.linalg.norm(haptic.points - shown.points, axis=2)
    joints = apart[:, :-1]
    return Correction(apart[:, -1], joints.mean(axis=1), joints.max(axis=1, initial=0.0))
