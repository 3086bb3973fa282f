"""Rigid links on hinges and sliders: one description of what URDF and MJCF say, and the merging of fixed joints."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import InputError
from hhsim.hand.quaternion import quaternion, rotation_matrix
from hhsim.mesh.shapes import Triangles
from hhsim.reproducible import matmul, norm, principal_axes

JointType: TypeAlias = Literal["hinge", "slider"]
MOST_LINKS = 1000
MOST_CORNERS = 2_000_000
"""Largest numbers of links, and of vertices of all their shapes."""
LARGEST = 1000.0
"""Largest coordinate, length or limit [m or rad], and mass [kg]: beyond it the file has another unit, or is damaged."""
LEAST_LENGTH = 1e-9
"""An axis or a quaternion that is shorter has no direction."""
SMALLEST = 1e-6
"""A shape whose longest extent is smaller [m] is scaled to nothing."""
WORLD = "world"
"""Name of the link that is the world: what is fixed to it cannot be free."""


class Frame(NamedTuple):
    """Place of a frame in another one: `rotation @ point + position`."""

    rotation: FloatArray  # shape (3, 3)
    position: FloatArray  # [m], shape (3,)

    def points(self, points: FloatArray) -> FloatArray:
        """Return points [m] (..., 3) of this frame in the other one."""
        return matmul(points, self.rotation.T) + self.position

    def after(self, other: "Frame") -> "Frame":
        """Return the place of a frame, given in this one, in the other one."""
        return Frame(matmul(self.rotation, other.rotation), self.points(other.position))

    def inverse(self) -> "Frame":
        """Return the place of the other frame in this one."""
        return Frame(self.rotation.T, -matmul(self.rotation.T, self.position))


HERE = Frame(np.eye(3), np.zeros(3))


class Mimic(NamedTuple):
    """Joint whose value another one follows: `factor` times it, plus `offset` [rad] or [m]."""

    leader: str
    factor: float = 1.0
    offset: float = 0.0


class Inertial(NamedTuple):
    """Mass [kg] of a link, its centre [m] (3,) and inertia about it [kg·m²] (3, 3), both None where unknown."""

    mass: float
    center: FloatArray | None = None
    inertia: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class Link:
    """Rigid link. Arrays are in its own frame, unless said otherwise."""

    name: str
    shapes: tuple[Triangles, ...] = ()  # surfaces that touch, closed or not
    inertial: Inertial | None = None  # None: by the density of what moves it
    friction: float | None = None  # coefficient of sliding friction; None: unstated
    torsion: float | None = None  # moment about its normal that a contact bears per newton of its force [m]
    # Centre and radius [m] of each shape, shape (n, 4), where all of them are spheres.
    balls: FloatArray | None = None

    @property
    def triangles(self) -> Triangles:
        """Vertices [m] (V, 3) and faces (F, 3) of all shapes."""
        starts = np.cumsum([0, *(len(vertices) for vertices, _ in self.shapes)])
        faces = [faces + start for (_, faces), start in zip(self.shapes, starts)]
        return np.concatenate([vertices for vertices, _ in self.shapes]), np.concatenate(faces)


@dataclass(frozen=True, eq=False)
class LinkJoint:
    """Joint of a link and its parent; `frame` is the link's place in its parent's frame with the joint at 0."""

    name: str
    type: JointType | Literal["fixed", "free", "planar", "ball"]  # the last two of a robot alone
    parent: str  # name of a link; "" is the world
    child: str
    frame: Frame = HERE
    axis: FloatArray = field(default_factory=lambda: np.array([1.0, 0.0, 0.0]))  # in the parent's frame, of length 1
    origin: FloatArray = field(default_factory=lambda: np.zeros(3))  # point of the axis, in the parent's frame [m]
    limits: tuple[float, float] | None = None  # least and greatest value [rad] or [m]; None: without end
    friction: float = 0.0  # largest moment [N·m] or force [N] of dry friction
    start: float = 0.0  # value at which the file's scene begins [rad] or [m]
    mimic: Mimic | None = None  # of a robot alone

    @property
    def start_frame(self) -> Frame:
        """Place of the link in its parent's frame where the file's scene begins."""
        if self.type == "slider":
            return Frame(self.frame.rotation, self.frame.position + self.start * self.axis)
        if self.type != "hinge":
            return self.frame
        turn = rotation_matrix(quaternion(self.start * self.axis))
        return Frame(turn, self.origin - matmul(turn, self.origin)).after(self.frame)


@dataclass(frozen=True, eq=False)
class Robot:
    """Links in an order in which parents come first, and their joints; one without a joint is in the file's frame."""

    name: str
    links: tuple[Link, ...]  # some have no shapes
    joints: tuple[LinkJoint, ...]  # in the file's order
    notes: tuple[str, ...] = ()  # what was left out or assumed, one plain sentence each
    on_world: bool = False  # True if the file fixes what has no joint to the world, so that it is not free
    table: float | None = None  # height of a floor [m], in the file's frame

    @property
    def joint_of(self) -> dict[str, LinkJoint]:
        """Joint of each link that has one, by the link's name."""
        return {joint.child: joint for joint in self.joints}

    @property
    def solid(self) -> tuple[Link, ...]:
        """Links that have shapes."""
        return tuple(link for link in self.links if link.shapes)

    @property
    def moves(self) -> bool:
        """True if a link can move on another one."""
        return any(joint.type not in ("fixed", "free") or joint.mimic is not None for joint in self.joints)

    def link(self, name: str) -> Link:
        """Return a link that has shapes, by its name; InputError lists them."""
        for link in self.solid:
            if link.name == name:
                return link
        raise InputError(f"no link '{name}'; it has {', '.join(link.name for link in self.solid)}")


def merged_linkage(robot: Robot) -> Robot:
    """Return a robot in which links on fixed joints are one with their parents, and each link has shapes.

    A merged link has the name and the frame of its first one; links without shapes at the ends of chains are left out.
    Raises InputError for links between two joints that have no shape, or no shapes at all.
    """
    notes, on_world = list(robot.notes), robot.on_world
    parent_joint = robot.joint_of
    # Of each link the first one of its rigid group, and its frame there.
    first: dict[str, str] = {"": ""}
    places: dict[str, Frame] = {"": HERE}
    groups: dict[str, list[Link]] = {}
    for link in robot.links:
        joint = parent_joint.get(link.name)
        is_rigid = joint is not None and joint.type == "fixed"
        first[link.name] = first[joint.parent] if joint is not None and is_rigid else link.name
        places[link.name] = places[joint.parent].after(joint.frame) if joint is not None and is_rigid else HERE
        groups.setdefault(first[link.name], []).append(link)
    merged = {key: _one_link(key, group, [places[link.name] for link in group]) for key, group in groups.items()}
    moving: dict[str, LinkJoint] = {}
    for key in merged:
        joint = parent_joint.get(key)
        if joint is not None:
            base = places[joint.parent]
            moving[key] = replace(
                joint,
                parent=first[joint.parent],
                frame=base.after(joint.frame),
                axis=matmul(base.rotation, joint.axis),
                origin=base.points(joint.origin),
            )
    for key in reversed([key for key in merged if not merged[key].shapes]):
        below = [joint.name for joint in moving.values() if joint.parent == key]
        if below and key in moving:
            raise InputError(
                f"link '{key}' has no collision and no visual shape, and moves between the joints "
                f"'{moving[key].name}' and '{below[0]}'; expected a shape in each link that moves"
            )
        if key in moving:
            notes.append(f"link '{key}' has no shape: it is left out, with the joint '{moving[key].name}'")
            del moving[key]
        else:
            moving = {k: replace(joint, parent="") if joint.parent == key else joint for k, joint in moving.items()}
            on_world = True
        del merged[key]
    if not merged:
        raise InputError("no link has a collision or a visual shape; expected a mesh, box, cylinder or sphere")
    unique = _plain_names([link.name for link in merged.values()])
    plain = {key: unique[link.name] for key, link in merged.items()}
    found = tuple(replace(link, name=plain[key]) for key, link in merged.items())
    of_joints = _plain_names([joint.name for joint in moving.values()])
    joints = []
    for key, joint in moving.items():
        # What is free hangs on nothing, wherever it was written.
        parent = plain[joint.parent] if joint.parent and joint.type != "free" else ""
        joints.append(replace(joint, name=of_joints[joint.name], child=plain[key], parent=parent))
    return replace(robot, links=found, joints=tuple(joints), on_world=on_world, notes=tuple(notes))


def required_axis(axis: FloatArray) -> FloatArray:
    """Return an axis at length 1; InputError if it has no direction."""
    length = float(norm(axis))
    if not LEAST_LENGTH <= length < np.inf:
        given = " ".join(f"{value:g}" for value in axis)
        raise InputError(f"its axis is {given}; expected a direction such as 0 0 1")
    return np.asarray(axis / length)


def required_limits(limits: tuple[float, float], type_: JointType) -> tuple[float, float]:
    """Return limits [rad] or [m] in their order; InputError where the least one is above the greatest, or NaN."""
    least, most = limits
    if not least <= most:
        raise InputError(f"its limits are {least:g} to {most:g}; expected the least value first")
    if max(abs(least), abs(most)) > LARGEST:
        unit = "rad: continuous joints have no limits" if type_ == "hinge" else "m"
        raise InputError(f"its limits are {least:g} to {most:g}; expected numbers within ±{LARGEST:g} {unit}")
    return least, most


def required_inertial(mass: float, center: FloatArray, inertia: FloatArray, most: float = LARGEST) -> Inertial | None:
    """Return mass, centre and inertia; None for a mass of 0, without an inertia where it is none of a solid.

    Raises InputError for a negative mass, one above `most` [kg], or what is no number.
    """
    if not 0.0 <= mass <= most:
        raise InputError(f"its mass is {mass:g} kg; expected 0 to {most:g}")
    if not (np.abs(center) <= LARGEST).all() or not np.isfinite(inertia).all():
        raise InputError("its centre of mass or its inertia is no number, or too large; expected m and kg·m²")
    if mass == 0.0:
        return None
    moments = principal_axes(0.5 * (inertia + inertia.T))[0]
    # Of a solid each principal moment is at most the sum of the two others.
    is_solid = moments[0] > 0.0 and moments[2] <= (moments[0] + moments[1]) * (1.0 + 1e-6)
    return Inertial(mass, center, inertia) if is_solid else Inertial(mass)


def required_shape(vertices: FloatArray) -> None:
    """Raise InputError for a shape of no size, or of one that no object has."""
    extent = float(np.ptp(vertices, axis=0).max()) if np.isfinite(vertices).all() else np.nan
    if not SMALLEST <= extent <= LARGEST or np.abs(vertices).max() > LARGEST:
        raise InputError(
            f"its longest extent is {extent:.3g} m; expected {SMALLEST:g} to {LARGEST:g}: is its scale wrong?"
        )


def chain_of(name: str, bearers: Mapping[str, str], what: str) -> list[str]:
    """Return a link, or another thing, `what`, and all that bear it, in order; InputError for joints in a circle."""
    chain = [name]
    while (bearer := bearers.get(chain[-1])) is not None:
        if bearer in chain:
            circle = " on ".join([*chain[chain.index(bearer) :], bearer])
            raise InputError(f"joints in a circle: {circle}; expected one {what} that hangs on no other")
        chain.append(bearer)
    return chain


def _one_link(name: str, group: Sequence[Link], places: Sequence[Frame]) -> Link:
    shapes = tuple(
        (place.points(vertices), faces) for link, place in zip(group, places) for vertices, faces in link.shapes
    )
    # Named for what is seen: a root without shapes is often called world or base.
    name = next((link.name for link in group if link.shapes), name) if name in ("", WORLD) else name
    frictions = [(link.friction, link.torsion) for link in group if link.shapes and link.friction is not None]
    friction, torsion = max(frictions, default=(None, None), key=lambda pair: pair[0] or 0.0)
    return Link(name, shapes, _one_inertial(group, places), friction, torsion)


def _one_inertial(group: Sequence[Link], places: Sequence[Frame]) -> Inertial | None:
    """Return the common mass, centre and inertia; None if a link with shapes states no mass."""
    known = [(link.inertial, place) for link, place in zip(group, places) if link.inertial is not None]
    if not known or any(link.inertial is None for link in group if link.shapes):
        return None
    mass = sum(one.mass for one, _ in known)
    if any(one.inertia is None for one, _ in known):
        return Inertial(mass)
    centers = [place.points(np.asarray(one.center)) for one, place in known]
    center = np.asarray(sum(one.mass * at for (one, _), at in zip(known, centers)) / mass)
    inertia = np.zeros((3, 3))
    for (one, place), at in zip(known, centers):
        off = at - center
        turned = matmul(matmul(place.rotation, np.asarray(one.inertia)), place.rotation.T)
        inertia = inertia + turned + one.mass * (float((off * off).sum()) * np.eye(3) - np.outer(off, off))
    return Inertial(mass, center, inertia)


def _plain_names(names: Sequence[str]) -> dict[str, str]:
    """Return names of letters, digits, - and _ alone, each once, by the names of a file."""
    plain: dict[str, str] = {}
    for name in names:
        word = base = re.sub(r"[^A-Za-z0-9_-]", "_", name)[:80] or "link"
        number = 2
        while word in plain.values():
            word, number = f"{base}-{number}", number + 1
        plain[name] = word
    return plain


def robot_of(
    name: str,
    links: Sequence[Link],
    joints: Sequence[LinkJoint],
    notes: Iterable[str] = (),
    seen: Sequence[str] = (),
    **of_scene: Any,
) -> Robot:
    """Return the robot of links and joints.

    `seen` are links that only look: they have no shapes, and a note names them. `of_scene` are `on_world` and `table`.
    Raises InputError for names given twice, joints of links that there are not, circles, several roots, no links or too
    many, or a mimic that no joint leads.
    """
    names = [link.name for link in links]
    if not names:
        raise InputError("no links; expected at least one, with a shape")
    if len(names) > MOST_LINKS:
        raise InputError(f"{len(names):,} links; expected {MOST_LINKS:,} at most")
    for kind, given in (("links", names), ("joints", [joint.name for joint in joints])):
        twice = sorted({one for one in given if given.count(one) > 1})
        if twice:
            raise InputError(f"two {kind} have the name '{twice[0]}'; expected a name for each")
    corners = sum(len(vertices) for link in links for vertices, _ in link.shapes)
    if corners > MOST_CORNERS:
        raise InputError(f"its shapes have {corners:,} vertices; expected {MOST_CORNERS:,} at most")
    bearers = dict[str, str]()
    for joint in joints:
        for role, end in (("parent", joint.parent), ("child", joint.child)):
            if end not in (*names, ""):
                raise InputError(f"joint '{joint.name}': its {role} is '{end}', which is no link of the file")
        if joint.child in bearers:
            both = " and ".join(f"'{other.name}'" for other in joints if other.child == joint.child)
            raise InputError(f"link '{joint.child}' is the child of two joints, {both}; expected one")
        bearers[joint.child] = joint.parent
    order = sorted(links, key=lambda link: len(chain_of(link.name, bearers, "link")))
    roots = [name for name in names if name not in bearers]
    if len(roots) > 1:
        raise InputError(f"links {', '.join(roots[:4])} hang on no joint; expected one such link")
    known = {joint.name: joint for joint in joints}
    for joint in joints:
        chain = [joint]
        while (follows := chain[-1].mimic) is not None:
            if follows.leader not in known:
                raise InputError(f"joint '{joint.name}': it mimics '{follows.leader}', which is no joint of the file")
            if known[follows.leader] in chain:
                raise InputError(f"joint '{joint.name}': it mimics itself; expected a joint that moves by itself")
            chain.append(known[follows.leader])
    if seen:
        notes = [*notes, f"{', '.join(seen)}: nothing there collides, so without spheres; --visual takes what is seen"]
    return Robot(name, tuple(order), tuple(joints), tuple(notes), **of_scene)
