"""Pairs of a robot's links whose spheres touch: what a planner has to ignore, and what it then still finds."""

from collections.abc import Mapping
from itertools import combinations
from typing import NamedTuple

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.hand.quaternion import quaternion, rotation_matrix
from hhsim.linkage.linkage import LinkJoint, Robot

POSES = 10_000
KINDS = ("always", "default", "adjacent")
"""What is ignored: adjacent links and those that touch in every pose; those of the start pose too; adjacent ones."""
OFTEN = 0.5
_FEW, _MOST_DISTANCES = 100, 2_000_000
LOOSE = 1.0
"""Reach [m] of a joint that moves freely, and of a slider without limits, to each side."""

Poses = tuple[FloatArray, FloatArray]
"""Rotations (P, 3, 3) and positions (P, 3) [m] of a link in P poses of the robot, in the frame of its root."""

Ignored = dict[str, dict[str, str]]
"""For links those further down the file that need not be compared, and why, in the words of an SRDF."""


class Touching(NamedTuple):
    """Two links that are compared although their spheres touch in the start pose, or in most poses."""

    one: str
    other: str
    depth: float  # largest depth of a sphere in another one in the start pose [m]; negative where all are apart
    share: float  # share of some drawn poses in which they touch


def touching_pairs(
    robot: Robot, spheres: Mapping[str, FloatArray], seed: int = 0, kind: str = "always"
) -> tuple[Ignored, tuple[Touching, ...]]:
    """Return the pairs of links that a planner is to ignore, and those that are left and touch nevertheless.

    Adjacent are links that a joint connects, or joints in a row with nothing but links without spheres between them.
    Always is in each of `POSES` poses, drawn evenly within the limits of the joints, and default in the start pose.

    Args:
        robot: Links and joints.
        spheres: Centres and radii [m], shape (n, 4), of links by their name.
        seed: Seed of the poses.
        kind: One of `KINDS`.
    """
    adjacent, start = adjacent_links(robot, spheres), start_poses(robot)
    poses = drawn_poses(robot, POSES, np.random.default_rng(seed))
    ignored: Ignored = {}
    left = []
    for one, other in combinations([link.name for link in robot.links if link.name in spheres], 2):
        if frozenset((one, other)) in adjacent:
            ignored.setdefault(one, {})[other] = "Adjacent"
            continue
        drawn = (poses[one], spheres[one]), (poses[other], spheres[other])
        depth = float(_depths((start[one], spheres[one]), (start[other], spheres[other]), slice(None))[0])
        share = float((_depths(*drawn, slice(0, _FEW)) >= 0.0).mean())
        if kind != "adjacent" and share == 1.0 and _always_touch(*drawn):
            ignored.setdefault(one, {})[other] = "Always"
        elif kind == "default" and depth >= 0.0:
            ignored.setdefault(one, {})[other] = "Default"
        elif depth > 0.0 or share > OFTEN:
            left.append(Touching(one, other, depth, share))
    return ignored, tuple(sorted(left, key=lambda pair: -pair.depth))


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
    """Return True if links, given by poses and spheres, touch in each pose."""
    step = max(1, _MOST_DISTANCES // (len(one[1]) * len(other[1])))
    parts = (slice(begin, begin + step) for begin in range(0, len(one[0][1]), step))
    return all((_depths(one, other, part) >= 0.0).all() for part in parts)


def _depths(one: tuple[Poses, FloatArray], other: tuple[Poses, FloatArray], part: slice) -> FloatArray:
    """Return the largest depth of a sphere of a link in one of another link [m] in some poses, negative apart."""
    ((turn, place), spheres), ((other_turn, other_place), other_spheres) = one, other
    first = spheres[:, :3] @ turn[part].transpose(0, 2, 1) + place[part, None]
    second = other_spheres[:, :3] @ other_turn[part].transpose(0, 2, 1) + other_place[part, None]
    apart = np.linalg.norm(first[:, :, None] - second[:, None], axis=3) - spheres[:, 3, None] - other_spheres[:, 3]
    return np.asarray(-apart.min(axis=(1, 2)))


def start_poses(robot: Robot) -> dict[str, Poses]:
    """Return the pose of each link, by its name, where every joint is at the value nearest to 0 within its limits."""
    return link_poses(robot, {joint.name: np.array([joint.start]) for joint in robot.joints}, None)


def drawn_poses(robot: Robot, count: int, rng: np.random.Generator) -> dict[str, Poses]:
    """Draw poses evenly within the limits of the joints, and return those of each link by its name."""
    values = {}
    for joint in robot.joints:
        least, most = joint.limits or ((-np.pi, np.pi) if joint.type == "hinge" else (-LOOSE, LOOSE))
        values[joint.name] = rng.uniform(least, most, count)
    return link_poses(robot, values, rng)


def link_poses(robot: Robot, values: Mapping[str, FloatArray], rng: np.random.Generator | None) -> dict[str, Poses]:
    """Return the poses of each link by its name; a joint that mimics follows its leader.

    Args:
        robot: Links and joints.
        values: Value [rad] or [m] of each joint in P poses, shape (P,), by its name.
        rng: Draws the moves of joints without a single value; None leaves those where they are.
    """
    known = {joint.name: joint for joint in robot.joints}
    parent_joint = {joint.child: joint for joint in robot.joints}
    count = max((len(each) for each in values.values()), default=1)
    here = np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3))
    found: dict[str, Poses] = {"": here}
    for link in robot.links:
        joint = parent_joint.get(link.name)
        if joint is None:
            found[link.name] = here
            continue
        factor, offset, leader = 1.0, 0.0, joint
        while leader.mimic is not None:
            factor, offset = factor * leader.mimic.factor, offset + factor * leader.mimic.offset
            leader = known[leader.mimic.leader]
        turn, place = _moved(joint, factor * values[leader.name] + offset, rng)
        above, origin = found[joint.parent]
        found[link.name] = above @ turn, origin + np.einsum("pij,pj->pi", above, place)
    return found


def _moved(joint: LinkJoint, value: FloatArray, rng: np.random.Generator | None) -> Poses:
    """Return the poses of a joint's child in the frame of its parent."""
    count = len(value)
    turn, place = np.tile(joint.frame.rotation, (count, 1, 1)), np.tile(joint.frame.position, (count, 1))
    if joint.type == "slider":
        return turn, place + value[:, None] * joint.axis
    if joint.type == "fixed" or (joint.type != "hinge" and rng is None):
        return turn, place
    spin = quaternion(value[:, None] * joint.axis)
    if rng is not None and joint.type in ("free", "ball"):
        spin = rng.normal(size=(count, 4))
        spin /= np.linalg.norm(spin, axis=1, keepdims=True)
    rotation = rotation_matrix(spin)
    place = joint.origin + np.einsum("pij,pj->pi", rotation, place - joint.origin)
    if rng is not None and joint.type in ("planar", "free"):
        shift = rng.uniform(-LOOSE, LOOSE, (count, 3))
        along = (shift @ joint.axis)[:, None] * joint.axis if joint.type == "planar" else 0.0
        place = place + shift - along
    return rotation @ turn, place
