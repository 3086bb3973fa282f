"""Objects made of spheres or of triangles by formula: balls, leaves, walls, rings, moulds, sheets, edges, soups.

And postures and motions that several hard cases share, and crossings of discs and rings.
"""

import math
from dataclasses import replace
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import BoolArray, FloatArray
from hhsim.hand.configuration import HandConfiguration, sequence
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import quaternion, quaternion_product, rotation_matrix
from hhsim.mesh.mesh import Mesh
from hhsim.motion.analytic_motion import UPRIGHT, still
from hhsim.trees.hierarchy import build_hierarchy
from hhsim.trees.options import needed_level
from hhsim.trees.sphere_tree import SphereTree

BRANCHING = 8
BALL_RADIUS = 0.038
"""Radius of the ball that most scenes have [m]: a hand reaches around it."""
SECTIONS = 96
"""Sides of round objects."""
ALONG_X = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
"""Rotation from the z axis to the x axis."""


@cache
def right_hand() -> HandModel:
    """Return the hand of most scenes."""
    return HandModel.default()


def tree_of(center: ArrayLike, radius: ArrayLike) -> SphereTree:
    """Return a tree over these leaf spheres, shapes (n, 3) and (n,), or one radius for all [m]."""
    points = np.asarray(center, np.float64).reshape(-1, 3)
    radii = np.broadcast_to(np.asarray(radius, np.float64), len(points))
    return build_hierarchy(points, radii, needed_level(len(points), BRANCHING), BRANCHING)


@cache
def ball(leaves: int, radius: float = BALL_RADIUS) -> SphereTree:
    """Return a ball about the origin, its surface of overlapping spheres on a Fibonacci lattice [m]."""
    index = np.arange(leaves) + 0.5
    polar, turn = np.arccos(1.0 - 2.0 * index / leaves), np.pi * (1.0 + 5.0**0.5) * index
    direction = np.stack([np.cos(turn) * np.sin(polar), np.sin(turn) * np.sin(polar), np.cos(polar)], axis=1)
    # Neighbours on the lattice are about √(4π/n) apart; spheres of 0.8 of that leave no hole.
    size = 0.8 * radius * math.sqrt(4.0 * math.pi / leaves)
    return tree_of((radius - size) * direction, size)


def disc(radius: float, spacing: float, thickness: float) -> SphereTree:
    """Return a round leaf in the plane z = 0 about the origin, of spheres on a triangular lattice [m]."""
    count = math.ceil(2.0 * radius / spacing)
    i, j = (axis.ravel() for axis in np.meshgrid(np.arange(-count, count + 1), np.arange(-count, count + 1)))
    points = np.stack([spacing * (i + 0.5 * j), spacing * (math.sqrt(0.75) * j), np.zeros(i.size)], axis=1)
    return tree_of(points[np.linalg.norm(points, axis=1) <= radius], 0.5 * thickness)


def plate(width: float, depth: float, spacing: float, radius: float) -> FloatArray:
    """Return the centres of a rectangular plate's spheres below the plane z = 0 about the origin [m], shape (n, 3)."""
    x = np.arange(-0.5 * width, 0.5 * width + 0.5 * spacing, spacing)
    y = np.arange(-0.5 * depth, 0.5 * depth + 0.5 * spacing, spacing)
    grid = np.stack(np.meshgrid(x, y, [-radius], indexing="ij"), axis=-1)
    return grid.reshape(-1, 3)


def ring(center: ArrayLike, axis: ArrayLike, inner: float, thickness: float = 3e-3, spheres: int = 60) -> SphereTree:
    """Return a ring about an axis [m]: `inner` is the radius of the hole, `thickness` of the round profile."""
    u = np.asarray(axis, np.float64)
    u = u / np.linalg.norm(u)
    v = np.cross(u, [1.0, 0.0, 0.0] if abs(u[0]) < 0.7 else [0.0, 0.0, 1.0])
    v /= np.linalg.norm(v)
    turn = np.linspace(0.0, 2.0 * np.pi, spheres, endpoint=False)[:, None]
    around = np.cos(turn) * v + np.sin(turn) * np.cross(u, v)
    return tree_of(np.asarray(center, np.float64) + (inner + thickness) * around, thickness)


def mould(
    pose: HandConfiguration, spheres: int, gap: float, radius: float, random: np.random.Generator, closed: bool = False
) -> SphereTree:
    """Return spheres of a radius [m], each `gap` [m] from a hand (one tick): a mould below, a closed one all around."""
    hand = right_hand()
    joints = hand.joints(*pose.at(0))
    palm = hand.palm_tree.leaf_center @ rotation_matrix(pose.orientation[0]).T + pose.position[0]
    # The hand as many spheres: those of the palm, and some along each round cone.
    share = np.linspace(0.0, 1.0, 120)[:, None]
    along = [
        (joints[f, k] + share * (joints[f, k + 1] - joints[f, k]), a + share[:, 0] * (b - a))
        for f in range(5)
        for k, (a, b) in enumerate(pairwise(hand.radius[f]))
    ]
    center = np.concatenate([palm, *(part[0] for part in along)])
    size = np.concatenate([hand.palm_tree.leaf_radius, *(part[1] for part in along)])
    found = np.zeros((0, 3))
    while len(found) < spheres:
        direction = random.normal(size=(1000, 3))
        direction /= np.linalg.norm(direction, axis=1)[:, None]
        if not closed:
            # From below: a hand can enter the mould and leave it.
            direction[:, 2] = -np.abs(direction[:, 2])
        chosen = random.integers(len(center), size=1000)
        points = center[chosen] + (size[chosen] + gap + radius)[:, None] * direction
        square = sum((points[:, k, None] - center[:, k]) ** 2 for k in range(3))
        distance = (np.sqrt(square) - size).min(axis=1) - radius
        found = np.concatenate([found, points[distance > 0.9 * gap]])
    return tree_of(found[:spheres], radius)


def scaled_hand(hand: HandModel, factor: float) -> HandModel:
    """Return the hand with every length times `factor`."""
    mesh = hand.palm_mesh
    lengths = ("hand_length", "hand_breadth", "base", "length", "radius")
    return replace(
        hand,
        **{name: getattr(hand, name) * factor for name in lengths},
        palm_mesh=Mesh(mesh.vertices * factor, mesh.faces, name=mesh.name, source=f"{mesh.source}, times {factor:g}"),
        palm_tree=hand.palm_tree.scaled(factor),
    )


@cache
def ball_mesh(radius: float = BALL_RADIUS, subdivisions: int = 4) -> Mesh:
    """Return a ball about the origin [m], 20 · 4ⁿ triangles."""
    return _made("icosphere", subdivisions=subdivisions, radius=radius)


def disc_mesh(radius: float, thickness: float, sections: int = SECTIONS) -> Mesh:
    """Return a cylinder about the z axis and the origin [m]: a round leaf in the plane z = 0 if it is thin."""
    return _made("cylinder", radius=radius, height=thickness, sections=sections)


def globe_mesh(radius: float, facets: int) -> Mesh:
    """Return a ball about the origin [m], poles on the x axis; `facets` around, half as many from pole to pole."""
    # trimesh makes twice as many around as the second number says.
    return _made("uv_sphere", radius=radius, count=(facets // 2, facets // 2)).transformed(ALONG_X, np.zeros(3))


def ring_mesh(center: ArrayLike, axis: ArrayLike, inner: float, thickness: float = 3e-3) -> Mesh:
    """Return a ring about an axis [m]: `inner` is the radius of the hole, `thickness` of the round profile."""
    from trimesh import geometry

    align: Any = geometry.align_vectors
    sections = {"major_sections": SECTIONS, "minor_sections": SECTIONS // 4}
    made = _made("torus", major_radius=inner + thickness, minor_radius=thickness, **sections)
    return made.transformed(align([0.0, 0.0, 1.0], axis)[:3, :3], center)


def _made(shape: str, **sizes: Any) -> Mesh:
    from trimesh import creation

    made = getattr(creation, shape)(**sizes)
    return Mesh(made.vertices, made.faces, name=shape)


def roof_mesh(length: float, half_width: float, height: float) -> Mesh:
    """Return a closed prism whose ridge is the x axis [m]; the roof falls off to both sides."""
    from trimesh import Trimesh

    profile = [(0.0, 0.0), (-half_width, -height), (half_width, -height)]
    hull = Trimesh([(end, y, z) for end in (-0.5 * length, 0.5 * length) for y, z in profile]).convex_hull
    return Mesh(hull.vertices, hull.faces, name="roof")


def cone_mesh(radius: float, height: float, sides: int) -> Mesh:
    """Return a cone [m] whose apex is the origin; every side is a triangle. A negative height is a pit."""
    turn = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)
    rim = np.stack([radius * np.cos(turn), radius * np.sin(turn), np.full(sides, -height)], axis=1)
    after = 1 + (np.arange(sides) + 1) % sides
    faces = np.stack([np.zeros(sides, np.int64), 1 + np.arange(sides), after], axis=1)
    return Mesh(np.concatenate([np.zeros((1, 3)), rim]), faces, name="cone")


def sheet_mesh(width: float, depth: float) -> Mesh:
    """Return a sheet of no thickness, two triangles in the plane z = 0 about the origin [m]."""
    x, y = 0.5 * width, 0.5 * depth
    corners = np.array([(-x, -y, 0.0), (x, -y, 0.0), (x, y, 0.0), (-x, y, 0.0)])
    return loose_mesh(corners[[(0, 1, 2), (0, 2, 3)]])


def loose_mesh(corners: FloatArray) -> Mesh:
    """Return triangles that share no vertices, corners of shape (F, 3, 3) [m]."""
    return Mesh(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3), name="triangles")


CURLED = (1.2, 1.4, 0.8)
"""Flexion [rad] of a finger that is out of the way."""
POINTING = np.array([(0.3, 0.4, 0.3), (0.0, 0.0, 0.0), CURLED, CURLED, CURLED])
"""Flexion [rad] of a hand whose index finger alone is straight."""
HALF = np.full((5, 3), 0.3)
"""Flexion [rad] of an open hand, slightly curved."""
FIST = np.array([(0.4, 0.7, 0.8), *((1.3, 1.6, 1.0),) * 4])
"""Flexion [rad] of a closed fist."""
INDEX = 1
"""Number of the index finger."""
RIM = 0.01
"""Margin [m] within the rim of a disc: a point that passes farther inside has gone through it and not around it."""


def handling(ticks: int) -> HandConfiguration:
    """Return a hand that comes to the ball of 38 mm in 200 ticks, closes on it a little, and is moved and tilted there.

    It is so gentle that nothing slips or jumps: two methods, or two runs of one, can be compared tick by tick. `ticks`
    are at least 300.
    """
    above = still((0.0, -0.045, 0.12), flexion=HALF)
    pressed = still((0.0, -0.045, 0.058), flexion=np.full((5, 3), 0.7))
    motion = above.hold(9).line(pressed, 190).hold(ticks - 200)
    time = np.linspace(0.0, 1.0, ticks - 200)[:, None]
    wave = np.sin(2.0 * np.pi * time * [1.0, 2.0, 3.0])
    motion.position[200:] += wave * [0.0015, 0.0015, 0.001]
    motion.orientation[200:] = quaternion_product(quaternion(wave[:, ::-1] * [0.015, 0.02, 0.015]), UPRIGHT)
    motion.flexion[200:] += 0.015 * wave[:, :1, None]
    return motion


def squeeze() -> HandConfiguration:
    """Return index and middle finger that close by abduction on what is between them, and open again, three times."""
    hand, ticks = right_hand(), 900
    motion = still(np.zeros(3), flexion=0.1, ticks=ticks)
    wave = 0.3 * np.sin(2.0 * np.pi * np.arange(ticks) / 300.0)[:, None]
    motion.abduction[:] = np.clip(wave * [1.0, -1.0, 1.0, 1.0, 1.0], hand.abduction_min, hand.abduction_max)
    return sequence(still((0.0, 0.0, 0.08), flexion=0.1).line(motion, 100), motion)


def shifted(pose: HandConfiguration, x: float, y: float, z: float) -> HandConfiguration:
    """Return the motion with its palm moved by (x, y, z) [m]."""
    return pose._replace(position=pose.position + np.array([x, y, z]))


def joints_at_origin(flexion: ArrayLike, orientation: ArrayLike = UPRIGHT) -> FloatArray:
    """Return the joints [m] of the hand whose palm is at the origin, shape (5, 4, 3)."""
    return right_hand().joints(np.zeros(3), orientation, flexion, np.zeros(5))


def tip_at(
    point: ArrayLike, orientation: ArrayLike = UPRIGHT, flexion: ArrayLike = POINTING, finger: int = INDEX
) -> FloatArray:
    """Return the palm position [m] that puts a fingertip's centre at `point` [m], shapes (3,)."""
    return np.asarray(np.asarray(point) - joints_at_origin(flexion, orientation)[finger, 3], np.float64)


def poke() -> HandConfiguration:
    """Return an index finger that is pushed along y through the origin and held 30 mm behind it."""
    tip = still(tip_at(np.zeros(3)), flexion=POINTING)
    return shifted(tip, 0.0, -0.05, 0.0).hold(4).line(shifted(tip, 0.0, 0.03, 0.0), 100).hold(100)


def crossings(points: FloatArray, radius: float) -> int:
    """Return how often a point of a hand goes through a disc in the plane z = 0 from one tick to the next.

    Points [m] have shape (T, n, 3). The radius of the disc about the origin [m] is less than the object's, so that the
    way around its rim does not count.
    """
    before, after = points[:-1], points[1:]
    with np.errstate(invalid="ignore", divide="ignore"):
        share = before[..., 2] / (before[..., 2] - after[..., 2])
        where = before[..., :2] + share[..., None] * (after[..., :2] - before[..., :2])
        through = (before[..., 2] * after[..., 2] < 0.0) & (np.linalg.norm(where, axis=-1) < radius)
    return int(through.sum())


def threaded(joints: FloatArray, center: FloatArray, axis: FloatArray, radius: float) -> BoolArray:
    """Return the ticks at which a finger's centre line goes through a ring, shape (T,).

    Joints [m] have shape (T, 4, 3), the ring's centre [m] and unit axis (3,); `radius` [m] is its profile's middle.
    """
    height = (joints - center) @ axis
    before, after = height[:, :-1], height[:, 1:]
    with np.errstate(invalid="ignore", divide="ignore"):
        share = before / (before - after)
        where = joints[:, :-1] + share[..., None] * (joints[:, 1:] - joints[:, :-1]) - center
        inside = (before * after <= 0.0) & (np.linalg.norm(where, axis=-1) < radius)
    return np.asarray(inside.sum(axis=1) % 2 == 1)


def largest_step(points: ArrayLike) -> float:
    """Return the largest way of a point from one tick to the next [m]; points of shape (T, ..., 3)."""
    return float(np.linalg.norm(np.diff(points, axis=0), axis=-1).max())
