"""Objects made of spheres by formula: balls, leaves, walls, rings, moulds."""

import math
from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import FloatArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import rotation_matrix
from hhsim.mesh.mesh import Mesh
from hhsim.trees.hierarchy import build_hierarchy
from hhsim.trees.options import needed_level
from hhsim.trees.sphere_tree import SphereTree

BRANCHING = 8
BALL_RADIUS = 0.038
"""Radius of the ball that most scenes have [m]: a hand reaches around it."""


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
