"""Mistakes of a submission: another scene or other ticks are refused, poses and forces that no method makes suspected.

Where nothing is near the user's hand, every method shows it as it is. A deviation there is a mistake in unit, frame,
order or time.
"""

from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations

import numpy as np

from hhsim.arrays import BoolArray, FloatArray
from hhsim.errors import InputError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.forward_kinematics import forward_kinematics, hand_shape
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import rotation_matrix
from hhsim.metrics.mesh_penetration import sampled
from hhsim.metrics.metrics import hand_clearance
from hhsim.metrics.run_metric import Figure
from hhsim.motion.trajectory import ObjectMotion, RigidMotion
from hhsim.scene.body import Body, Driven
from hhsim.scene.overlap import Solid, overlap
from hhsim.scene.scene import Scene
from hhsim.solver.scene_solver import SeenScene, along, seen_hand, seen_scene
from hhsim.submissions.pose_file import Submission
from hhsim.submissions.scene_folder import free_bodies, scene_digest, scene_names, scene_title
from hhsim.system.counted import counted

FREE_DISTANCE = 2e-3
"""Distance of the user's hand from the object [m] beyond which the shown hand is the user's."""
LEAST_FREE_TICKS = 20
"""Least number of free ticks; of a scene with fewer, all ticks are compared."""
MOST_BEGUN = 2e-3
"""Largest way [m] that a body may have made in the first tick."""
FOLLOWS = 1e-3
"""Deviation of palms from the user's [m] above which they do not follow it."""
ANGLE_TOLERANCE = 0.02
"""Deviation of palms and joints from the user's [rad] above which they do not follow it."""
MOST_LAG = 5e-3
"""Lag behind the user's hand that is no mistake [s]: of a mass, or of a hand that shows the last reading."""
MOST_OFF = 0.25
"""Largest deviation of a stamp from its tick [ticks]."""
MOST_FORCE = 1000.0
"""Largest plausible contact force [N]."""
MOST_DURATION = 1.0
"""Longest plausible time of a tick [s]; a longer one is in another unit."""


def require_scene(submission: Submission, scene: Scene) -> None:
    """Raise InputError unless a submission is of this scene, with a pose for each of its ticks."""
    digest = scene_digest(scene)
    if not submission.scene:
        raise InputError(f"{_name(submission)} does not say its scene: expected # scene: {digest}")
    if len(submission.scene) < 8 or not digest.startswith(submission.scene.lower()):
        theirs = scene_title(submission.made_by) if submission.made_by else "another scene"
        raise InputError(
            f"{_name(submission)} is of {theirs} (scene {submission.scene[:12]}), and this is "
            f"{scene_title(scene_names(scene))} (scene {digest[:12]})"
        )
    sides, own = [hand.model.side for hand in scene.hands], [hand.hand for hand in submission.hands]
    if len(sides) != len(own):
        counts = [counted(len(hands), "hand") for hands in (own, sides)]
        raise InputError(f"{_name(submission)} is of {counts[0]}: the scene has {counts[1]}")
    if own[0] not in ("", sides[0]):
        raise InputError(f"{_name(submission)} is of a {own[0]} hand: the scene has a {sides[0]} one")
    free = free_bodies(scene)
    for name in [*free, *submission.bodies]:
        if (name in free) != (name in submission.bodies):
            there, found = ", ".join(free) or "none", ", ".join(submission.bodies) or "none"
            raise InputError(f"{_name(submission)} has poses of bodies {found}; expected those that are free: {there}")
    time, wanted, rate = submission.time, scene.ticks.time, scene.ticks.rate
    both = min(len(time), len(wanted))
    off = np.flatnonzero(np.abs(time[:both] - wanted[:both]) * rate > MOST_OFF)
    if off.size or len(time) != len(wanted):
        first = f"tick {off[0]:,} is at {time[off[0]]:.6g} s" if off.size else f"it has {counted(len(time), 'tick')}"
        expected = f"expected {counted(len(wanted), 'tick')}, {rate:g} a second, from 0 s on"
        raise InputError(f"{_name(submission)}: {first}; {expected}")


def _name(submission: Submission) -> str:
    return str(submission.path or submission.method)


def suspicions(submission: Submission, scene: Scene) -> tuple[str, ...]:
    """Describe probable mistakes in poses, forces and times of a submission of this scene, a line each."""
    seen, sides = seen_scene(scene), [hand.model.side for hand in scene.hands]
    found = [*_body_mistakes(submission)]
    moved = shown_scene(scene, submission)
    for side, hand, shown, user in zip(sides, scene.hands, submission.hands, seen.haptic):
        whose = f"{side} hand: " if len(sides) > 1 else ""
        free = _free(moved, hand.model, HandConfiguration.of(hand.ticks))
        found += [f"{whose}{text}" for text in _hand_mistakes(shown, free, user, scene.ticks.rate)]
    if submission.duration is not None and float(np.median(submission.duration)) > MOST_DURATION:
        found.append(f"a tick takes {np.median(submission.duration):,.6g} s: microseconds?")
    return tuple(found)


def _body_mistakes(submission: Submission) -> Iterator[str]:
    """Describe bodies that do not begin where they are."""
    for name, poses in submission.bodies.items():
        off = float(np.linalg.norm(poses.position[0]))
        turned = 2.0 * float(np.arccos(np.clip(abs(poses.orientation[0, 0]), 0.0, 1.0)))
        if off > MOST_BEGUN or turned > ANGLE_TOLERANCE:
            place = f"{1e3 * off:,.3g} mm and {turned:.3g} rad off the place of {name}.obj"
            yield f"{name} begins {place}: another unit, frame or order, or the pose of another frame of it?"


def _hand_mistakes(submission: Submission, free: BoolArray, user: HandConfiguration, rate: float) -> Iterator[str]:
    """Describe mistakes in the poses and forces of one hand; `free` are the ticks in which nothing is near."""
    shown, ticks = submission.poses, np.flatnonzero(free)

    def median_off(lag: int) -> FloatArray:
        """Return how far palm [m], its turn, flexion and abduction [rad] are from the user's, so many ticks before."""
        now, then = shown.at(ticks), user.at(np.maximum(ticks - lag, 0))
        turn = np.abs(np.einsum("ti,ti->t", now.orientation, then.orientation))
        joints = [
            np.abs(one - other).reshape(len(ticks), -1).max(axis=1)
            for one, other in ((now.flexion, then.flexion), (now.abduction, then.abduction))
        ]
        off = [np.linalg.norm(now.position - then.position, axis=1), 2.0 * np.arccos(np.clip(turn, 0.0, 1.0)), *joints]
        return np.asarray(np.median(off, axis=1))

    lags = range(int(MOST_LAG * rate) + 1)
    off = min((median_off(lag) for lag in lags), key=lambda each: float(each[0]))
    parts = (
        "the palm is {:.3g} m",
        "the palm is turned by {:.3g} rad",
        "flexion is {:.3g} rad",
        "abduction is {:.3g} rad",
    )
    wrong = [
        text.format(value)
        for text, value, limit in zip(parts, off, (FOLLOWS, *[ANGLE_TOLERANCE] * 3), strict=True)
        if value > limit
    ]
    for text in wrong:
        yield f"{text} off the user's where nothing is near: another unit, frame, order or time?"
    if submission.phalanx_force is None:
        return
    total = submission.phalanx_force.sum(axis=(1, 2))
    total = total if submission.palm_force is None else total + submission.palm_force
    size = np.linalg.norm(total, axis=1)
    if size.max() > MOST_FORCE:
        yield f"a force of {size.max():,.6g} N: millinewtons?"
    if wrong:
        # Of poses in another frame no direction tells anything.
        return
    # Contact forces point from the user's hand to the shown one.
    away = shown.position - user.position
    along = float(np.einsum("ti,ti->t", total, away).sum())
    if along < -0.5 * float((size * np.linalg.norm(away, axis=1)).sum()):
        yield "forces pull the hand towards the user's: meant are those on the hand; those on the object?"


def _free(scene: Scene, hand: HandModel, user: HandConfiguration) -> BoolArray:
    """Return True for ticks in which the user's hand, in the world, is far from the bodies."""
    placed, free = forward_kinematics(hand, *user), np.ones(user.ticks, bool)
    for body in scene.solids:
        tree, there = body.placed_tree, placed
        if isinstance(body.motion, Driven):
            poses = body.motion.poses
            tree, there = body.tree, RigidMotion(poses.orientation, poses.position).seen_hand(placed)
        palm, finger = hand_clearance(tree.arrays(), hand_shape(hand), there, limit=FREE_DISTANCE)
        free &= np.minimum(palm, finger.min(axis=1)) >= FREE_DISTANCE
    return free if free.sum() >= LEAST_FREE_TICKS else np.ones(len(free), bool)


LOOKED_AT = 200
"""Ticks at most in which bodies are looked for in each other, evenly spread."""

BODY_DEPTH = Figure("body_depth_max", "bodies in each other, max", 3, "mm")


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


def body_depth(scene: Scene, shown: Scene) -> float:
    """Return the largest depth of a free body of a scene, as it is shown, in another body or below the plane [m]."""
    moving = {body.name for body in free_bodies(scene).values()}
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
