"""Poses of a robot's links at values of its joints."""

from collections.abc import Mapping

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.hand.quaternion import quaternion, rotation_matrix
from hhsim.linkage.linkage import LinkJoint, Robot

LOOSE = 1.0
"""Reach [m] of a joint that moves freely, and of a slider without limits, to each side."""

Poses = tuple[FloatArray, FloatArray]
"""Rotations (P, 3, 3) and positions (P, 3) [m] of a link in P poses of the robot, in the frame of its root."""


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
