"""Links on joints, as URDF and MJCF describe them, as the bodies of a scene.

What hangs on no joint stands still, or is free with `--free`, unless the file fixes it to the world: in a URDF by a
link named `world`, in an MJCF that has joints by having none itself. A joint follows the motion where that has values
for its name or its link's, or where both have one joint alone. Any other one stands where the file begins, at the value
nearest to 0 within its limits (URDF) or at its ref (MJCF), or is free with `--free`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from hhsim.errors import InputError, check_known, named
from hhsim.hand.quaternion import quaternion_from_matrix
from hhsim.linkage.file import link_mesh, read_linkage
from hhsim.linkage.linkage import HERE, Link, LinkJoint, Robot
from hhsim.mesh.mesh import Mesh
from hhsim.scene.body import Joint, Keyframe, triple
from hhsim.scene.body_file import BodyFile, BodySettings

UNDER, NONE = "under", "none"


def linkage_bodies(
    path: Path, motion: object = None, *, free: Mapping[str, Any] | None = None, solid: bool | None = None
) -> tuple[tuple[BodySettings, ...], dict[str, Mesh]]:
    """Return the links of a URDF or MJCF file as bodies, and their meshes [m] by their names, each in its own frame.

    Args:
        path: The file.
        motion: A script may move joints.
        free: None where everything stands but what the motion moves; else `mass`, `density`, `friction`, `torsion` of
            the only link in place of the file's [kg, kg/m³, 1, m], and `table`: under, none, or a height [m].
        solid: As for `hhsim.scene.declared_bodies.load_bodies`.

    Raises:
        InputError: As `read_linkage`; values of joints beyond their limits, driven joints on what is free, or `free`
            properties of one body where there are several.
    """
    linkage = read_linkage(path)
    with named(path):
        given = dict(free or {})
        table = given.pop("table", None)
        if given and len(linkage.links) > 1:
            raise InputError(f"{next(iter(given))} is of one body; it has {len(linkage.links)}, which state their own")
        moved = _moved_joints(linkage, motion)
        bodies = [_body(linkage, link, moved, free is not None, given) for link in linkage.links]
        if free is not None:
            if not any(body.is_free for body in bodies):
                raise InputError("nothing is free: its links are fixed to the world, or moved by the motion")
            usual = (NONE if linkage.on_world else UNDER) if linkage.table is None else linkage.table
            plane: Any = usual if table is None else table
            if plane != NONE:
                name = "table" if all(body.name != "table" for body in bodies) else "table-under-all"
                bodies.append(BodySettings(name=name, plane=plane))
        solids = {body.name for body in bodies if solid or (solid is None and body.is_free)}
        meshes = {
            link.name: link_mesh(linkage, link.name, str(path), link.name in solids or solid) for link in linkage.links
        }
        first = linkage.links[0].name
        meshes[first] = replace(meshes[first], warnings=(*meshes[first].warnings, *linkage.notes))
        return BodyFile(tuple(bodies)).body, meshes


def _moved_joints(linkage: Robot, motion: object) -> dict[str, Joint]:
    """Return each joint that a motion moves, by the name of its link.

    Raises UnknownNameError for a joint that the file has not, InputError for values beyond its limits.
    """
    given: Mapping[str, Sequence[Keyframe]] = dict(getattr(motion, "joints", ()))
    joints = {child: joint for child, joint in linkage.joint_of.items() if joint.type != "free"}
    known = {joint.name: child for child, joint in joints.items()} | {child: child for child in joints}
    if len(given) == 1 and len(joints) == 1:
        (word,), (child,) = given, joints
        known.setdefault(word, child)
    check_known("joint", given, known)
    found: dict[str, Joint] = {}
    for word, keyframes in given.items():
        joint = joints[known[word]]
        with named(f"joint '{joint.name}'"):
            found[known[word]] = _settings(joint).moved(keyframes)
    return found


def _body(linkage: Robot, link: Link, moved: Mapping[str, Joint], free: bool, given: Mapping[str, Any]) -> BodySettings:
    joint, own = linkage.joint_of.get(link.name), link.inertial
    frame = HERE if joint is None else joint.frame
    about: dict[str, Any] = {"friction": link.friction, "torsion": link.torsion or 0.0}
    if own is not None and not {"mass", "density"} & set(given):
        about["mass"] = own.mass
        if own.center is not None and own.inertia is not None:
            half = 0.5 * (own.inertia + own.inertia.T)
            about |= {"center": triple(own.center), "inertia": tuple(triple(row) for row in half)}
    about |= given
    if joint is None or joint.type == "free":
        about["fixed"] = not free or (joint is None and linkage.on_world)
    elif link.name in moved:
        about["joint"] = moved[link.name]
    else:
        # A joint that nothing moves stands by a motion of one value.
        settings = _settings(joint)
        about["joint"] = settings if free else settings.moved(((0.0, joint.start),))
    w, x, y, z = quaternion_from_matrix(frame.rotation).tolist()
    about |= {"position": triple(frame.position), "orientation": (w, x, y, z)}
    return BodySettings(name=link.name, mesh=link.name, **about)


def _settings(joint: LinkJoint) -> Joint:
    return Joint(
        type="slider" if joint.type == "slider" else "hinge",
        axis=triple(joint.axis),
        origin=triple(joint.origin),
        on=joint.parent,
        limits=joint.limits,
        friction=joint.friction,
        start=joint.start,
    )
