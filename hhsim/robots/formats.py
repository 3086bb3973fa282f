"""Formats of the spheres of a robot's links: what writes each file, and what reads its spheres back.

- `h5`: the sphere tree of each link, with its proof, in a group of the link's name.
- `urdf`: the robot's file with spheres in place of its `<collision>` elements.
- `curobo`: YAML of cuRobo, format version 2.0, `robot_cfg: kinematics:` with `collision_spheres` (NVlabs/curobo).
- `json`: JSON of foam (CoMMALab/foam): spheres of each link, and the mean, least and largest of their errors.
- `mjcf`: bodies and joints of the robot for MuJoCo, its masses where they are known, and spheres for geoms.
- `srdf`: Semantic Robot Description Format of MoveIt: `link_sphere_approximation`, and links whose collisions are
  disabled.
- `xrdf`: Extended Robot Description Format 1.0, of cuMotion and Isaac Sim (nvidia-isaac-ros.github.io).
"""

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.sax.saxutils import quoteattr

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import InputError
from hhsim.hand.quaternion import quaternion_from_matrix
from hhsim.kernels.mesh.bvh import mesh_signed_distance
from hhsim.linkage.file import MOST_BYTES, read_robot, read_xml
from hhsim.linkage.linkage import WORLD, LinkJoint, Robot
from hhsim.mesh.signed_bvh import signed_bvh
from hhsim.reproducible import matmul
from hhsim.robots.link_spheres import LinkSpheres
from hhsim.robots.touching_pairs import Ignored
from hhsim.system.input_file import read_input_text
from hhsim.trees.file import load_trees, trees_file

LARGEST = 1000.0
"""Largest coordinate or radius [m]: beyond it the file has another unit, or is damaged."""
ACCELERATION, JERK = 15.0, 500.0
"""Usual largest acceleration [rad/s² or m/s²] and jerk [rad/s³ or m/s³] of cuRobo's robots: no URDF states them."""
GEOMETRY = "hhsim_spheres"
"""Name of the spheres in an XRDF."""

Spheres = dict[str, FloatArray]
"""Centres and radii [m], shape (n, 4), of each link in its frame, by its name."""


@dataclass(frozen=True, eq=False)
class RobotSpheres:
    """A robot, its file, the spheres of its links, and the pairs of links that a planner has to ignore."""

    robot: Robot
    source: Path  # the URDF or MJCF
    links: tuple[LinkSpheres, ...]
    ignored: Ignored

    @property
    def spheres(self) -> Spheres:
        """Centres and radii [m], shape (n, 4), of each link in its frame, by its name."""
        return {link.name: link.spheres for link in self.links}

    @property
    def starts(self) -> dict[str, float]:
        """Value nearest to 0 within its limits [rad] or [m] of each joint that moves by itself, by its name."""
        joints = self.robot.joints
        return {each.name: each.start for each in joints if each.type in ("hinge", "slider") and each.mimic is None}

    @property
    def ends(self) -> list[str]:
        """Names of the links at the ends of chains: what a robot's tool hangs on."""
        parents = {joint.parent for joint in self.robot.joints}
        return [link.name for link in self.robot.links if link.name not in parents]


@dataclass(frozen=True)
class RobotFormat:
    """A kind of file that holds the spheres of a robot's links."""

    suffixes: tuple[str, ...]  # the first one is that of a file that is named by hhsim
    mark: bytes  # stands in every such file
    write: Callable[[RobotSpheres], bytes]  # InputError where the format cannot hold the robot
    read: Callable[[Path], Spheres]  # InputError names what is wrong


def format_of(path: Path) -> str:
    """Return the name of the format of a file by its suffix; "" for none of them."""
    return next((name for name, format_ in FORMATS.items() if path.suffix.lower() in format_.suffixes), "")


def read_spheres(path: Path) -> Spheres:
    """Read the spheres of each link from a file of any format; InputError for one that has none."""
    name = format_of(path)
    if not name:
        known = [suffix for each in FORMATS.values() for suffix in each.suffixes]
        raise InputError(f"{path}: expected spheres of links, a file that ends in {', '.join(known)}")
    try:
        found = FORMATS[name].read(path)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror or error}; expected spheres of links") from None
    except InputError as error:
        raise InputError(f"{path}: {str(error).removeprefix(f'{path}: ')}") from None
    if not found:
        raise InputError(f"{path}: no link has spheres")
    return found


def checked_spheres(rows: Iterable[tuple[Any, Any]], link: str) -> FloatArray:
    """Return spheres of a file, pairs of centre and radius, as an array (n, 4) [m].

    Spheres whose radius is not positive are unused, as in cuRobo's files; InputError for what are no numbers.
    """
    found = []
    for center, radius in rows:
        try:
            values = np.array([*center, radius], np.float64)
        except (TypeError, ValueError):
            values = np.full(4, np.nan)
        if values.shape != (4,) or not (np.abs(values) <= LARGEST).all():
            raise InputError(
                f"link '{link}': a sphere of centre {center}, radius {radius}; expected numbers, in metres"
            )
        if values[3] > 0.0:
            found.append(values)
    return np.array(found).reshape(-1, 4)


def require_urdf(found: RobotSpheres, reader: str) -> None:
    """Raise InputError unless the robot's file is a URDF."""
    if found.source.suffix.lower() != ".urdf":
        raise InputError(f"{reader} reads the joints from a URDF, and {found.source.name} is none; expected --as mjcf")


def digits(value: float) -> str:
    """Return the shortest text that is this number, never with an exponent, which YAML 1.1 takes for a word."""
    return np.format_float_positional(float(value), trim="0")


def _row(values: Iterable[float], between: str = " ") -> str:
    return between.join(map(digits, values))


def _flow(names: Sequence[str]) -> str:
    """Return a list of words in quotation marks, as JSON and YAML read it."""
    return f"[{', '.join(map(json.dumps, names))}]"


def write_h5(found: RobotSpheres) -> bytes:
    """Return the file; InputError for a link whose name no group can have."""
    for link in found.links:
        if "/" in link.name or link.name == ".":
            raise InputError(f"link '{link.name}': no name for a group of an HDF5 file; expected another format (--as)")
    return trees_file({link.name: link.tree for link in found.links})


def read_h5(path: Path) -> Spheres:
    """Read the leaves of each link's tree; those of a file of one tree are of no name."""
    return {name: np.column_stack([tree.leaf_center, tree.leaf_radius]) for name, tree in load_trees(path).items()}


def write_json(found: RobotSpheres) -> bytes:
    """Return the file; the error of a sphere is its proved bound [m]."""
    document = {}
    for link in found.links:
        bounds = link.tree.leaf_radius + mesh_signed_distance(signed_bvh(link.mesh), link.tree.leaf_center)
        document[link.name] = {
            "mean": float(bounds.mean()),
            "best": float(bounds.min()),
            "worst": float(bounds.max()),
            "spheres": [{"origin": center, "radius": radius} for *center, radius in link.spheres.tolist()],
        }
    return (json.dumps(document, indent=1) + "\n").encode()


def read_json(path: Path) -> Spheres:
    """Read the spheres of each link, or of the one mesh of a file of foam's, by the file's name."""
    try:
        document = json.loads(read_input_text(path))
    except (ValueError, RecursionError) as error:
        raise InputError(f"no JSON: {error}") from None
    if not isinstance(document, dict):
        raise InputError("no spheres; expected {LINK: {spheres: [{origin: [x, y, z], radius: r}, …]}}")
    found = {}
    for name, each in ({path.stem: document} if "spheres" in document else document).items():
        rows = each.get("spheres") if isinstance(each, dict) else None
        if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
            raise InputError(f"'{name}' has no spheres; expected spheres: [{{origin: [x, y, z], radius: r}}, …]")
        found[name] = checked_spheres([(row.get("origin"), row.get("radius")) for row in rows], name)
    return found


def write_curobo(found: RobotSpheres) -> bytes:
    """Return the file; InputError for a robot that is no URDF, which cuRobo needs."""
    require_urdf(found, "cuRobo")
    names, starts = [link.name for link in found.links], found.starts
    lines = [
        "robot_cfg:",
        "  kinematics:",
        "    format_version: 2.0",
        f"    urdf_path: {json.dumps(str(found.source.resolve()))}",
        f"    asset_root_path: {json.dumps(str(found.source.resolve().parent))}",
        f"    base_link: {json.dumps(found.robot.links[0].name)}",
        f"    tool_frames: {_flow(found.ends)}",
        f"    collision_link_names: {_flow(names)}",
        f"    mesh_link_names: {_flow(names)}",
        "    collision_sphere_buffer: 0.0",
        "    collision_spheres:",
        *_sphere_lines(found.spheres),
        f"    self_collision_buffer: {{{', '.join(f'{json.dumps(name)}: 0.0' for name in names)}}}",
        "    self_collision_ignore:" if found.ignored else "    self_collision_ignore: {}",
        *(f"      {json.dumps(name)}: {_flow(list(others))}" for name, others in found.ignored.items()),
        "    cspace:",
        f"      joint_names: {_flow(list(starts))}",
        f"      default_joint_position: [{_row(starts.values(), ', ')}]",
        f"      cspace_distance_weight: [{_row([1.0] * len(starts), ', ')}]",
        f"      null_space_weight: [{_row([1.0] * len(starts), ', ')}]",
        f"      max_acceleration: {digits(ACCELERATION)}",
        f"      max_jerk: {digits(JERK)}",
    ]
    return ("\n".join(lines) + "\n").encode()


def write_xrdf(found: RobotSpheres) -> bytes:
    """Return the file; InputError for a robot that is no URDF, which an XRDF supplements."""
    require_urdf(found, "XRDF")
    starts = found.starts
    lines = [
        "format: xrdf",
        "format_version: 1.0",
        "modifiers:",
        f"  - set_base_frame: {json.dumps(found.robot.links[0].name)}",
        "default_joint_positions:" if starts else "default_joint_positions: {}",
        *(f"  {json.dumps(name)}: {digits(value)}" for name, value in starts.items()),
        "cspace:",
        "  joint_names:" if starts else "  joint_names: []",
        *(f"    - {json.dumps(name)}" for name in starts),
        f"  acceleration_limits: [{_row([ACCELERATION] * len(starts), ', ')}]",
        f"  jerk_limits: [{_row([JERK] * len(starts), ', ')}]",
        f"tool_frames: {_flow(found.ends)}",
        "collision:",
        f"  geometry: {GEOMETRY}",
        "self_collision:",
        f"  geometry: {GEOMETRY}",
        "  ignore:" if found.ignored else "  ignore: {}",
        *(f"    {json.dumps(name)}: {_flow(list(others))}" for name, others in found.ignored.items()),
        "geometry:",
        f"  {GEOMETRY}:",
        "    spheres:",
        *_sphere_lines(found.spheres),
    ]
    return ("\n".join(lines) + "\n").encode()


def _sphere_lines(spheres: Mapping[str, FloatArray]) -> list[str]:
    """Return the lines of a mapping from links to spheres, as cuRobo and XRDF have it."""
    lines = []
    for name, each in spheres.items():
        lines.append(f"      {json.dumps(name)}:")
        for *center, radius in each.tolist():
            lines += [f"      - center: [{_row(center, ', ')}]", f"        radius: {digits(radius)}"]
    return lines


def read_curobo(path: Path) -> Spheres:
    """Read the spheres of a robot's configuration, or of a file of `collision_spheres` alone."""
    document = load_yaml(path)
    for key in ("robot_cfg", "kinematics", "collision_spheres"):
        document = document.get(key, document) if isinstance(document, dict) else document
    if isinstance(document, str):
        raise InputError(f"its collision_spheres are in '{document}': name that file")
    return _spheres_of(document)


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
    return _spheres_of(group.get("spheres"))


def _spheres_of(document: Any) -> Spheres:
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


def write_srdf(found: RobotSpheres) -> bytes:
    """Return the file."""
    lines = ['<?xml version="1.0"?>', f"<robot name={quoteattr(found.robot.name)}>"]
    for name, spheres in found.spheres.items():
        lines.append(f"  <link_sphere_approximation link={quoteattr(name)}>")
        lines += [
            f'    <sphere center="{_row(center)}" radius="{digits(radius)}"/>' for *center, radius in spheres.tolist()
        ]
        lines.append("  </link_sphere_approximation>")
    for one, others in found.ignored.items():
        for other, reason in others.items():
            lines.append(f'  <disable_collisions link1={quoteattr(one)} link2={quoteattr(other)} reason="{reason}"/>')
    return "\n".join([*lines, "</robot>", ""]).encode()


def read_srdf(path: Path) -> Spheres:
    """Read the spheres of each `link_sphere_approximation`."""
    found = {}
    for link in read_xml(path).findall("link_sphere_approximation"):
        name = link.get("link", "")
        rows = [(each.get("center", "").split(), each.get("radius")) for each in link.findall("sphere")]
        spheres = checked_spheres(rows, name)
        if len(spheres):
            found[name] = spheres
    return found


def write_urdf(found: RobotSpheres) -> bytes:
    """Return the robot's file with the spheres of each link at its end, in place of its collisions.

    Raises InputError for a robot that is no URDF.
    """
    require_urdf(found, "This format")
    root = read_xml(found.source, comments=True)
    for link in root.findall("link"):
        spheres = found.spheres.get(link.get("name", ""))
        if spheres is None:
            continue
        for old in link.findall("collision"):
            link.remove(old)
        for *center, radius in spheres.tolist():
            collision = ElementTree.SubElement(link, "collision")
            ElementTree.SubElement(collision, "origin", xyz=_row(center), rpy="0 0 0")
            geometry = ElementTree.SubElement(collision, "geometry")
            ElementTree.SubElement(geometry, "sphere", radius=digits(radius))
    ElementTree.indent(root)
    return f'<?xml version="1.0"?>\n{ElementTree.tostring(root, "unicode")}\n'.encode()


def read_urdf_spheres(path: Path) -> Spheres:
    """Read the spheres of the collisions of each link; a link with other shapes too is an InputError."""
    found = {}
    for link in read_xml(path).findall("link"):
        name, rows, others = link.get("name", ""), [], 0
        for collision in link.findall("collision"):
            sphere, origin = collision.find("geometry/sphere"), collision.find("origin")
            place = "0 0 0" if origin is None else origin.get("xyz", "0 0 0")
            others += sphere is None
            if sphere is not None:
                rows.append((place.split(), sphere.get("radius")))
        if rows and others:
            raise InputError(f"link '{name}' has spheres and {others} other shapes; expected spheres alone")
        if rows:
            found[name] = checked_spheres(rows, name)
    return found


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
    links, spheres = {link.name: link for link in found.robot.links}, found.spheres

    def body(name: str, joint: LinkJoint | None, depth: int) -> None:
        indent, place, moves = "  " * depth, "", list[str]()
        if joint is not None:
            turn = quaternion_from_matrix(joint.frame.rotation)
            place, moves = f' pos="{_row(joint.frame.position)}" quat="{_row(turn)}"', _mjcf_joints(joint)
        lines.append(f"{indent}<body name={quoteattr(name)}{place}>")
        lines.extend(f"{indent}  {element}" for element in moves)
        inertial = links[name].inertial
        if inertial is not None and inertial.inertia is not None:
            full, center = inertial.inertia, np.zeros(3) if inertial.center is None else inertial.center
            moments = [full[0, 0], full[1, 1], full[2, 2], full[0, 1], full[0, 2], full[1, 2]]
            words = f'pos="{_row(center)}" mass="{digits(inertial.mass)}" fullinertia="{_row(moments)}"'
            lines.append(f"{indent}  <inertial {words}/>")
        for *center, radius in spheres.get(name, np.empty((0, 4))).tolist():
            lines.append(f'{indent}  <geom type="sphere" pos="{_row(center)}" size="{digits(radius)}"/>')
        for child in children.get(name, []):
            body(child.child, child, depth + 1)
        lines.append(f"{indent}</body>")

    below = {joint.child for joint in found.robot.joints}
    for root in (name for name in links if name not in below):
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
    follow = [(joint.name, joint.mimic) for joint in found.robot.joints if joint.mimic is not None]
    if follow:
        lines.append("  <equality>")
        for name, (leader, factor, offset) in follow:
            words = f"joint1={quoteattr(name)} joint2={quoteattr(leader)}"
            lines.append(f'    <joint {words} polycoef="{_row([offset, factor, 0.0, 0.0, 0.0])}"/>')
        lines.append("  </equality>")
    return "\n".join([*lines, "</mujoco>", ""]).encode()


def _mjcf_joints(joint: LinkJoint) -> list[str]:
    """Return the elements of a joint, in the frame of its child."""
    back = joint.frame.inverse()
    axis, origin = matmul(back.rotation, joint.axis), back.points(joint.origin)
    name = quoteattr(joint.name)
    if joint.type == "fixed":
        return []
    if joint.type == "planar":
        across = np.linalg.svd(axis[None])[2][1:]
        moves = [
            f'<joint name={quoteattr(f"{joint.name}_{k}")} type="slide" axis="{_row(along)}"/>'
            for k, along in enumerate(across)
        ]
        return [*moves, f'<joint name={name} type="hinge" axis="{_row(axis)}"/>']
    if joint.type == "ball":
        return [f'<joint name={name} type="ball" pos="{_row(origin)}"/>']
    if joint.type == "free":
        # MuJoCo has free joints on the world alone.
        return [f"<freejoint name={name}/>"] if joint.parent == WORLD else []
    kind = "hinge" if joint.type == "hinge" else "slide"
    limits = "" if joint.limits is None else f' range="{_row(joint.limits)}"'
    return [f'<joint name={name} type="{kind}" pos="{_row(origin)}" axis="{_row(axis)}"{limits}/>']


def read_mjcf_spheres(path: Path) -> Spheres:
    """Read the spheres of each body; a body with other geoms that collide too is an InputError."""
    found = {}
    for link in read_robot(path).solid:
        if link.balls is None:
            raise InputError(f"body '{link.name}' has other shapes than spheres; expected spheres alone")
        found[link.name] = link.balls
    return found


FORMATS: Mapping[str, RobotFormat] = {
    "h5": RobotFormat((".h5",), b"hhsim-robot-trees", write_h5, read_h5),
    "urdf": RobotFormat((".urdf",), b"<robot", write_urdf, read_urdf_spheres),
    "curobo": RobotFormat((".yml", ".yaml"), b"collision_spheres", write_curobo, read_curobo),
    "json": RobotFormat((".json",), b"spheres", write_json, read_json),
    "mjcf": RobotFormat((".xml", ".mjcf"), b"<mujoco", write_mjcf, read_mjcf_spheres),
    "srdf": RobotFormat((".srdf",), b"link_sphere_approximation", write_srdf, read_srdf),
    "xrdf": RobotFormat((".xrdf",), b"xrdf", write_xrdf, read_xrdf),
}
"""Formats by the names of `--as`."""
