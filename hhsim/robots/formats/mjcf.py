"""MJCF of MuJoCo: bodies and joints of the robot, its masses where they are known, and spheres for geoms."""

from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from hhsim.errors import InputError
from hhsim.hand.quaternion import quaternion_from_matrix
from hhsim.linkage.file import read_robot
from hhsim.linkage.linkage import WORLD, Inertial, LinkJoint
from hhsim.reproducible import matmul
from hhsim.robots.formats.registry import RobotFormat, Spheres
from hhsim.robots.numbers import digits, row
from hhsim.robots.robot_spheres import RobotSpheres

TYPES = {"hinge": "hinge", "slider": "slide"}


def write_mjcf(found: RobotSpheres) -> bytes:
    """Return the file; a planar joint is two slides and a hinge, a mimic an equality of joints."""
    children: dict[str, list[LinkJoint]] = {}
    for joint in found.robot.joints:
        children.setdefault(joint.parent, []).append(joint)
    lines = [
        f"<mujoco model={quoteattr(found.robot.name)}>",
        '  <compiler angle="radian" boundmass="0.001" boundinertia="0.000001" balanceinertia="true"/>',
        "  <worldbody>",
    ]
    roots = {link.name for link in found.robot.links} - {joint.child for joint in found.robot.joints}
    inertials = {link.name: link.inertial for link in found.robot.links}

    def body(name: str, joint: LinkJoint | None, depth: int) -> None:
        indent = "  " * depth
        place = "" if joint is None else _place(joint)
        lines.append(f"{indent}<body name={quoteattr(name)}{place}>")
        lines.extend(f"{indent}  {element}" for element in ([] if joint is None else _joints(joint)))
        inertial = inertials.get(name)
        if inertial is not None and inertial.inertia is not None:
            lines.append(f"{indent}  {_inertial(inertial)}")
        for *center, radius in found.spheres.get(name, np.empty((0, 4))).tolist():
            lines.append(f'{indent}  <geom type="sphere" pos="{row(center)}" size="{digits(radius)}"/>')
        for child in children.get(name, []):
            body(child.child, child, depth + 1)
        lines.append(f"{indent}</body>")

    for root in (link.name for link in found.robot.links if link.name in roots):
        if root == WORLD:
            for child in children.get(root, []):
                body(child.child, child, 2)
        else:
            body(root, None, 2)
    lines.append("  </worldbody>")
    excluded = [(one, other) for one, others in found.ignored.items() for other in others]
    if excluded:
        pairs = (f"    <exclude body1={quoteattr(one)} body2={quoteattr(other)}/>" for one, other in excluded)
        lines += ["  <contact>", *pairs, "  </contact>"]
    follow = [joint for joint in found.robot.joints if joint.mimic is not None]
    if follow:
        lines.append("  <equality>")
        for joint in follow:
            leader, factor, offset = joint.mimic or ("", 1.0, 0.0)
            words = f"joint1={quoteattr(joint.name)} joint2={quoteattr(leader)}"
            lines.append(f'    <joint {words} polycoef="{row([offset, factor, 0.0, 0.0, 0.0])}"/>')
        lines.append("  </equality>")
    return "\n".join([*lines, "</mujoco>", ""]).encode()


def _place(joint: LinkJoint) -> str:
    turn = quaternion_from_matrix(joint.frame.rotation)
    return f' pos="{row(joint.frame.position)}" quat="{row(turn)}"'


def _joints(joint: LinkJoint) -> list[str]:
    """Return the elements of a joint, in the frame of its child."""
    back = joint.frame.inverse()
    axis, origin = matmul(back.rotation, joint.axis), back.points(joint.origin)
    name = quoteattr(joint.name)
    if joint.type == "fixed":
        return []
    if joint.type == "planar":
        across = np.linalg.svd(axis[None])[2][1:]
        moves = [
            f'<joint name={quoteattr(f"{joint.name}_{k}")} type="slide" axis="{row(along)}"/>'
            for k, along in enumerate(across)
        ]
        return [*moves, f'<joint name={name} type="hinge" axis="{row(axis)}"/>']
    if joint.type == "ball":
        return [f'<joint name={name} type="ball" pos="{row(origin)}"/>']
    if joint.type == "free":
        # MuJoCo has free joints on the world alone.
        return [f"<freejoint name={name}/>"] if joint.parent == WORLD else []
    limits = "" if joint.limits is None else f' range="{row(joint.limits)}"'
    return [f'<joint name={name} type="{TYPES[joint.type]}" pos="{row(origin)}" axis="{row(axis)}"{limits}/>']


def _inertial(inertial: Inertial) -> str:
    full = np.asarray(inertial.inertia)
    moments = [full[0, 0], full[1, 1], full[2, 2], full[0, 1], full[0, 2], full[1, 2]]
    center = np.zeros(3) if inertial.center is None else inertial.center
    return f'<inertial pos="{row(center)}" mass="{digits(inertial.mass)}" fullinertia="{row(moments)}"/>'


def read_mjcf_spheres(path: Path) -> Spheres:
    """Read the spheres of each body; a body with other geoms that collide too is an InputError."""
    found = {}
    for link in read_robot(path).solid:
        if link.balls is None:
            raise InputError(f"body '{link.name}' has other shapes than spheres; expected spheres alone")
        found[link.name] = link.balls
    return found


FORMAT = RobotFormat((".xml", ".mjcf"), b"<mujoco", write_mjcf, read_mjcf_spheres)
