"""URDF (wiki.ros.org/urdf/XML): links and joints of a `<robot>`."""

import math
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import InputError, named
from hhsim.linkage.linkage import (
    HERE,
    LARGEST,
    WORLD,
    Frame,
    Inertial,
    JointType,
    Link,
    LinkJoint,
    Mimic,
    Robot,
    required_axis,
    required_inertial,
    required_limits,
    required_shape,
    robot_of,
)
from hhsim.mesh.file import read_triangles
from hhsim.mesh.shapes import ENCLOSING, Triangles, box, capsule, cylinder, ellipsoid
from hhsim.reproducible import matmul, sine_and_cosine

TYPES = ("revolute", "continuous", "prismatic", "fixed")
FREE_TYPES = ("planar", "floating")
MIMIC = (("multiplier", "1"), ("offset", "0"))
ADDRESSES = ("package://", "model://")
"""Beginnings of a mesh's name that stand before a package's."""


def read_urdf(root: Element, path: Path, of_scene: bool, looks: bool) -> Robot:
    """Return every link and joint of the `<robot>` of a file by its name, with what collides.

    With `looks`, a link that states no `<collision>` is as it looks. Of a robot that is no scene's triangles of round
    shapes enclose them, joints may be of any type, and a mass that cannot be is left out, with a note: spheres need
    none. InputError names the element at fault and what would be right.
    """
    read = partial(_triangles, path=path, round_factor=1.0 if of_scene else ENCLOSING, read=cache(read_triangles))
    notes, elements = list[str](), root.findall("link")
    prefixes = {key.removeprefix("xmlns:") for key, value in root.attrib.items() if "xacro" in value} | {"xacro"}
    if any(element.tag.partition(":")[0] in prefixes for element in root.iter() if ":" in element.tag):
        raise InputError("it has macros of xacro; expected a URDF: xacro FILE > FILE.urdf")
    links = [_link(element, read, looks, None if of_scene else notes) for element in elements]
    joints = [_joint(element, notes, of_scene) for element in root.findall("joint")]
    seen = [link.name for link, each in zip(links, elements) if not link.shapes and each.find("visual") is not None]
    children = {joint.child for joint in joints}
    on_world = any(link.name == WORLD for link in links if link.name not in children)
    return robot_of(root.get("name") or path.stem, links, joints, notes, seen, on_world=on_world)


def mesh_file(name: str, path: Path) -> Path:
    """Return the file that a URDF means by a mesh's name: beside it, or, of a `package://`, in a folder above.

    A package is found by its folder's name; where no folder has it, by the rest of the path alone. The file need not
    exist.
    """
    plain = name.removeprefix("file://")
    for address in ADDRESSES:
        plain = plain.removeprefix(address)
    parts = Path(plain).parts
    folders = (path.parent, *path.parent.resolve().parents)
    tries = [folder.joinpath(*tail) for tail in (parts, parts[1:]) for folder in folders if tail]
    return next((found for found in tries if found.is_file()), path.parent / plain)


def _link(element: Element, read: Callable[[Element], Triangles], looks: bool, notes: list[str] | None) -> Link:
    """Return a link; one of a robot takes any mass, and `notes` say which is left out."""
    name = _name(element)
    with named(f"link '{name}'"):
        # What touches is what collides; a link that states no such shape is as it looks.
        shown = element.findall("collision") or (element.findall("visual") if looks else [])
        shapes = tuple(_shape(each, read) for each in shown)
        friction = element.find("contact/lateral_friction")
        value = None if friction is None else _numbers(friction, "value", 1)[0]
        if value is not None and not 0.0 <= value <= LARGEST:
            raise InputError(f'<lateral_friction value="{value:g}">; expected 0 or more')
        inertial = None
        try:
            inertial = _inertial(element.find("inertial"), LARGEST if notes is None else math.inf)
        except InputError as error:
            if notes is None:
                raise
            fault = str(error).partition(";")[0]
            notes.append(f"link '{name}': {fault}: the mass is left out, since spheres need none")
        spheres = [(_origin(each), each.find("geometry/sphere")) for each in shown]
        balls = [
            [*place.position.tolist(), _sizes(sphere, "radius", 1)[0]]
            for place, sphere in spheres
            if sphere is not None
        ]
        round_ = np.array(balls) if balls and len(balls) == len(shown) else None
        return Link(name, shapes, inertial, value, balls=round_)


def _shape(element: Element, read: Callable[[Element], Triangles]) -> Triangles:
    geometry = element.find("geometry")
    given = [] if geometry is None else list(geometry)
    if len(given) != 1:
        raise InputError(f"<{element.tag}> has {len(given)} shapes in its <geometry>; expected one")
    shape = given[0]
    vertices, faces = read(shape)
    with named(f"<{shape.tag}>"):
        required_shape(vertices)
    return _origin(element).points(vertices), faces


def _triangles(shape: Element, path: Path, round_factor: float, read: Callable[[Path], Triangles]) -> Triangles:
    """Return the triangles of a shape of a file; `read` reads those of a mesh file."""
    if shape.tag == "box":
        return box(_sizes(shape, "size", 3))
    if shape.tag == "sphere":
        return ellipsoid(_sizes(shape, "radius", 1) * round_factor * np.ones(3))
    if shape.tag in ("cylinder", "capsule"):
        radius, length = (float(_sizes(shape, key, 1)[0]) for key in ("radius", "length"))
        return (cylinder if shape.tag == "cylinder" else capsule)(radius * round_factor, length)
    if shape.tag != "mesh":
        raise InputError(f"shape <{shape.tag}>; expected mesh, box, cylinder, sphere or capsule")
    file = shape.get("filename") or ""
    if not file or ("://" in file and not file.startswith(("file://", *ADDRESSES))):
        raise InputError(f'<mesh filename="{file}">; expected a path, or one that begins with package://')
    factors = _numbers(shape, "scale", None, "1 1 1")
    if len(factors) not in (1, 3) or not (np.abs(factors) > 0.0).all():
        raise InputError(f'<mesh scale="{shape.get("scale")}">; expected three numbers other than 0')
    found = mesh_file(file, path)
    if not found.is_file():
        more = " or in a folder above it" if file.startswith(ADDRESSES) else ""
        raise InputError(f"mesh '{file}' is missing; expected it beside {path.name}{more}")
    vertices, faces = read(found)
    return vertices * factors, faces[:, ::-1] if np.prod(np.broadcast_to(factors, 3)) < 0.0 else faces


def _inertial(element: Element | None, most: float) -> Inertial | None:
    if element is None:
        return None
    mass, inertia = element.find("mass"), element.find("inertia")
    value = 0.0 if mass is None else float(_numbers(mass, "value", 1)[0])
    frame = _origin(element)
    moments = np.zeros((3, 3))
    if inertia is not None:
        for i, j, key in ((0, 0, "ixx"), (0, 1, "ixy"), (0, 2, "ixz"), (1, 1, "iyy"), (1, 2, "iyz"), (2, 2, "izz")):
            moments[i, j] = moments[j, i] = _numbers(inertia, key, 1, "0")[0]
    turned = matmul(matmul(frame.rotation, moments), frame.rotation.T)
    return required_inertial(value, frame.position, turned, most)


def _joint(element: Element, notes: list[str], of_scene: bool) -> LinkJoint:
    name, kind = _name(element), element.get("type", "")
    with named(f"joint '{name}'"):
        if kind not in (TYPES if of_scene else TYPES + FREE_TYPES):
            free = ": of a link that moves so, make a file of its own" if kind in FREE_TYPES else ""
            raise InputError(f"its type is '{kind}'; expected {', '.join(TYPES)}{free}")
        mimic = element.find("mimic")
        if mimic is not None and of_scene:
            leader = mimic.get("joint", "")
            raise InputError(f"it mimics '{leader}'; expected joints that move by themselves: remove its <mimic>")
        parent, child = (_of_link(element, role) for role in ("parent", "child"))
        frame = _origin(element)
        if kind == "fixed":
            return LinkJoint(name, "fixed", parent, child, frame)
        given = element.find("axis")
        axis = required_axis(np.array([1.0, 0.0, 0.0]) if given is None else _numbers(given, "xyz", 3))
        if kind in FREE_TYPES:
            turned = matmul(frame.rotation, axis)
            return LinkJoint(
                name, "planar" if kind == "planar" else "free", parent, child, frame, turned, frame.position
            )
        type_: JointType = "slider" if kind == "prismatic" else "hinge"
        limits = None
        if kind != "continuous":
            limit = element.find("limit")
            if limit is None:
                way_out = ", or the type continuous" if kind == "revolute" else ""
                raise InputError(f"no <limit>; expected one with lower and upper{way_out}")
            least, most = (float(_numbers(limit, key, 1, "0")[0]) for key in ("lower", "upper"))
            limits = required_limits((least, most), type_)
        dynamics = element.find("dynamics")
        dynamics = Element("dynamics") if dynamics is None else dynamics
        friction, damping = (float(_numbers(dynamics, key, 1, "0")[0]) for key in ("friction", "damping"))
        if friction < 0.0:
            raise InputError(f'<dynamics friction="{friction:g}">; expected 0 or more')
        if damping and of_scene:
            notes.append(f"joint '{name}': its damping, {damping:g}, is left out: hhsim has dry friction alone")
        least, most = limits or (0.0, 0.0)
        start = min(max(0.0, least), most)
        turned = matmul(frame.rotation, axis)
        follows = None
        if mimic is not None:
            factor, offset = (float(_numbers(mimic, key, 1, usual)[0]) for key, usual in MIMIC)
            follows = Mimic(mimic.get("joint", ""), factor, offset)
        return LinkJoint(name, type_, parent, child, frame, turned, frame.position, limits, friction, start, follows)


def _of_link(element: Element, role: str) -> str:
    found = element.find(role)
    link = None if found is None else found.get("link")
    if not link:
        raise InputError(f'no <{role} link="…">; expected the name of a link')
    return link


def _origin(element: Element) -> Frame:
    """Return the frame of an element's origin: rotations about fixed x, y and z by roll, pitch and yaw."""
    origin = element.find("origin")
    if origin is None:
        return HERE
    place = _numbers(origin, "xyz", 3, "0 0 0")
    if not (np.abs(place) <= LARGEST).all():
        raise InputError(f'<origin xyz="{origin.get("xyz")}">; expected numbers within ±{LARGEST:g} m')
    (a, b, c), (x, y, z) = sine_and_cosine(_numbers(origin, "rpy", 3, "0 0 0"))
    rows = [
        [z * y, z * b * a - c * x, z * b * x + c * a],
        [c * y, c * b * a + z * x, c * b * x - z * a],
        [-b, y * a, y * x],
    ]
    return Frame(np.array(rows), place)


def _name(element: Element) -> str:
    name = element.get("name")
    if not name:
        raise InputError(f"a <{element.tag}> without a name; expected one for each")
    return name


def _sizes(element: Element, key: str, count: int) -> FloatArray:
    values = _numbers(element, key, count)
    if not ((values > 0.0) & (values <= LARGEST)).all():
        raise InputError(f'<{element.tag} {key}="{element.get(key)}">; expected lengths above 0, in metres')
    return values


def _numbers(element: Element, key: str, count: int | None, usual: str | None = None) -> FloatArray:
    """Return the numbers of an attribute; InputError for one that is missing, or no such numbers."""
    text = element.get(key, usual)
    expected = "one number" if count == 1 else "numbers" if count is None else f"{count} numbers"
    if text is None:
        raise InputError(f"<{element.tag}> has no {key}; expected {expected}")
    try:
        values = [float(word) for word in text.split()]
    except ValueError:
        values = []
    if not values or (count is not None and len(values) != count) or not all(map(math.isfinite, values)):
        raise InputError(f'<{element.tag} {key}="{text[:60]}">; expected {expected}')
    return np.array(values)
