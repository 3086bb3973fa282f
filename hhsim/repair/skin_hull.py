"""Hand model fitted to a recorded hand's skin: round cones and palm that contain its vertices with little to spare.

A vertex lies in a round cone if it lies in one of its spheres, x(s) = a + s (b − a) with radius (1 − s) r_a + s r_b.
For given shares s that is linear in the radii, and the volume of a finger is convex in them. So the least radii for
fixed shares are a small convex program; each vertex then takes the sphere that it lies deepest in, and so on. Every
round contains all vertices, and the volume falls from one to the next.
"""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from hhsim.arrays import BoolArray, FloatArray, IntArray
from hhsim.errors import InputError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.fingers import FINGERS
from hhsim.hand.forward_kinematics import forward_kinematics
from hhsim.hand.model import HandModel
from hhsim.mesh.mesh import Mesh
from hhsim.repair.projection import RELAXATION
from hhsim.repair.skin import Skin, cone_coordinates, cone_gaps, in_palm, palm_distance
from hhsim.solver.qp import QpProblem, QpStatus, solve_active_set
from hhsim.trees.cache import cached_sphere_tree
from hhsim.trees.hierarchy import build_hierarchy
from hhsim.trees.options import TreeOptions
from hhsim.trees.sphere_tree import SphereTree

Palm = Literal["none", "thin", "fitted"]

LEAST_RADIUS = 1e-3
"""Least radius of a fitted finger, and that of a palm that is not modelled [m]."""
THIN = 0.5
"""Share of the usual palm's thickness that a thin one has."""
ROUNDS = 20
"""Most rounds of a finger's fit; they end when the volume no longer falls."""
SETTLED = 1e-4
"""Share of the volume by which it has to fall for another round."""
PALM_POINTS = 1024
"""Most vertices that the palm's balls are made from; all others make them grow."""
LARGEST_BALL = 0.025
"""Largest inscribed ball of a palm [m]: half the thickness of the thickest hands."""
GROWTH_STEP = 1e-5
"""Accuracy of the growth of the palm's balls [m]."""
BLOCK_POINTS = 16_384
"""Points whose nearest ball is searched at once."""
BINS = 256
"""Intervals of a phalanx's axis; of the vertices nearest to one the farthest alone enters the program."""


@dataclass(frozen=True)
class SkinFit:
    """Distances of a skin's vertices to the bodies of their own bones, over all frames.

    A finger's bones count as one body; vertices of a palm that is not modelled do not count.
    """

    contained: float  # share of the vertices that lie inside
    excess_mean: float  # mean distance outside [m], over all vertices (0 inside)
    excess_max: float  # largest distance outside [m]


def hand_with_skin(
    hand: HandModel, skin: Skin, fitted: HandConfiguration, palm: Palm, contained: float = 0.999
) -> tuple[HandModel, SkinFit]:
    """Fit radii and palm of a hand to a skin.

    Args:
        hand: Hand model with the recorded bones.
        skin: Skin of the hand in T frames, our world. Moved skins of corrected frames may follow the recorded ones:
            the fingers then contain those too.
        fitted: Configuration of the hand in each of them.
        palm: "none" for no contact of the palm, "thin" for the hand's own at `THIN` of its thickness, "fitted" for
            spheres that contain the skin's vertices.
        contained: Share of the frames in which each vertex counts, from 0 to 1; those are left out in which it is
            farthest from its bone, so that few misfitted frames do not swell the hand in all.

    Returns:
        The hand, which contains every vertex of its modelled bones in each frame that counts, and what is left.

    Raises:
        InputError: No frame has finite vertices and configuration, or no vertex belongs to a palm that is to be fitted.
    """
    finite = [np.isfinite(values).reshape(len(values), -1).all(axis=1) for values in (skin.vertices, *fitted)]
    frames = np.flatnonzero(np.logical_and.reduce(finite))
    if not frames.size:
        raise InputError("skin: no frame has finite vertices and a fitted hand; expected at least one")
    skin, fitted = replace(skin, vertices=skin.vertices[frames]), fitted.at(frames)
    joints = forward_kinematics(hand, *fitted).joints
    radius = hand.radius.copy()
    for finger in range(len(FINGERS)):
        own, phalanx = _vertices_of(skin, finger)
        if own.size:
            along, across = cone_coordinates(joints[:, finger], skin.vertices[:, own])
            own_along, own_across = (each[:, np.arange(own.size), phalanx] for each in (along, across))
            beside = own_along - np.clip(own_along, 0.0, hand.length[finger, phalanx])
            counts = _nearest(np.hypot(beside, own_across), contained)
            of_bone = np.broadcast_to(phalanx, counts.shape)[counts]
            radius[finger] = fit_radii(along[counts], across[counts], of_bone, hand.length[finger])
    hand = replace(hand, radius=radius)
    hand = with_palm(hand, palm)
    if palm == "fitted":
        mesh, tree = _fitted_palm(hand, skin, fitted, contained)
        hand = replace(hand, palm_mesh=mesh, palm_tree=tree)
    return hand, skin_fit(hand, skin, fitted, palm)


def with_palm(hand: HandModel, palm: str) -> HandModel:
    """Return a hand whose palm is not modelled (`none`), is half as thick (`thin`), or is as it was (`fitted`)."""
    if palm == "fitted":
        return hand
    if palm == "none":
        # A small ball in the middle finger's knuckle: whatever would touch it touches that finger before. So the palm
        # takes no part, in the solver and in every measure, as long as that finger does.
        size = min(LEAST_RADIUS, 0.5 * float(hand.radius[2, 0]))
        mesh, tree = _palm_of_balls(hand.base[2][None], np.array([size]), 1, "not modelled")
    else:
        # Flattened to its middle plane.
        height = float(hand.palm_mesh.bounds[:, 2].mean())
        vertices = (hand.palm_mesh.vertices - [0.0, 0.0, height]) * [1.0, 1.0, THIN] + [0.0, 0.0, height]
        mesh = replace(hand.palm_mesh, vertices=vertices, source=f"{hand.palm_mesh.source}, {THIN:g} as thick")
        tree = cached_sphere_tree(mesh, TreeOptions(level=hand.palm_tree.depth))
    return replace(hand, palm_mesh=mesh, palm_tree=tree)


def skin_fit(hand: HandModel, skin: Skin, fitted: HandConfiguration, palm: Palm) -> SkinFit:
    """Measure how closely a hand contains a skin; arguments as of `hand_with_skin`, all finite."""
    joints = forward_kinematics(hand, *fitted).joints
    gaps: list[FloatArray] = [np.empty(0)]
    own = np.flatnonzero(skin.bone == 0)
    if palm != "none" and own.size:
        gaps[0] = np.concatenate([palm_distance(hand, points) for points in in_palm(fitted, skin.vertices[:, own])])
    for finger in range(len(FINGERS)):
        along, across = cone_coordinates(joints[:, finger], skin.vertices[:, _vertices_of(skin, finger)[0]])
        gaps.append(cone_gaps(along, across, hand.length[finger], hand.radius[finger])[1].min(axis=2).ravel())
    all_gaps = np.concatenate(gaps)
    outside = np.maximum(all_gaps, 0.0)
    return SkinFit(
        contained=float((all_gaps <= 0.0).mean()), excess_mean=float(outside.mean()), excess_max=float(outside.max())
    )


def _nearest(distance: FloatArray, contained: float) -> BoolArray:
    """Return True in a share of the frames for each vertex, where its distance is least, shape (T, V)."""
    return np.asarray(distance <= np.quantile(distance, contained, axis=0, method="higher"))


def _vertices_of(skin: Skin, finger: int) -> tuple[IntArray, IntArray]:
    """Return the vertices of a finger's bones, and the phalanx of each, 0 to 2."""
    phalanx = skin.bone - 1 - 3 * finger
    own = np.flatnonzero((phalanx >= 0) & (phalanx < 3))
    return own, phalanx[own]


def fit_radii(along: FloatArray, across: FloatArray, phalanx: IntArray, length: FloatArray) -> FloatArray:
    """Fit the radii of a finger of least volume that contains points.

    Their coordinates are as of `hhsim.repair.skin.cone_coordinates` [m], shape (n, 3); `phalanx` is that whose cone is
    the first to contain each, shape (n,). Returns radii at the joints and the tip [m], not growing towards the tip,
    shape (4,); every point is inside.
    """
    each = np.arange(len(phalanx))
    cone, share = phalanx, np.clip(along / length, 0.0, 1.0)[each, phalanx]
    best = np.full(4, np.inf)
    for _ in range(ROUNDS):
        needed = np.hypot(along[each, cone] - share * length[cone], across[each, cone])
        radius = _least_radii(*_binding_rows(cone, share, needed), length, np.minimum(best, needed.max()))
        shares, gap = cone_gaps(along, across, length, radius)
        # Rounding and the intervals leave a point micrometres outside.
        radius = radius + max(float(gap.min(axis=1).max()), 0.0)
        if not finger_volume(radius, length) < (1.0 - SETTLED) * finger_volume(best, length):
            break
        best = radius
        cone = gap.argmin(axis=1)
        share = shares[each, cone]
    shares, gap = cone_gaps(along, across, length, best)
    return best + max(float(gap.min(axis=1).max()), 0.0) * (1.0 + 1e-9)


def finger_volume(radius: FloatArray, length: FloatArray) -> float:
    """Compute the volume of three cone frusta and the half balls at both ends [m³], convex in the radii."""
    a, b = radius[:3], radius[1:]
    frusta = (length * (a * a + a * b + b * b)).sum() / 3.0
    return float(np.pi * (frusta + 2.0 / 3.0 * (radius[0] ** 3 + radius[3] ** 3)))


def _binding_rows(cone: IntArray, share: FloatArray, needed: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return rows and bounds of A r ≥ b: of each interval of an axis the point that needs the largest radius."""
    place = cone * (BINS + 1) + np.floor(share * BINS)
    order = np.lexsort((needed, place))
    kept = order[np.append(np.diff(place[order]) > 0.0, True)]
    rows, each = np.zeros((len(kept), 4)), np.arange(len(kept))
    rows[each, cone[kept]], rows[each, cone[kept] + 1] = 1.0 - share[kept], share[kept]
    return rows, needed[kept]


def _least_radii(rows: FloatArray, bounds: FloatArray, length: FloatArray, start: FloatArray) -> FloatArray:
    """Minimise the volume's second-order model about `start` over non-growing radii with rows · r ≥ bounds."""
    least = np.vstack([rows, -np.diff(np.eye(4), axis=0), np.eye(4)[3]])
    right = np.concatenate([bounds, np.zeros(3), [LEAST_RADIUS]])
    # Of the volume over π: L/3 (a² + a b + b²) of a frustum, 2/3 r³ of a half ball.
    ball = 4.0 * start * [1.0, 0.0, 0.0, 1.0]
    curvature = np.diag(ball)
    for k in range(3):
        curvature[k : k + 2, k : k + 2] += length[k] / 3.0 * (np.eye(2) + 1.0)
    root = np.linalg.cholesky(curvature)
    # The model's minimum without any row.
    origin = np.linalg.solve(curvature, 0.5 * ball * start)
    across = np.linalg.solve(root, least.T).T
    found = solve_active_set(QpProblem(np.ones(4), across, right - least @ origin, np.zeros(4)), RELAXATION)
    radius = start if found.status is not QpStatus.OPTIMAL else origin + np.linalg.solve(root.T, found.x)
    return np.maximum.accumulate(radius[::-1])[::-1]


def _fitted_palm(hand: HandModel, skin: Skin, fitted: HandConfiguration, contained: float) -> tuple[Mesh, SphereTree]:
    """Return inscribed balls of the palm's mean vertices, grown until they contain the vertices of every frame."""
    own = np.flatnonzero(skin.bone == 0)
    if not own.size:
        raise InputError("skin: no vertex belongs to the palm; choose a palm that is none or thin")
    points = in_palm(fitted, skin.vertices[:, own])
    mean = np.zeros(skin.vertices.shape[1:])
    mean[own] = points.mean(axis=0)
    faces = skin.faces[(skin.bone[skin.faces] == 0).all(axis=1)]
    normal = np.zeros_like(mean)
    for corner in range(3):
        a, b, c = (mean[faces[:, k]] for k in range(3))
        np.add.at(normal, faces[:, corner], np.cross(b - a, c - a))
    some = own[np.unique(np.linspace(0, len(own) - 1, PALM_POINTS).astype(np.int64))]
    center, radius = ball_cover(mean[some], normal[some], hand.palm_tree.leaf_count)
    grown = radius.copy()
    counted = points[_nearest(np.linalg.norm(points - mean[own], axis=2), contained)]
    for first in range(0, len(counted), BLOCK_POINTS):
        at = counted[first : first + BLOCK_POINTS]
        apart = np.linalg.norm(at[:, None] - center, axis=2)
        nearest = (apart - radius).argmin(axis=1)
        np.maximum.at(grown, nearest, apart[np.arange(len(at)), nearest] * (1.0 + 1e-12))
    return _palm_of_balls(center, grown, hand.palm_tree.depth, "balls around the palm of the recorded skin")


def ball_cover(points: FloatArray, normal: FloatArray, most: int) -> tuple[FloatArray, FloatArray]:
    """Cover points of a surface by at most so many balls that stand out of it as little as greedy choice allows.

    Candidates touch a point from inside and hold no other (shrinking balls: Ma, Bae & Choi, Visual Computer 28, 2012).
    All grow by the same length, found by bisection, so that few of them cover all points. Points [m] and outward
    normals, of any length, zero where unknown, have shape (n, 3). Returns centres [m], shape (m, 3), and radii [m],
    shape (m,).
    """
    size = np.linalg.norm(normal, axis=1, keepdims=True)
    inward = -normal / np.where(size > 0.0, size, 1.0)
    offset = points - points[:, None]
    depth = (offset * inward[:, None]).sum(axis=2)
    square = (offset * offset).sum(axis=2)
    radius = np.where(depth > 0.0, square / np.maximum(2.0 * depth, 1e-12), LARGEST_BALL).min(axis=1)
    radius = np.where(size[:, 0] > 0.0, np.minimum(radius, LARGEST_BALL), 0.0)
    center = points + radius[:, None] * inward
    gap = np.linalg.norm(points - center[:, None], axis=2) - radius[:, None]
    low, high = 0.0, float(gap.min(axis=0).max())
    while len(chosen := _greedy(gap <= high)) > most:
        low, high = high, 2.0 * high + LEAST_RADIUS
    while high - low > GROWTH_STEP:
        middle = 0.5 * (low + high)
        fewer = _greedy(gap <= middle) if (gap <= middle).any(axis=0).all() else None
        if fewer is None or len(fewer) > most:
            low = middle
        else:
            high, chosen = middle, fewer
    return center[chosen], radius[chosen] + high


def _greedy(covers: BoolArray) -> list[int]:
    """Choose rows whose union has every column that any row has, always the one that adds most."""
    left, chosen = covers.any(axis=0), []
    while left.any():
        chosen.append(int((covers & left).sum(axis=1).argmax()))
        left &= ~covers[chosen[-1]]
    return chosen


def _palm_of_balls(center: FloatArray, radius: FloatArray, level: int, source: str) -> tuple[Mesh, SphereTree]:
    """Return balls as a palm: a mesh of polyhedra inside of them, and the tree over them."""
    from trimesh.creation import icosphere

    ball = icosphere(subdivisions=1, radius=0.999)
    vertices = (center[:, None] + radius[:, None, None] * ball.vertices).reshape(-1, 3)
    faces = (len(ball.vertices) * np.arange(len(center))[:, None, None] + ball.faces).reshape(-1, 3)
    return Mesh(vertices, faces, name="palm", source=source), build_hierarchy(center, radius, level, 8)
