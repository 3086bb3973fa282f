"""Pairs of a robot's links whose spheres touch whatever the joints do: what a planner has to ignore."""

from collections.abc import Mapping
from itertools import combinations

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.hand.quaternion import quaternion, rotation_matrix
from hhsim.linkage.linkage import LinkJoint
from hhsim.linkage.robot import Robot

POSES = 10_000
LOOSE = 1.0
"""Reach [m] of a joint that moves freely, and of a slider without limits, to each side."""
_FEW, _MOST_DISTANCES = 100, 2_000_000

Poses = tuple[FloatArray, FloatArray]
"""Rotations (P, 3, 3) and positions (P, 3) [m] of a link in P poses of the robot, in the frame of its root."""


def self_collision_ignore(robot: Robot, spheres: Mapping[str, FloatArray], seed: int = 0) -> dict[str, list[str]]:
    """Return for links those further down the file that need not be compared: adjacent ones, and what always touches.

    Adjacent are links that a joint connects, or joints in a row with nothing but links without spheres between them.
    Always is in each of `POSES` poses, drawn evenly within the limits of the joints.

    Args:
        robot: Links and joints.
        spheres: Centres and radii [m], shape (n, 4), of links by their name.
        seed: Seed of the poses.
    """
    pairs = adjacent_links(robot, spheres)
    poses = link_poses(robot, POSES, np.random.default_rng(seed))
    ignored: dict[str, list[str]] = {}
    names = [link.name for link in robot.links if link.name in spheres]
    for one, other in combinations(names, 2):
        if frozenset((one, other)) in pairs or _always_touch(
            (poses[one], spheres[one]), (poses[other], spheres[other])
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


def link_poses(robot: Robot, count: int, rng: np.random.Generator) -> dict[str, Poses]:
    """Draw poses, and return those of every link by its name; a joint that mimics follows its leader."""
    values: dict[str, FloatArray] = {}
    for joint in robot.joints:
        least, most = joint.limits or ((-np.pi, np.pi) if joint.type == "hinge" else (-LOOSE, LOOSE))
        values[joint.name] = rng.uniform(least, most, count)
    known = {joint.name: joint for joint in robot.joints}
    for joint in robot.joints:
        factor, offset, leader = 1.0, 0.0, joint
        while leader.mimic is not None:
            factor, offset = factor * leader.mimic.factor, offset + factor * leader.mimic.offset
            leader = known[leader.mimic.leader]
        if joint.mimic is not None:
            values[joint.name] = factor * values[leader.name] + offset
    parent_joint = {joint.child: joint for joint in robot.joints}
    here = np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3))
    found: dict[str, Poses] = {"": here}
    for link in robot.links:
        joint_of = parent_joint.get(link.name)
        found[link.name] = here if joint_of is None else _moved(found[joint_of.parent], joint_of, values, rng)
    return found


def _moved(parent: Poses, joint: LinkJoint, values: Mapping[str, FloatArray], rng: np.random.Generator) -> Poses:
    """Return the poses of a joint's child."""
    turn, place = (
        np.broadcast_to(joint.frame.rotation, parent[0].shape),
        np.tile(joint.frame.position, (len(parent[1]), 1)),
    )
    value, count = values[joint.name], len(parent[1])
    if joint.type in ("hinge", "planar", "free", "ball"):
        spin = quaternion(value[:, None] * joint.axis)
        if joint.type in ("free", "ball"):
            spin = rng.normal(size=(count, 4))
            spin /= np.linalg.norm(spin, axis=1, keepdims=True)
        rotation = rotation_matrix(spin)
        place = joint.origin + np.einsum("pij,pj->pi", rotation, place - joint.origin)
        turn = rotation @ turn
    if joint.type == "slider":
        place = place + value[:, None] * joint.axis
    elif joint.type in ("planar", "free"):
        shift = rng.uniform(-LOOSE, LOOSE, (count, 3))
        if joint.type == "planar":
            shift -= (shift @ joint.axis)[:, None] * joint.axis
        place = place + shift
    return parent[0] @ turn, parent[1] + np.einsum("pij,pj->pi", parent[0], place)


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
