"""Claims of bodies: a pose at every tick, where their file, their script and their joints have them."""

from collections.abc import Mapping
from dataclasses import asdict, replace
from types import SimpleNamespace
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import HhsimError
from hhsim.linkage.file import names_a_linkage
from hhsim.mesh.catalogue import body_file_names, names_a_file
from hhsim.motion.trajectory import ObjectMotion, Trajectory
from hhsim.replay.stored_scene import stored_tree
from hhsim.result.body import Body
from hhsim.result.reader import Result
from hhsim.result.schema import FRAME
from hhsim.scene import body as scene_body
from hhsim.scene.declared_bodies import load_bodies
from hhsim.scene.motion_catalogue import resolve_trajectory
from hhsim.scene.overlap import MOST_RAISED
from hhsim.scene.synthesis import carried
from hhsim.verify.claim import NOT_JUDGED, Claim, judged
from hhsim.verify.file_checks import own_script
from hhsim.verify.joint_checks import joint_claims
from hhsim.verify.kinematics import rotations
from hhsim.verify.origin_checks import solid_of

ABOVE = 1e-6
"""Largest initial height of a free body above its place [m], from the solver's offset to the table."""
SAME = 1e-9
"""Tolerance of places [m] and of labels, as a share: rounding of products of poses."""


def body_claims(result: Result, again: bool = False) -> list[Claim]:
    """Judge poses, places and joints of all bodies; `again` reads the files of bodies that are not the catalogue's."""
    moving = [body.poses() for body in result.bodies.values() if body.moves]
    moving += [result.poses(FRAME)] if result.frame == FRAME else []
    claims, says = [], "each body that moves has a pose at every tick, with a unit quaternion that changes no sign"
    if moving:
        off = np.max([_no_pose(poses) for poses in moving], axis=0)
        claims = [judged("body poses", says, off, SAME, "1", "rounding", ticks=np.arange(result.ticks))]
    return [*claims, *_carried(result), *_at_first(result), *_declared(result, again), *joint_claims(result)]


def _no_pose(poses: ObjectMotion) -> FloatArray:
    """Deviation of poses from unit quaternions, infinite where there is none, shape (T,)."""
    off = np.abs(np.linalg.norm(poses.orientation, axis=1) - 1.0)
    off = np.where(np.isfinite(poses.position).all(axis=1) & np.isfinite(off), off, np.inf)
    # The opposite quaternion is the same rotation, but a jump of its numbers.
    off[1:][(poses.orientation[1:] * poses.orientation[:-1]).sum(axis=1) < 0.0] = np.inf
    return np.asarray(off)


def _carried(result: Result) -> list[Claim]:
    """Judge an object that a script of the catalogue, with samples at the ticks, carries, or that is said to stand."""
    script, fixed = own_script(result), result.scene.get("object_pose") == "fixed"
    step = 0.0 if script is None else script.rate / result.rate
    if result.body.is_free or not result.frame or not (fixed or (step > 0.0 and step.is_integer())):
        return []
    says = "the object moves where the scene says so, as its script carries it"
    if sent := result.scene.get("submission", {}).get("bodies"):
        note = f"{', '.join(sent)}: free, and shown where a submission has it; hhsim score measures its motion"
        return [Claim("carried", says, NOT_JUDGED, unit="m, 1", note=note)]
    poses, off, note = result.poses(result.frame), np.full(result.ticks, np.inf), "the scene says that it is fixed"
    if script is not None and not fixed:
        start, last = result.body.place if len(result.bodies) == 1 else poses.at(0), script.sample_count - 1
        samples = np.minimum(int(step) * np.arange(result.ticks), last)
        note, moved = "", carried(script, np.arange(last + 1) / script.rate, start[0])
        if moved is not None:
            position, orientation = (np.tile(values, (last + 1, 1)) for values in start)
            own = ObjectMotion(moved.points(position), moved.orientations(orientation)).at(samples)
            off = np.max([np.abs(a - b).max(axis=1) for a, b in zip(poses, own)], axis=0)
    return [judged("carried", says, off, SAME, "m, 1", "rounding", ticks=np.arange(result.ticks), note=note)]


def _at_first(result: Result) -> list[Claim]:
    """Judge where the frame that hands are solved in begins, which is where the meshes are."""
    if not result.frame:
        return []
    poses, body, free = result.poses(result.frame).at(0), result.body, result.body.is_free
    place = body.place if len(result.bodies) == 1 or free else poses
    first = max(float(np.abs(values - stored).max()) for values, stored in zip(poses, place, strict=True))
    tolerance = 0.0
    if free:
        # A quaternion changes by half the turn, and the origin of the frame goes round the centre of mass.
        arm = np.linalg.norm(np.array(body.properties["center"]) - body.place.position)
        turn = np.linalg.norm(body["angular_velocity"][0]) * max(0.5, float(arm))
        tolerance = ABOVE + float(np.linalg.norm(body["velocity"][0]) + turn) / result.rate
    why = "its first step, and what it may be raised by to stand on its table" if free else "the same numbers"
    return [judged("body at first", "its mesh and tree lie where its first pose is", [first], tolerance, "m, 1", why)]


def _declared(result: Result, again: bool) -> list[Claim]:
    """Judge several bodies against the file that declares them."""
    if len(result.bodies) == 1:
        return []
    name, says = ("bodies as declared", "each body is where its file has it at every tick, with its joint and numbers")
    try:
        found, note = _placed(result, again), "none that declares them is there; --again reads files"
    except HhsimError as error:
        found, note = None, f"they cannot be made again: {error}"
    if found is None:
        return [Claim(name, says, NOT_JUDGED, unit="m", note=note)]
    off, wrong = np.zeros(result.ticks), []
    declared = {body.name: body for body in found if isinstance(body, scene_body.Body)}
    plane = next((body for body in found if isinstance(body, scene_body.HalfSpace)), None)
    if declared.keys() != result.bodies.keys():
        wrong.append(f"there are {', '.join(result.bodies)}, and declared {', '.join(declared)}")
    for each in set(declared) & set(result.bodies):
        stored = result.bodies[each]
        body = _risen(declared[each], stored)
        off = np.maximum(off, _off_place(body, stored))
        wrong += [f"{each} has another {label}" for label in _other_labels(body, plane, stored)]
    off[0] = np.inf if wrong else off[0]
    ticks = np.arange(result.ticks)
    return [judged(name, says, off, SAME, "m", "rounding of products of poses", ticks=ticks, note="; ".join(wrong))]


def _placed(result: Result, again: bool) -> tuple[scene_body.Body | scene_body.HalfSpace, ...] | None:
    """Bodies of a result at its ticks as their file declares them; None where it is not available."""
    scene, word = result.scene, str(result.scene.get("object") or "")
    known = word in body_file_names() or (again and names_a_file(word) and not names_a_linkage(word))
    if not known or "recording" in scene or scene.get("placement") or not scene.get("trajectory"):
        return None
    motion = resolve_trajectory(str(scene["trajectory"]), scene.get("reading"))
    bodies = load_bodies(word, motion, solid=solid_of(result))
    if bodies.mesh.sha256 != scene.get("object_mesh"):
        return None
    trees = {name: stored_tree(result.bodies[name]) for name in bodies.meshes if name in result.bodies}
    at = motion if isinstance(motion, Trajectory) else SimpleNamespace(object_position=np.zeros(3), name="")
    place = np.array(at.object_position), np.array(getattr(at, "object_orientation", (1.0, 0.0, 0.0, 0.0)))
    frame: Any = SimpleNamespace(object_position=place[0], object_orientation=place[1], name=at.name)
    carrier = result.poses(FRAME) if result.frame == FRAME else None
    ticks: Any = SimpleNamespace(time=np.asarray(result["time"]), object_motion=carrier)
    placed = replace(bodies, trees=trees).placed(ticks, frame)
    if result.live is None:
        return placed
    # In a session driven bodies stay where they begin.
    return tuple(
        replace(body, motion=scene_body.Fixed())
        if isinstance(body, scene_body.Body) and isinstance(body.motion, scene_body.Driven)
        else body
        for body in placed
    )


def _risen(body: scene_body.Body, stored: Body) -> scene_body.Body:
    """Return a free body where it may have been raised off the spheres of another one."""
    motion, way = body.motion, float(stored.vertices[0, 2] - body.placed_mesh.vertices[0, 2])
    if not isinstance(motion, scene_body.Free) or stored.result.surface != "spheres" or not 0.0 < way <= MOST_RAISED:
        return body
    x, y, z = motion.center
    return replace(body, position=body.position + [0.0, 0.0, way], motion=replace(motion, center=(x, y, z + way)))


def _off_place(body: scene_body.Body, stored: Body) -> FloatArray:
    """Distance [m] of a stored body from a declared one at the ticks, infinite for another mesh, shape (T,)."""
    mesh, count = body.mesh, stored.result.ticks
    if mesh.vertices.shape != stored.vertices.shape or not np.array_equal(mesh.faces, stored.faces):
        return np.full(count, np.inf)
    # Beside a free body the mesh is stored in the world at the start, else in the body's own frame.
    begun = body.placed_mesh if stored.result.body.is_free else mesh
    whole = np.abs(stored.vertices - begun.vertices).max()
    off = np.full(count, np.inf if (stored.kind == "free") != isinstance(body.motion, scene_body.Free) else whole)
    if stored.kind == "free":
        return off
    poses = ObjectMotion(np.tile(body.position, (count, 1)), np.tile(body.orientation, (count, 1)))
    if isinstance(body.motion, scene_body.Driven):
        poses = body.motion.poses
        if "joint" in stored and body.motion.values is not None:
            off = np.maximum(off, np.abs(stored["joint"] - body.motion.values))
    if "recorded_position" in stored:
        given = ObjectMotion(stored["recorded_position"], stored["recorded_orientation"])
    else:
        given = stored.poses()
    # Three corners that lie far apart tell where a body is.
    some = np.unique(np.concatenate([mesh.vertices.argmin(axis=0), mesh.vertices.argmax(axis=0)]))
    here, there = (
        rotations(of.orientation)[0].as_matrix() @ corners[some].T + of.position[:, :, None]
        for of, corners in ((given, stored.vertices), (poses, mesh.vertices))
    )
    return np.asarray(np.maximum(off, np.abs(here - there).max(axis=(1, 2))))


def _other_labels(body: scene_body.Body, plane: scene_body.HalfSpace | None, stored: Body) -> list[str]:
    """Names of the stored properties of a body that are not those declared."""
    joint, own = body.joint, dict[str, Any]()
    if not stored.result.body.is_free:
        own = {"joint": asdict(joint)} if joint is not None and "joint" in stored else {}
    else:
        own = {"friction": body.friction, "torsion": body.torsion, "table": plane and plane.height}
        own["table_friction"] = plane and plane.friction
    if isinstance(body.motion, scene_body.Free):
        own |= asdict(body.motion)
        if joint is not None:
            limits = joint.limits and [limit - joint.value for limit in joint.limits]
            of_slider = {"axis": joint.axis, "limits": limits, "friction": joint.friction, "on": joint.on}
            own[joint.type] = of_slider | ({"origin": joint.origin} if joint.type == "hinge" else {})
    return [label for label, value in own.items() if not _alike(stored.properties.get(label), value)]


def _alike(one: Any, other: Any) -> bool:
    """Return True for equal plain values, numbers but for rounding."""
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        return one.keys() == other.keys() and all(_alike(one[key], other[key]) for key in one)
    if isinstance(one, list | tuple) and isinstance(other, list | tuple):
        return len(one) == len(other) and all(map(_alike, one, other))
    if isinstance(one, int | float) and isinstance(other, int | float):
        return bool(abs(one - other) <= SAME * (1.0 + abs(one)))
    return bool(one == other)
