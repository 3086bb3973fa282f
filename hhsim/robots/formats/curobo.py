"""YAML of cuRobo, format version 2.0: `robot_cfg: kinematics:` with `collision_spheres` (NVlabs/curobo).

Joint weights, acceleration and jerk are cuRobo's usual values: no URDF states them.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from hhsim.arrays import FloatArray
from hhsim.errors import InputError
from hhsim.robots.formats.registry import RobotFormat, Spheres
from hhsim.robots.numbers import checked_spheres, digits, row, word
from hhsim.robots.robot_spheres import RobotSpheres
from hhsim.robots.touching_pairs import Ignored
from hhsim.system.input_file import read_input_text

ACCELERATION, JERK = 15.0, 500.0
"""Usual largest acceleration [rad/s² or m/s²] and jerk [rad/s³ or m/s³] of cuRobo's robots."""
MOST_BYTES = 32 << 20


def write_curobo(found: RobotSpheres) -> bytes:
    """Return the file; InputError for a robot that is no URDF, which cuRobo needs."""
    require_urdf(found, "cuRobo")
    names = [link.name for link in found.links]
    starts = start_values(found)
    lines = [
        "robot_cfg:",
        "  kinematics:",
        "    format_version: 2.0",
        f"    urdf_path: {word(str(found.source.resolve()))}",
        f"    asset_root_path: {word(str(found.source.resolve().parent))}",
        f"    base_link: {word(found.robot.links[0].name)}",
        f"    tool_frames: {_flow(found.ends)}",
        f"    collision_link_names: {_flow(names)}",
        f"    mesh_link_names: {_flow(names)}",
        "    collision_sphere_buffer: 0.0",
        "    collision_spheres:",
        *spheres_lines(found.spheres, "      "),
        f"    self_collision_buffer: {{{', '.join(f'{word(name)}: 0.0' for name in names)}}}",
        "    self_collision_ignore:" if found.ignored else "    self_collision_ignore: {}",
        *ignore_lines(found.ignored, "      "),
        "    cspace:",
        f"      joint_names: {_flow(list(starts))}",
        f"      default_joint_position: [{row(starts.values(), ', ')}]",
        f"      cspace_distance_weight: [{row([1.0] * len(starts), ', ')}]",
        f"      null_space_weight: [{row([1.0] * len(starts), ', ')}]",
        f"      max_acceleration: {digits(ACCELERATION)}",
        f"      max_jerk: {digits(JERK)}",
    ]
    return ("\n".join(lines) + "\n").encode()


def require_urdf(found: RobotSpheres, reader: str) -> None:
    """Raise InputError unless the robot's file is a URDF."""
    if found.source.suffix.lower() != ".urdf":
        raise InputError(f"{reader} reads the joints from a URDF, and {found.source.name} is none; expected --as mjcf")


def start_values(found: RobotSpheres) -> dict[str, float]:
    """Return of each joint that moves by itself the value nearest to 0 within its limits [rad] or [m]."""
    starts = {joint.name: joint.start for joint in found.robot.joints}
    return {name: starts[name] for name in found.moving}


def spheres_lines(spheres: Mapping[str, FloatArray], indent: str) -> list[str]:
    """Return the lines of a mapping from links to spheres, as cuRobo and XRDF have it."""
    lines = []
    for name, each in spheres.items():
        lines.append(f"{indent}{word(name)}:")
        for *center, radius in each.tolist():
            lines += [f"{indent}- center: [{row(center, ', ')}]", f"{indent}  radius: {digits(radius)}"]
    return lines


def ignore_lines(ignored: Ignored, indent: str) -> list[str]:
    """Return the lines of a mapping from links to links that are not compared with them."""
    return [f"{indent}{word(name)}: {_flow(list(others))}" for name, others in ignored.items()]


def _flow(names: Sequence[str]) -> str:
    return f"[{', '.join(map(word, names))}]"


def read_curobo(path: Path) -> Spheres:
    """Read the spheres of a robot's configuration, or of a file of `collision_spheres` alone."""
    document = load_yaml(path)
    for key in ("robot_cfg", "kinematics", "collision_spheres"):
        document = document.get(key, document) if isinstance(document, dict) else document
    if isinstance(document, str):
        raise InputError(f"its collision_spheres are in '{document}': name that file")
    return links_of(document)


def links_of(document: Any) -> Spheres:
    """Return the spheres of a mapping from links to lists of `center` and `radius`; InputError for anything else."""
    if not isinstance(document, dict) or not all(isinstance(each, list) for each in document.values()):
        raise InputError("no spheres; expected collision_spheres: {LINK: [{center: [x, y, z], radius: r}, …]}")
    found = {}
    for name, rows in document.items():
        pairs = [(each.get("center"), each.get("radius")) if isinstance(each, dict) else (each, None) for each in rows]
        spheres = checked_spheres(pairs, str(name))
        if len(spheres):
            found[str(name)] = spheres
    return found


def load_yaml(path: Path) -> Any:
    """Read a document of YAML; InputError if it is none, or without the package."""
    try:
        import yaml
    except ImportError:
        raise InputError("YAML is read by PyYAML, which is not installed: pip install 'hhsim[yaml]'") from None
    try:
        return yaml.load(read_input_text(path, most=MOST_BYTES), getattr(yaml, "CSafeLoader", yaml.SafeLoader))
    except (yaml.YAMLError, UnicodeDecodeError, RecursionError, ValueError) as error:
        raise InputError(f"no YAML: {' '.join(str(error).split())[:200]}") from None


FORMAT = RobotFormat((".yml", ".yaml"), b"collision_spheres", write_curobo, read_curobo)
