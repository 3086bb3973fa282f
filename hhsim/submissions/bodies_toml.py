"""Bodies of a scene as a TOML that `hhsim replay` reads, beside their meshes, and values and poses of driven ones."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.hand.quaternion import quaternion, quaternion_from_matrix, rotation_matrix
from hhsim.linkage.linkage import HERE, Frame
from hhsim.motion.csv_file import POSE_COLUMNS
from hhsim.motion.trajectory import ObjectMotion, RigidMotion
from hhsim.reproducible import matmul, norm
from hhsim.scene.body import Body, Driven, Free, HalfSpace
from hhsim.scene.scene import Scene
from hhsim.solver.scene_solver import STRAY
from hhsim.table.table import Table

BODIES_FILE, JOINTS_FILE = "bodies.toml", "joints.csv"


def bodies_toml(scene: Scene, surfaces: Mapping[str, tuple[str, FloatArray | None]]) -> dict[str, str]:
    """Return the texts of `BODIES_FILE`, of `JOINTS_FILE` where joints are driven, and of poses, by their names.

    `surfaces` has of each body, by its name, the mesh file and the place of its frame, position [m] and orientation
    (7,), or None for the world's.
    """
    first = scene.hands[0].trajectory
    place = Frame(rotation_matrix(first.object_orientation), first.object_position)
    frames = {name: HERE if pose is None else _frame(pose) for name, (_, pose) in surfaces.items()}
    tables, values, found = [], {"time": scene.ticks.time}, dict[str, str]()
    for body in scene.bodies:
        if isinstance(body, HalfSpace):
            height = body.height - float(place.position[2])
            tables.append(_table({"name": body.name, "plane": height, "friction": body.friction}))
            continue
        driven = body.motion if isinstance(body.motion, Driven) else None
        if driven is not None and driven.values is not None:
            values[body.name] = driven.values
        bearer = frames[body.joint.on] if body.joint and body.joint.on else place
        moves = _moves(body, frames[body.name], bearer)
        # What carries the object carries its frame, in which the hand's motion is written.
        if driven is not None and driven.values is None:
            poses = _relative_poses(scene, driven.poses, frames[body.name])
            if np.abs(poses - poses[0]).max() > STRAY:
                file = f"{body.name}-poses.csv"
                cells = np.column_stack([scene.ticks.time, poses]).tolist()
                found[file] = Table.of_cells(POSE_COLUMNS, cells).csv()
                kept = {name: moves[name] for name in ("friction", "torsion")}
                moves = kept | {"poses": _Raw(f'{{ file = "{file}" }}')}
        tables.append(_table({"name": body.name, "mesh": surfaces[body.name][0], **moves}))
    found[BODIES_FILE] = "\n".join(tables)
    if len(values) > 1:
        found[JOINTS_FILE] = Table.of_cells([*values], np.column_stack([*values.values()]).tolist()).csv()
    return found


def _relative_poses(scene: Scene, poses: ObjectMotion, frame: Frame) -> FloatArray:
    """Return the poses of a body's frame, the first one given in the world, in that of the bodies' file, (T, 7)."""
    steps, first, hand = (len(poses.position), 1), poses.at(0), scene.hands[0]
    along = poses.since(*first)
    turn = np.tile(quaternion_from_matrix(frame.rotation), steps)
    moved = along.points(np.tile(frame.position, steps)), along.orientations(turn)
    given = hand.trajectory.object_position, hand.trajectory.object_orientation
    carrier = hand.ticks.object_motion or ObjectMotion(*(np.tile(values, steps) for values in given))
    to = RigidMotion(carrier.orientation, carrier.position)
    return np.hstack([to.seen_points(moved[0]), to.seen_orientations(moved[1])])


def _moves(body: Body, frame: Frame, bearer: Frame) -> dict[str, Any]:
    """Return the keys of a body but its name and mesh, from its frame and that of what bears it in the world."""
    own, joint, free = bearer.inverse().after(frame), body.joint, body.motion if isinstance(body.motion, Free) else None
    moves: dict[str, Any] = {}
    if joint is not None:
        back = bearer.inverse()
        axis = matmul(back.rotation, np.array(joint.axis) / norm(np.array(joint.axis)))
        origin = back.points(np.array(joint.origin))
        if joint.type == "hinge":
            turn = rotation_matrix(quaternion(-joint.value * axis))
            own = Frame(turn, origin - matmul(turn, origin)).after(own)
        else:
            own = Frame(own.rotation, own.position - joint.value * axis)
        moves = {"type": joint.type, "axis": axis, "origin": origin, "friction": joint.friction}
        moves |= {"on": joint.on} if joint.on else {}
        moves |= {"limits": np.array(joint.limits)} if joint.limits else {}
        recording = f'{{ file = "{JOINTS_FILE}", column = "{body.name}", time = "time" }}'
        moves |= {"recording": _Raw(recording)} if free is None else {"start": joint.value}
    about: dict[str, Any] = {"position": own.position, "orientation": quaternion_from_matrix(own.rotation)}
    about |= {"friction": body.friction, "torsion": body.torsion}
    if free is not None:
        back = frame.inverse()
        inertia = matmul(matmul(back.rotation, np.array(free.inertia)), back.rotation.T)
        about |= {"mass": free.mass, "center": back.points(np.array(free.center)), "inertia": inertia}
    elif joint is None:
        about["fixed"] = True
    return about | {f"joint.{name}": value for name, value in moves.items()}


class _Raw(str):
    """Text of a value that is TOML already."""


def _table(keys: Mapping[str, Any]) -> str:
    lines = [f"{key} = {_value(value)}" for key, value in keys.items() if value is not None]
    return "\n".join(["[[body]]", *lines, ""])


def _value(value: Any) -> str:
    if isinstance(value, _Raw):
        return str(value)
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, np.ndarray):
        return f"[{', '.join(_value(each) for each in value.tolist())}]"
    if isinstance(value, list):
        return f"[{', '.join(_value(each) for each in value)}]"
    return repr(float(value))


def _frame(pose: FloatArray) -> Frame:
    return Frame(rotation_matrix(pose[3:]), np.asarray(pose[:3]))
