"""Extended Robot Description Format 1.0, of cuMotion and Isaac Sim (nvidia-isaac-ros.github.io)."""

from pathlib import Path

from hhsim.errors import InputError
from hhsim.robots.formats.curobo import (
    ACCELERATION,
    JERK,
    ignore_lines,
    links_of,
    load_yaml,
    require_urdf,
    spheres_lines,
    start_values,
)
from hhsim.robots.formats.registry import RobotFormat, Spheres
from hhsim.robots.numbers import digits, row, word
from hhsim.robots.robot_spheres import RobotSpheres

GEOMETRY = "hhsim_spheres"


def write_xrdf(found: RobotSpheres) -> bytes:
    """Return the file; InputError for a robot that is no URDF, which an XRDF supplements."""
    require_urdf(found, "XRDF")
    starts = start_values(found)
    joints = [f"    - {word(name)}" for name in starts]
    lines = [
        "format: xrdf",
        "format_version: 1.0",
        "modifiers:",
        f"  - set_base_frame: {word(found.robot.links[0].name)}",
        "default_joint_positions:" if starts else "default_joint_positions: {}",
        *(f"  {word(name)}: {digits(value)}" for name, value in starts.items()),
        "cspace:",
        "  joint_names:" if joints else "  joint_names: []",
        *joints,
        f"  acceleration_limits: [{row([ACCELERATION] * len(starts), ', ')}]",
        f"  jerk_limits: [{row([JERK] * len(starts), ', ')}]",
        f"tool_frames: [{', '.join(map(word, found.ends))}]",
        "collision:",
        f"  geometry: {GEOMETRY}",
        "self_collision:",
        f"  geometry: {GEOMETRY}",
        "  ignore:" if found.ignored else "  ignore: {}",
        *ignore_lines(found.ignored, "    "),
        "geometry:",
        f"  {GEOMETRY}:",
        "    spheres:",
        *spheres_lines(found.spheres, "      "),
    ]
    return ("\n".join(lines) + "\n").encode()


def read_xrdf(path: Path) -> Spheres:
    """Read the spheres that the file says are for collision, or the only ones."""
    document = load_yaml(path)
    groups = document.get("geometry") if isinstance(document, dict) else None
    if not isinstance(groups, dict) or not groups:
        raise InputError("no geometry; expected geometry: {NAME: {spheres: {LINK: [{center, radius}, …]}}}")
    collision = document.get("collision")
    name = collision.get("geometry") if isinstance(collision, dict) else next(iter(groups))
    group = groups.get(name)
    if not isinstance(group, dict):
        raise InputError(f"its collision geometry is '{name}', which it does not have")
    return links_of(group.get("spheres"))


FORMAT = RobotFormat((".xrdf",), b"xrdf", write_xrdf, read_xrdf)
