"""Claims of joints: those of the hand follow from angles within limits; a body turns about, or moves along, its axis.

A body's joint keeps its limits, and moves by the forces on it.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.result.body import Body
from hhsim.result.reader import Result
from hhsim.verify.claim import NOT_CLAIMED, Claim, judged
from hhsim.verify.force_checks import AT_LIMIT, FORCE
from hhsim.verify.free_motion import FreeBody
from hhsim.verify.kinematics import rotations
from hhsim.verify.tick_data import LENGTH, WHY_LENGTH, JudgedTicks

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

ANGLE = 1e-9
"""Tolerance of angles [rad]."""
MOVES = 1e-6
"""Speed beyond which a joint moves, and its friction is against that [rad/s, m/s]."""
JOINED = 2e-6
"""Distance that two free bodies may come off their joint [m, rad]."""
WHY_JOINT = "a nanometre; a millionth of the forces"


def posture_claims(judge: JudgedTicks) -> list[Claim]:
    """Judge the joints of the shown hand and their limits."""
    result, hand, at, ticks = judge.result, judge.hand, judge.shown, judge.numbers
    unit = np.abs(np.linalg.norm(at.orientation, axis=1) - 1.0)
    # The opposite quaternion is the same rotation, but a jump of its numbers.
    unit[1:][(at.orientation[1:] * at.orientation[:-1]).sum(axis=1) < 0.0] = np.inf
    off = np.linalg.norm(judge.posed.joints - result["graphic/joints"], axis=3).max(axis=(1, 2))
    off = np.maximum(off, np.where(unit <= ANGLE, 0.0, np.inf))
    says = "the joints are those of the stored angles and pose, whose quaternions are unit and change no sign"
    kinematics = judged("kinematics", says, off, LENGTH, "m", WHY_LENGTH, ticks=ticks)
    beyond = np.maximum(hand.flexion_min - at.flexion, at.flexion - hand.flexion_max).max(axis=(1, 2))
    beyond, says = np.maximum(0.0, beyond), "no joint is beyond its limit"
    limits = judged("joint limits", says, beyond, ANGLE, "rad", "rounding of the solver's steps", ticks=ticks)
    if not result.gives("status"):
        note = f"of a method that is not hhsim's; its joints are up to {beyond.max(initial=0.0):.3g} rad beyond"
        limits = replace(limits, verdict=NOT_CLAIMED, note=note)
    return [kinematics, limits]


def joint_claims(result: Result) -> list[Claim]:
    """Judge the driven bodies on joints, at every tick; none without such a body."""
    off = [_off_joint(result, body, joint) for body in result.bodies.values() if (joint := body.joint)]
    says = "a driven body turns about, or moves along, its axis on what bears it, as far as the joint's value says, "
    says += "within its limits"
    ticks = np.arange(result.ticks)
    worst = np.nan_to_num(np.max(off, axis=0), nan=np.inf) if off else None
    return [] if worst is None else [judged("joints", says, worst, LENGTH, "m, rad", "rounding", ticks=ticks)]


def _off_joint(result: Result, body: Body, joint: Mapping[str, Any]) -> FloatArray:
    """Compute how far a driven body is off its joint, its value or its limits [m, rad], shape (T,)."""
    frame = result.poses(result.frame) if result.frame else None
    bearer = result.bodies[joint["on"]].poses() if joint["on"] else frame
    own, origin = body.poses(), np.array(joint["origin"])
    turned = rotations(own.orientation)[0]
    # A point of the world at the first tick goes along with the body, and back along with what bears it.
    there, turned = turned[0].inv().apply(origin - own.position[0]), turned * turned[0].inv()
    place = own.position + (turned * rotations(own.orientation[:1])[0][0]).apply(there)
    if bearer is not None:
        carried = rotations(bearer.orientation)[0]
        back = carried[0] * carried.inv()
        place, turned = back.apply(place - bearer.position) + bearer.position[0], back * turned
    value, off = along_joint(joint, joint["type"] == "hinge", place - origin, turned)
    stored, (least, most) = np.asarray(body["joint"]), joint["limits"] or (-np.inf, np.inf)
    apart = value - (stored - joint["value"])
    if joint["type"] == "hinge":
        apart = np.angle(np.exp(1j * apart))
    return np.asarray(np.maximum.reduce([off, np.abs(apart), least - stored, stored - most]))


def along_joint(
    joint: Mapping[str, Any], is_hinge: bool, way: FloatArray, turned: "Rotation"
) -> tuple[FloatArray, FloatArray]:
    """Compute the value of a joint [rad, m] and the distance off its axis [m, rad], (N,) each, of N poses.

    `way` (N, 3) [m] is that of a point of the axis, `turned` the rotations since the first.
    """
    axis = np.array(joint["axis"]) / np.linalg.norm(joint["axis"])
    value = turned.as_rotvec() @ axis if is_hinge else way @ axis
    kept = [way, turned.apply(axis) - axis] if is_hinge else [way - np.outer(value, axis), turned.as_rotvec()]
    return np.asarray(value), np.asarray(np.linalg.norm(kept, axis=2).max(axis=0))


def _beside(body: FreeBody, bearer: FreeBody | None) -> tuple[FloatArray, FloatArray]:
    """Compute the value of a free body's joint, (T + 1,), and how far the body is off it or its limits, (T,)."""
    hinge, joint = body.free.get("hinge"), body.joint or {}
    origin = np.array(hinge["origin"] if hinge else body.free["center"])
    way, turned = body.moved(origin) - origin, body.turned
    if bearer is not None:
        back = bearer.turned.inv()
        way, turned = back.apply(body.moved(origin) - bearer.moved(origin)), back * turned
    (value, off), limits = along_joint(joint, bool(hinge), way, turned), joint["limits"] or (-np.inf, np.inf)
    return value, np.maximum(off, np.maximum(limits[0] - value, value - limits[1]))[1:]


def held_claim(body: FreeBody) -> Claim:
    """Judge the motion of a free body whose joint is on what stands still or is driven, by the forces on it."""
    hinge, joint = body.free.get("hinge"), body.joint or {}
    axis = np.array(joint["axis"]) / np.linalg.norm(joint["axis"])
    value, off = _beside(body, None)
    off /= LENGTH
    if hinge:
        speed = body.spin @ axis
        inertia, pushed, size = _about(body, axis, speed)
        does = "turns about its hinge, within its limits, as moments"
    else:
        speed, inertia, size = body.velocity @ axis, body.mass, FORCE * body.size
        pushed = (body.borne[:, :3] + body.mass * body.gravity) @ axis
        does = "moves along its slider, within its limits, as forces"
    # What is left is the joint's own: friction, and at a limit what it bears.
    own = inertia / body.period * ((1.0 + body.damping * body.period) * speed[1:] - speed[:-1]) - pushed
    wrong = _beyond_friction(joint, value[1:], speed[1:], own) / size
    off[body.whole] = np.maximum(off, wrong)[body.whole]
    says = f"{body.name} only {does}, weight and friction have it"
    name, note = "hinge" if hinge else "slider", body.left_out and f"forces: {body.left_out}"
    return judged(name, says, off, 1.0, "1", WHY_JOINT, ticks=body.ticks, note=note)


def _about(body: FreeBody, axis: FloatArray, spin: FloatArray) -> tuple[float, FloatArray, FloatArray]:
    """Moment of inertia about a hinge [kg·m²], moments on it [N·m] and their tolerance, (T,) each."""
    from scipy.spatial.transform import Rotation

    origin, wrench, mass = np.array(body.free["hinge"]["origin"]), body.borne, body.mass
    arm = body.center - origin
    arm -= np.outer(arm @ axis, axis)
    length = float(np.linalg.norm(arm[0]))
    middle = Rotation.from_rotvec(np.outer(0.5 * body.period * spin[:-1], axis)).apply(arm[:-1])
    pushed = (wrench[:, 3:] + np.cross(arm[:-1], wrench[:, :3]) + mass * np.cross(middle, body.gravity)) @ axis
    size = FORCE * (body.size + np.abs(wrench[:, 3:]).sum(axis=1)) * (1.0 + length)
    # The forces are in the directions of the last program's begin; the speed, by which weight turns, changes meanwhile.
    turned, faster = body.turned_in_programs, np.abs(np.diff(spin)) * body.period
    force, weight = np.abs(wrench[:, :3]).sum(axis=1), mass * np.linalg.norm(body.gravity)
    size += length * ((turned + faster) * force + faster * weight)
    return float(axis @ body.inertia @ axis + mass * length**2), pushed, size


def pair_claim(body: FreeBody, bearer: FreeBody) -> Claim:
    """Judge the motion of a free body beside the one that bears its joint: about or along the axis, within limits."""
    _, off = _beside(body, bearer)
    says = f"{body.name} only turns or moves beside {bearer.name} as its joint lets it, within its limits"
    why, ticks = "twice that of a program", body.whole
    return judged("joint", says, off[ticks], JOINED, "m, rad", why, ticks=ticks, note=body.left_out)


def _beyond_friction(joint: Mapping[str, Any], value: FloatArray, speed: FloatArray, own: FloatArray) -> FloatArray:
    """Return by how much a joint's own force or moment is no dry friction, (T,); what a limit bears is none of it."""
    least, most = joint["limits"] or (-np.inf, np.inf)
    moves, friction = np.abs(speed) > MOVES, joint["friction"]
    against = -friction * np.sign(speed)
    beyond = np.where(value <= least + AT_LIMIT, 0.0, own - np.where(moves, against, friction))
    short = np.where(value >= most - AT_LIMIT, 0.0, np.where(moves, against, -friction) - own)
    return np.maximum(beyond, short)
