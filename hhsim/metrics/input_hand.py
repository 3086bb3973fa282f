"""How deep the user's hand was in the object, and how far from it the shown hand had to go.

A fact of the motion and of what the method made of it: a recorded hand is in the object by what tracker, hand model and
mesh are off by, or because its user pressed.
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
"""Hands that are placed at a time."""
FIRST_LOOKS = 32
"""Ticks between two that are looked at whatever the others are."""
SAME_DEPTH = 1e-6
"""The deepest tick is found to this [m]: finer than any table shows."""
AWAY = 1e3
"""Where a finger is that is not to be measured [m]."""


class Correction(NamedTuple):
    """How far the shown hand is from the user's, over the ticks with a touching pair.

    Attributes:
        palm: Distance of the palms' origins [m], shape (N,).
        joints: Mean distance of the twenty joint and tip centres [m], shape (N,).
        farthest: Largest distance of one of them [m], shape (N,).
    """

    palm: FloatArray
    joints: FloatArray
    farthest: FloatArray


class InputHand(NamedTuple):
    """What of a run's input is told beside its output.

    Attributes:
        depth: Of the deepest tick [m]; 0 where the hand is never inside.
        correction: In the ticks in which the shown hand touches.
        free: Largest distance of one of the twenty joint and tip centres from the user's [m], over the ticks in which
            nothing keeps the shown hand from following; NaN where there is none.
    """

    depth: float
    correction: Correction
    free: float


def input_hand(
    hand: HandModel,
    depths: "Depths",
    haptic: HandConfiguration,
    shown: PlacedHand,
    touch: BoolArray,
    near: BoolArray,
) -> InputHand:
    """Measure the user's hand and the shown one of a run.

    Args:
        depths: In the object, where it stands still.
        haptic: The user's hand at each tick, as the object sees it; ticks that are not finite are left out.
        shown: Where the shown hand is, in the same frame.
        touch: Ticks with a touching pair, shape (T,).
        near: Ticks in which the shown hand is near the object, shape (T,).
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
    """Return the largest of some distances at whose hand is outside of the object; NaN where none is."""
    for ticks in np.split(np.argsort(-apart), range(FIRST_LOOKS, len(apart), FIRST_LOOKS)):
        outside = ticks[depths(placed.at(ticks)).max(axis=1) <= 0.0] if ticks.size else ticks
        if outside.size:
            return float(apart[outside[0]])
    return np.nan


Depths = Callable[[PlacedHand], FloatArray]
"""Depths of some hands [m], shape (T, 6) of each finger and the palm; below 0 by no more than it is free, or 0."""


def object_depths(surface: Any, mesh: Mesh, shape: HandShape, fingers: BoolArray) -> Depths:
    """Depths in what the hand touches: an object's leaf spheres, or its triangles.

    Args:
        surface: Arrays of the object's surface.
        fingers: Which ones are modelled, shape (5,).
    """
    if isinstance(surface, MeshFeatures) and surface.multiplicity.shape[0] > 0:
        return _mesh_depths(mesh, shape, fingers)
    return _surface_depths(surface, shape, fingers)


def _surface_depths(surface: Any, shape: HandShape, fingers: BoolArray) -> Depths:
    """Depths in single pieces: spheres, or triangles that enclose nothing and are reached through by so much."""

    def of(placed: PlacedHand) -> FloatArray:
        found = penetration(surface, *shape, *placed, fingers)
        return np.concatenate([np.nan_to_num(found.finger), found.palm[:, None]], axis=1)

    return of


def _mesh_depths(mesh: Mesh, shape: HandShape, fingers: BoolArray) -> Depths:
    """Depths in a closed mesh: of the deepest point of the hand, which a distance of its nearest triangle is not."""
    bvh = build_mesh_bvh(*merged_vertices(mesh.vertices, mesh.faces))
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
    """Depth of the deepest of some hands [m], to `SAME_DEPTH`; `known` where none is deeper than that.

    No finger is deeper than at another tick by more than its surface moves between them: most are never looked at.

    Args:
        depths: In the object.
        palm_center: Centres of the palm's spheres [m], palm frame, shape (P, 3).
        placed: The hands, in the order of time, all of them finite.
        known: A depth that was found elsewhere [m].
    """
    count = len(placed.joints)
    if count == 0:
        return known
    way = np.concatenate([np.zeros((1, 6)), np.cumsum(_moved(palm_center, placed), axis=0)])
    looked = np.unique(np.append(np.arange(0, count, FIRST_LOOKS), count - 1))
    depth = depths(placed.at(looked))
    best = max(known, float(depth.max()))
    while True:
        # The most that a part can be in between: as deep as at both looks, and what it moved on from them.
        room = 0.5 * (depth[:-1] + depth[1:] + np.diff(way[looked], axis=0)).max(axis=1)
        open_ = np.flatnonzero((room > best + SAME_DEPTH) & (np.diff(looked) > 1))
        if open_.size == 0:
            return best
        more = (looked[open_] + looked[open_ + 1]) // 2
        found = depths(placed.at(more))
        best = max(best, float(found.max()))
        looked, depth = np.insert(looked, open_ + 1, more), np.insert(depth, open_ + 1, found, axis=0)


def _moved(palm_center: FloatArray, placed: PlacedHand) -> FloatArray:
    """At least the way of any point of each finger's and the palm's surface to the next tick [m], shape (T - 1, 6)."""
    fingers = np.sqrt((np.diff(placed.joints, axis=0) ** 2).sum(axis=3).max(axis=2))
    low, high = palm_center.min(axis=0), palm_center.max(axis=0)
    # The palm's spheres are within the box: none moves farther than its farthest corner.
    corners = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
    places = rotation_matrix(placed.orientation) @ corners.T + placed.position[:, :, None]
    palm = np.sqrt((np.diff(places, axis=0) ** 2).sum(axis=1).max(axis=1))
    return np.concatenate([fingers, palm[:, None]], axis=1)


def _correction(haptic: PlacedHand, shown: PlacedHand) -> Correction:
    apart = np.linalg.norm(haptic.points - shown.points, axis=2)
    joints = apart[:, :-1]
    return Correction(apart[:, -1], joints.mean(axis=1), joints.max(axis=1, initial=0.0))
