"""View from a moving object, by scipy's rotations, and the claims of the object's motion.

A pose p, q of an object that began at P, Q maps x to q Q⁻¹ (x − P) + p; this is inverted.
"""

import numpy as np

from hhsim.arrays import AnyArray
from hhsim.motion.trajectory import ObjectMotion
from hhsim.result.object_frame import TURNS
from hhsim.result.reader import Result
from hhsim.scene.synthesis import carried
from hhsim.verify.claim import Claim, judged
from hhsim.verify.file_checks import own_script
from hhsim.verify.kinematics import rotations

ABOVE = 1e-6
"""Largest initial height of a free object above its place [m], from the solver's offset to the table."""


def seen_by_referee(name: str, values: AnyArray, now: ObjectMotion, first: ObjectMotion) -> AnyArray:
    """Transform rows of a /tick dataset from the world to the object's frame, as `hhsim.result.reader.View`."""
    here, none = rotations(now.orientation)
    there = rotations(first.orientation[None])[0]
    back = there * here.inv()
    if TURNS[name] == "orientation":
        turned, neither = rotations(values)
        seen = (back * turned).as_quat()[:, [3, 0, 1, 2]]
        none |= neither
    else:
        rows = np.asarray(values, np.float64).reshape(len(values), -1, 3)
        matrix = back.as_matrix()
        at_point = TURNS[name] == "point"
        moved = rows - now.position[:, None] if at_point else rows
        seen = np.einsum("tij,tnj->tni", matrix, moved) + (first.position if at_point else 0.0)
    seen[none] = np.nan
    return np.asarray(seen.reshape(values.shape))


def _first_step(result: Result) -> float:
    """Largest first step of a free object [m], from its place in the file or `ABOVE` it.

    A quaternion changes by half the turn, and the origin of the frame goes round the centre of mass.
    """
    arm = np.linalg.norm(np.array(result.scene["free"]["center"]) - result.static["object/position"])
    turn = np.linalg.norm(result["object/angular_velocity"][0]) * max(0.5, float(arm))
    return ABOVE + float(np.linalg.norm(result["object/velocity"][0]) + turn) / result.rate


def object_motion_claims(result: Result) -> list[Claim]:
    """Judge a moving object's poses: valid, from the object's place on, and the script's; and those of parts."""
    if not result.driven:
        return _poses_of_parts(result)
    poses, static = result.object_motion(), result.static
    off = np.abs(np.linalg.norm(poses.orientation, axis=1) - 1.0)
    off = np.where(np.isfinite(poses.position).all(axis=1) & np.isfinite(off), off, np.inf)
    # The opposite quaternion is the same rotation, but a jump of its numbers.
    off[1:][(poses.orientation[1:] * poses.orientation[:-1]).sum(axis=1) < 0.0] = np.inf
    says, note = "the object has a pose at every tick, with a unit quaternion", ""
    if not result.free:
        says += ", where the scene says that it moves"
        if result.scene.get("object_pose") == "fixed":
            off[:], note = np.inf, "the scene says that it is fixed"
        own = _of_the_script(result)
        if own is not None:
            says += ", and as its script carries it"
            off = np.max([off, *(np.abs(a - b).max(axis=1) for a, b in zip(poses, own))], axis=0)
    first = max(float(np.abs(values[0] - static[f"object/{name}"]).max()) for name, values in poses._asdict().items())
    tolerance = _first_step(result) if result.free else 0.0
    why = "its first step, and what it may be raised by to stand on its table" if result.free else "the same numbers"
    poses_claim = judged("object poses", says, off, 1e-9, "m, 1", "rounding", ticks=np.arange(result.ticks), note=note)
    says = "the object's mesh and tree lie where its first pose has them"
    at_first = judged("object at first", says, [first], tolerance, "m, 1", why)
    return [poses_claim, at_first, *_poses_of_parts(result)]


def _poses_of_parts(result: Result) -> list[Claim]:
    off = []
    for part in result.parts:
        unit = np.abs(np.linalg.norm(result[f"{part}/orientation"], axis=1) - 1.0)
        off.append(np.where(np.isfinite(result[f"{part}/position"]).all(axis=1) & np.isfinite(unit), unit, np.inf))
    says = "every part has a pose at every tick, with a unit quaternion"
    ticks = np.arange(result.ticks)
    return [judged("poses of parts", says, np.max(off, axis=0), 1e-9, "1", "rounding", ticks=ticks)] if off else []


def _of_the_script(result: Result) -> ObjectMotion | None:
    """Motion of the object in a script of the catalogue with a sample a tick; None for another motion."""
    script = own_script(result)
    if script is None or script.rate != result.rate:
        return None
    start = [result.static[f"object/{name}"] for name in ("position", "orientation")]
    moved = carried(script, np.arange(script.sample_count) / script.rate, start[0])
    if moved is None:
        return None
    position, orientation = (np.tile(values, (script.sample_count, 1)) for values in start)
    ticks = np.minimum(np.arange(result.ticks), script.sample_count - 1)
    return ObjectMotion(moved.points(position), moved.orientations(orientation)).at(ticks)
