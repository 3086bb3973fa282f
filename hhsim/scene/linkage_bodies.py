"""Links on joints, as URDF and MJCF describe them, as the bodies of a scene.

What hangs on no joint stands still, or is free with `--free`, unless the file fixes it to the world: in a URDF by a
link named `world`, in an MJCF that has joints by having none itself. A joint follows the motion where that has values
for its name or its link's, or where both have one joint alone. Any other one stands where the file begins, at the value
nearest to 0 within its limits (URDF) or at its ref (MJCF), or is free with `--free`. Values beyond the limits that are
all within them with the other sign are taken so: two files may turn an axis opposite ways.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import InputError, check_known, named
from hhsim.hand.quaternion import quaternion_from_matrix, rotation_matrix
from hhsim.linkage.file import names_a_linkage, read_linkage
from hhsim.linkage.linkage import HERE, Frame, Link, Linkage, LinkJoint
from hhsim.linkage.object_mesh import link_mesh
from hhsim.mesh.mesh import Mesh
from hhsim.motion.trajectory import Trajectory
from hhsim.reproducible import matmul
from hhsim.scene.free_object import USUAL_FRICTION, FreeObject, Hinge, Slider
from hhsim.scene.jointed_thing import Joint, JointedThing, Keyframe, Part
from hhsim.scene.parts_of_thing import ThingParts, load_thing, require_apart
from hhsim.scene.things import (
    MOST_THINGS,
    HingeSettings,
    SliderSettings,
    Things,
    ThingSettings,
    ThingsSettings,
    along_joint,
)

LEVEL_OF_MANY = 3
"""Usual level of the trees of several free bodies: each meets the others by its leaves, of which it may have 1,024."""
ENDLESS = (-100.0, 100.0)
"""Limits of a joint that has none [rad]."""
Motions = Mapping[str, Sequence[Keyframe]]


def names_links(word: str | Path) -> bool:
    """Return True if a word means a URDF or MJCF file of several links; errors as `read_linkage`."""
    return names_a_linkage(word) and len(read_linkage(Path(word)).links) > 1


def load_parts(word: str | Path, motion: object = None, *, solid: bool = True) -> ThingParts:
    """Load a thing of several parts, see `load_thing`, or the links of a URDF or MJCF file."""
    if names_a_linkage(word):
        return linkage_parts(Path(word), motion, solid=solid)
    return load_thing(word, motion, solid=solid)


def linkage_parts(path: Path, motion: object, *, solid: bool) -> ThingParts:
    """Return the links of a file as parts whose joints follow a motion, or stand; InputError as `load_thing`."""
    linkage = read_linkage(path)
    with named(path):
        roots = [link.name for link in linkage.links if not _bearer(linkage, link)]
        if len(roots) != 1 or roots[0] in linkage.joints:
            expected = "expected one that is fixed, or --free"
            raise InputError(f"links {', '.join(roots)} move on the world; {expected}")
        motions, notes = joint_motions(linkage, motion)
        parts = []
        for link in linkage.links:
            moving = linkage.joints.get(link.name)
            frame = HERE if moving is None else moving.frame
            turn = _four(frame)
            place: dict[str, Any] = {"position": _three(frame.position), "orientation": turn}
            if moving is not None:
                given = motions.get(link.name, ((0.0, moving.start),))
                with named(f"joint '{moving.name}'"):
                    joint = _joint(moving, moving.axis, moving.origin, given)
                place |= {"parent": moving.parent, "joint": joint}
            parts.append(Part(name=link.name, mesh=link.name, **place))
        meshes = _noted(_meshes(linkage, path, solid), notes)
        found = ThingParts(path.stem, JointedThing(tuple(parts)), meshes)
        found.require_apart()
    return found


def linkage_things(path: Path, motion: object, *, solid: bool) -> Things:
    """Return the links of a file as things that are free, but for what the file fixes and the motion moves."""
    linkage = read_linkage(path)
    with named(path):
        if len(linkage.links) > MOST_THINGS:
            raise InputError(f"{len(linkage.links)} links; expected up to {MOST_THINGS} where one is free")
        motions, notes = joint_motions(linkage, motion)
        frames = linkage.start_frames()
        things: list[ThingSettings] = []
        meshes, drives = [], []
        for link, mesh in zip(linkage.links, _meshes(linkage, path, solid)):
            settings = _thing(linkage, link, frames, motions)
            things.append(settings)
            drive = along_joint(settings, settings.driven) if settings.driven else None
            begin = None if drive is None else drive(np.zeros(1))
            place = (
                frames[link.name] if begin is None else Frame(rotation_matrix(begin.orientation[0]), begin.position[0])
            )
            meshes.append(mesh.transformed(*place))
            drives.append(drive)
        # The first one is what the motion is of.
        order = sorted(range(len(things)), key=lambda k: things[k].fixed or things[k].driven is not None)
        first = things[order[0]]
        if first.fixed or first.driven:
            raise InputError("the motion moves all of its joints, so nothing is free: leave --free out")
        table: Any = linkage.table
        if table is None:
            table = "none" if linkage.on_world else "under"
        found = ThingsSettings(tuple(things[k] for k in order), table=table)
        require_apart([one.name for one in things], meshes, found.joined)
    noted = _noted([meshes[k] for k in order], notes)
    return Things(path.stem, found, noted, tuple(drives[k] for k in order))


def free_link(path: Path, mesh: Mesh, placed: Trajectory | None, given: Mapping[str, Any]) -> FreeObject:
    """Return the only link of a file as a free object, with its joint on the world if it has one.

    `mesh` is in the world, where a motion has placed it; `given` are attributes in place of the file's own.
    """
    linkage = read_linkage(path)
    (link,) = linkage.links
    place = HERE if placed is None else Frame(rotation_matrix(placed.object_orientation), placed.object_position)
    with named(path):
        if linkage.on_world and link.name not in linkage.joints:
            raise InputError(f"link '{link.name}' is fixed to the world, so it cannot be free; expected a joint")
        about: dict[str, Any] = {"friction": link.friction, "torsion": link.torsion}
        about = {name: value for name, value in about.items() if value is not None} | dict(given)
        own = link.inertial if not {"mass", "density"} & set(given) else None
        if own is not None:
            about["mass"] = own.mass
        moving = linkage.joints.get(link.name)
        if moving is not None and moving.type != "free":
            axis, origin = matmul(place.rotation, moving.axis), place.points(moving.origin)
            limits = _from_start(moving)
            about[moving.type] = (
                Hinge(_three(axis), _three(origin), limits, moving.friction)
                if moving.type == "hinge"
                else Slider(_three(axis), limits, moving.friction)
            )
        free = FreeObject.of_mesh(mesh, **about)
        return free if own is None else _weighed(free, link, place.after(linkage.start_frames()[link.name]))


def joint_motions(linkage: Linkage, motion: object) -> tuple[dict[str, tuple[Keyframe, ...]], list[str]]:
    """Return the keyframes of each joint that a motion moves, by the name of its link, and notes on them.

    Raises UnknownNameError for a joint that the file has not, InputError for values beyond its limits.
    """
    given: Motions = dict(getattr(motion, "joints", ()))
    joints = {child: joint for child, joint in linkage.joints.items() if joint.type != "free"}
    known = {joint.name: child for child, joint in joints.items()} | {child: child for child in joints}
    notes, found = list(linkage.notes), dict[str, tuple[Keyframe, ...]]()
    if len(given) == 1 and len(joints) == 1:
        (word,), (child,) = given, joints
        known.setdefault(word, child)
    check_known("joint", given, known)
    for word, keyframes in given.items():
        child = known[word]
        joint = joints[child]
        values = np.array([value for _, value in keyframes])
        least, most = joint.limits or ENDLESS
        if not ((values >= least) & (values <= most)).all() and ((-values >= least) & (-values <= most)).all():
            keyframes = [(time, -value) for time, value in keyframes]
            notes.append(f"joint '{joint.name}' turns the other way round than '{word}' in the motion: see its limits")
        with named(f"joint '{joint.name}'"):
            _joint(joint, joint.axis, joint.origin, keyframes)
        found[child] = tuple(keyframes)
    return found, notes


class LinkThing(ThingSettings, frozen=True):
    """Thing whose mass, centre and inertia a file may state."""

    link: Link | None = None

    def free_object(self, mesh: Mesh, table: float | None, rotation: FloatArray, position: FloatArray) -> FreeObject:
        """Return its physical properties, see `ThingSettings.free_object`."""
        free = super().free_object(mesh, table, rotation, position)
        if self.link is None:
            return free
        own = Frame(rotation_matrix(np.array(self.orientation)), np.array(self.position))
        return _weighed(free, self.link, Frame(rotation, position).after(own))


def _thing(linkage: Linkage, link: Link, frames: Mapping[str, Frame], motions: Motions) -> LinkThing:
    joint, frame = linkage.joints.get(link.name), frames[link.name]
    about: dict[str, Any] = {
        "friction": USUAL_FRICTION if link.friction is None else link.friction,
        "torsion": link.torsion or 0.0,
        "mass": None if link.inertial is None else link.inertial.mass,
        "position": _three(frame.position),
        "orientation": _four(frame),
    }
    if joint is None:
        about["fixed"] = linkage.on_world
    elif joint.type != "free":
        bearer = frames[joint.parent]
        axis, origin = matmul(bearer.rotation, joint.axis), bearer.points(joint.origin)
        if link.name in motions:
            on = linkage.joints.get(joint.parent)
            if joint.parent and not (on is None and linkage.on_world):
                expected = "expected one that is fixed to the world"
                raise InputError(f"joint '{joint.name}' is moved on '{joint.parent}', which is free; {expected}")
            at_zero = bearer.after(joint.frame)
            about |= {"position": _three(at_zero.position), "orientation": _four(at_zero)}
            about["driven"] = _joint(joint, axis, origin, motions[link.name])
        else:
            settings: dict[str, Any] = {"limits": _from_start(joint), "friction": joint.friction, "on": joint.parent}
            about[joint.type] = (
                HingeSettings(_three(axis), origin=_three(origin), **settings)
                if joint.type == "hinge"
                else SliderSettings(_three(axis), **settings)
            )
    return LinkThing(name=link.name, mesh=link.name, link=link, **about)


def _joint(joint: LinkJoint, axis: FloatArray, origin: FloatArray, motion: Sequence[Keyframe]) -> Joint:
    return Joint(
        type="slider" if joint.type == "slider" else "hinge",
        axis=_three(axis),
        limits=joint.limits or ENDLESS,
        motion=tuple(motion),
        origin=_three(origin),
    )


def _from_start(joint: LinkJoint) -> tuple[float, float] | None:
    """Return the limits from where a joint begins; None for a hinge that they let turn all round."""
    if joint.limits is None:
        return None
    least, most = joint.limits[0] - joint.start, joint.limits[1] - joint.start
    return None if joint.type == "hinge" and least <= -np.pi and most >= np.pi else (least, most)


def _weighed(free: FreeObject, link: Link, frame: Frame) -> FreeObject:
    """Return a free object with the centre and inertia that a link states, whose frame is in the world."""
    own = link.inertial
    if own is None or own.center is None or own.inertia is None:
        return free
    turned = matmul(matmul(frame.rotation, own.inertia), frame.rotation.T)
    first, second, third = (_three(row) for row in 0.5 * (turned + turned.T))
    return replace(free, center=_three(frame.points(own.center)), inertia=(first, second, third))


def _meshes(linkage: Linkage, path: Path, solid: bool) -> list[Mesh]:
    return [link_mesh(linkage, link.name, str(path), solid) for link in linkage.links]


def _noted(meshes: Sequence[Mesh], notes: Sequence[str]) -> tuple[Mesh, ...]:
    """Return meshes of which the first one's warnings hold notes on all of them."""
    return (replace(meshes[0], warnings=(*meshes[0].warnings, *notes)), *meshes[1:])


def _bearer(linkage: Linkage, link: Link) -> str:
    joint = linkage.joints.get(link.name)
    return "" if joint is None else joint.parent


def _three(values: FloatArray) -> tuple[float, float, float]:
    x, y, z = values.tolist()
    return x, y, z


def _four(frame: Frame) -> tuple[float, float, float, float]:
    w, x, y, z = quaternion_from_matrix(frame.rotation).tolist()
    return w, x, y, z
