"""Free bodies of a scene as a submission shows them: driven by its poses, and judged by their places and motion."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import combinations

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.quaternion import rotation_matrix
from hhsim.metrics.mesh_penetration import sampled
from hhsim.metrics.run_metric import Figure
from hhsim.motion.trajectory import ObjectMotion, RigidMotion
from hhsim.scene.body import Body, Driven, Free
from hhsim.scene.overlap import Solid, overlap
from hhsim.scene.scene import Scene
from hhsim.solver.scene_solver import SeenScene, along, seen_hand
from hhsim.submissions.pose_file import Submission
from hhsim.submissions.scene_file import free_bodies

LOOKED_AT = 200
"""Ticks at most in which bodies are looked for in each other, evenly spread."""
ALONE = 1e-3
"""Distance [m] of boxes around two bodies from which on they do not touch."""

BODY_DEPTH = Figure("body_depth_max", "bodies in each other, max", 3, "mm")
UNEXPLAINED = Figure("unexplained_force_mean", "force that the body's motion lacks, mean", 3, "N")


def shown_scene(scene: Scene, submission: Submission) -> Scene:
    """Return the scene with its free bodies driven by the poses of a submission."""
    moved = {body.name: _driven(body, submission.bodies[name]) for name, body in free_bodies(scene).items()}
    return replace(scene, bodies=tuple(moved.get(body.name, body) for body in scene.bodies))


def _driven(body: Body, shown: ObjectMotion) -> Body:
    to, count = RigidMotion(shown.orientation, shown.position), (len(shown.position), 1)
    places, turns = to.points(np.tile(body.position, count)), to.orientations(np.tile(body.orientation, count))
    first = {"position": places[0], "orientation": turns[0]}
    return replace(body, motion=Driven(ObjectMotion(places, turns)), joint=None, **first)


def as_seen(submission: Submission, seen: SeenScene, shown: SeenScene) -> Submission:
    """Return a submission, in the frame of its scene, in that of the shown one, which may go along with a body."""
    if seen.carrier is shown.carrier:
        return submission

    def moved(hand: Submission) -> Submission:
        world = hand.poses
        if seen.carrier is not None:
            frame = along(seen.carrier)
            places, turns = frame.points(world.position), frame.orientations(world.orientation)
            world = world._replace(position=places, orientation=turns)
        poses = world if shown.carrier is None else seen_hand(world, along(shown.carrier))
        turned = [] if seen.carrier is None else [rotation_matrix(along(seen.carrier).turn)]
        turned += [] if shown.carrier is None else [rotation_matrix(along(shown.carrier).turn).swapaxes(1, 2)]
        phalanx, palm = hand.phalanx_force, hand.palm_force
        for turn in turned:
            phalanx = None if phalanx is None else np.einsum("tij,tfkj->tfki", turn, phalanx)
            palm = None if palm is None else np.einsum("tij,tj->ti", turn, palm)
        left = None if hand.left is None else moved(hand.left)
        return replace(hand, poses=HandConfiguration(*poses), phalanx_force=phalanx, palm_force=palm, left=left)

    return moved(submission)


def body_figures(scene: Scene, shown: Scene, submission: Submission) -> tuple[dict[Figure, float], tuple[str, ...]]:
    """Measure where and how free bodies are shown; returns figures, SI, and sentences on what is not judged."""
    free = free_bodies(scene)
    if not free:
        return {}, ()
    found, notes = {}, []
    if len(scene.bodies) > 1:
        found[BODY_DEPTH] = _depth(shown, {body.name for body in free.values()})
    (name, body), *more = free.items()
    why = ""
    if submission.phalanx_force is None:
        why = "the submission has no forces"
    elif more or body.joint is not None:
        why = f"several bodies, or a joint, bear forces that are not those on the hand{'' if body.joint else 's'}"
    else:
        lacks = _unexplained(shown, body, submission.bodies[name], submission)
        if lacks.size:
            found[UNEXPLAINED] = float(lacks.mean())
        else:
            why = "the body is never clear of what else bears it"
    if why:
        notes.append(f"the motion of {', '.join(free)} by mass and forces is not judged: {why}")
    return found, tuple(notes)


def _depth(shown: Scene, moving: set[str]) -> float:
    """Return the largest depth of a free body in another body or below the plane [m]."""
    ticks, deepest = sampled(np.arange(shown.ticks.tick_count), LOOKED_AT), 0.0
    joined = {frozenset((body.name, body.joint.on)) for body in shown.solids if body.joint}
    pairs = [
        (one, other)
        for one, other in combinations(shown.solids, 2)
        if {one.name, other.name} & moving and frozenset((one.name, other.name)) not in joined
    ]
    for i in ticks.tolist():
        meshes = {body.name: body.mesh.transformed(*_place(body, i)) for body in shown.solids}
        if shown.plane is not None:
            low = min(float(meshes[name].bounds[0, 2]) for name in moving)
            deepest = max(deepest, shown.plane.height - low)
        near = [pair for pair in pairs if _gap(*(meshes[body.name].bounds for body in pair)) <= 0.0]
        deepest = max(deepest, *(overlap(*(Solid(meshes[body.name]) for body in pair)) for pair in near), 0.0)
    return deepest


def _place(body: Body, i: int) -> tuple[FloatArray, FloatArray]:
    poses = body.motion.poses.at(i) if isinstance(body.motion, Driven) else (body.position, body.orientation)
    return rotation_matrix(poses[1]), poses[0]


def _gap(one: FloatArray, other: FloatArray) -> float:
    """Return the largest distance of two boxes along an axis [m], negative where they meet."""
    return float(np.maximum(one[0] - other[1], other[0] - one[1]).max())


def _unexplained(shown: Scene, body: Body, poses: ObjectMotion, submission: Submission) -> FloatArray:
    """Return the forces [N] that a body's motion lacks in ticks in which hands alone touch it."""
    free, rate = body.motion, shown.ticks.rate
    assert isinstance(free, Free)
    center = RigidMotion(poses.orientation, poses.position).points(np.tile(free.center, (len(poses.position), 1)))
    speed = rate * np.diff(center, axis=0)
    lacks = free.mass * (rate * np.diff(speed, axis=0) + free.damping * speed[1:] - np.array(free.gravity))
    for hand in submission.hands:
        for forces in (hand.phalanx_force, hand.palm_force):
            # What a hand bears the body bears the other way round.
            lacks += 0.0 if forces is None else forces.reshape(len(forces), -1, 3).sum(axis=1)[2:]
    return np.asarray(np.linalg.norm(lacks, axis=1)[[*_alone(shown, body.name)]])


def _alone(shown: Scene, name: str) -> Iterator[int]:
    """Yield the ticks, counted from the third one on, in which nothing but a hand may touch a body."""
    for i in range(2, shown.ticks.tick_count):
        boxes: Mapping[str, FloatArray] = {
            body.name: body.mesh.transformed(*_place(body, i)).bounds for body in shown.solids
        }
        clear = all(_gap(boxes[name], box) > ALONE for other, box in boxes.items() if other != name)
        if clear and (shown.plane is None or boxes[name][0, 2] - shown.plane.height > ALONE):
            yield i - 2
