"""Pairs of a robot's links whose spheres touch whatever the joints do: what a planner has to ignore."""

from collections.abc import Mapping
from itertools import combinations

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.linkage.robot import Robot
from hhsim.robots.poses import Poses, drawn_poses

POSES = 10_000
_FEW, _MOST_DISTANCES = 100, 2_000_000


def self_collision_ignore(robot: Robot, spheres: Mapping[str, FloatArray], seed: int = 0) -> dict[str, list[str]]:
    """Return for links those further down the file that need not be compared: adjacent ones, and what always touches.

    Adjacent are links that a joint connects, or joints in a row with nothing but links without spheres between them.
    Always is in each of `POSES` poses, drawn evenly within the limits of the joints. Links that hang on different roots
    have no place to each other.

    Args:
        robot: Links and joints.
        spheres: Centres and radii [m], shape (n, 4), of links by their name.
        seed: Seed of the poses.
    """
    pairs = adjacent_links(robot, spheres)
    poses = drawn_poses(robot, POSES, np.random.default_rng(seed))
    ignored: dict[str, list[str]] = {}
    names = [link.name for link in robot.links if link.name in spheres]
    above = {joint.child: joint.parent for joint in robot.joints}
    root: dict[str, str] = {}
    for link in robot.links:
        root[link.name] = root.get(above.get(link.name, ""), link.name)
    for one, other in combinations(names, 2):
        is_adjacent = frozenset((one, other)) in pairs
        if is_adjacent or (
            root[one] == root[other] and _always_touch((poses[one], spheres[one]), (poses[other], spheres[other]))
        ):
            ignored.setdefault(one, []).append(other)
    return ignored


def adjacent_links(robot: Robot, spheres: Mapping[str, FloatArray]) -> set[frozenset[str]]:
    """Return pairs of links with spheres that joints connect without another such link between them."""
    above = {joint.child: joint.parent for joint in robot.joints}
    found = set()
    for name in spheres:
        parent = above.get(name, "")
        while parent and parent not in spheres:
            parent = above.get(parent, "")
        if parent:
            found.add(frozenset((name, parent)))
    return found


def _always_touch(one: tuple[Poses, FloatArray], other: tuple[Poses, FloatArray]) -> bool:
    """Return True if links, given by poses and spheres, touch in each pose; most pairs are settled by a few poses."""
    ((turn, place), spheres), ((other_turn, other_place), other_spheres) = one, other
    step = max(1, _MOST_DISTANCES // (len(spheres) * len(other_spheres)))
    begin, count = 0, min(_FEW, step)
    while begin < len(place):
        part = slice(begin, begin + count)
        first = spheres[:, :3] @ turn[part].transpose(0, 2, 1) + place[part, None]
        second = other_spheres[:, :3] @ other_turn[part].transpose(0, 2, 1) + other_place[part, None]
        apart = np.linalg.norm(first[:, :, None] - second[:, None], axis=3) - spheres[:, 3, None] - other_spheres[:, 3]
        if (apart.min(axis=(1, 2)) > 0.0).any():
            return False
        begin, count = begin + count, step
    return True
