"""Score of a submission: its poses through the same code that measures a method, and its errors and suspicions.

Another scene or other ticks are refused, poses and forces that no method makes suspected. Where nothing is near the
user's hand, every method shows it as it is. A deviation there is a mistake in unit, frame, order or time.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations, compress
from pathlib import Path
from typing import Any

import numpy as np

from hhsim.arrays import BoolArray, FloatArray
from hhsim.errors import HhsimError, InputError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.forward_kinematics import PlacedHand, forward_kinematics, hand_shape
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import rotation_matrix
from hhsim.kernels.tick.block import HapticBlock, TickRecord
from hhsim.kernels.world.record import WorldRecord
from hhsim.metrics.field.hands import Bodies
from hhsim.metrics.mesh_penetration import sampled
from hhsim.metrics.metrics import hand_clearance
from hhsim.metrics.run_metric import Figure
from hhsim.motion.trajectory import ObjectMotion, RigidMotion
from hhsim.replay.reference import best_hands
from hhsim.replay.replay import Replay
from hhsim.replay.summary import ReplaySummary
from hhsim.replay.summary_table import SummaryRow, short_table
from hhsim.replay.verdict import STATED_TIMES
from hhsim.result.writer import add_document
from hhsim.scene.body import Body, Driven
from hhsim.scene.engine_scene import EngineScene, engine_scene, seen_hand
from hhsim.scene.overlap import Solid, overlap
from hhsim.scene.scene import Scene
from hhsim.solver.method import FORCES, SUBMITTED, TIMES, Method
from hhsim.solver.options import SolverOptions
from hhsim.solver.outside_method import MethodScene, OutsideEngine, TickAnswer
from hhsim.solver.solver import SceneSolver
from hhsim.solver.workspace import TickWorkspace
from hhsim.submissions.pose_file import Submission
from hhsim.submissions.scene_folder import SCENE_FILE, free_bodies, named_scene, scene_digest, scene_names, scene_title
from hhsim.system.counted import counted
from hhsim.system.input_file import read_input_text
from hhsim.system.progress import Progress, silent
from hhsim.trees.contact_surface import contact_surface, encloses, put_parts

NEAR = 1e-3
"""Distance of the user's hand from the mesh [m] below which a tick counts for the least-energy pose."""

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
LOOKED_AT = 200
"""Ticks at most in which bodies are looked for in each other, evenly spread."""

BODY_DEPTH = Figure("body_depth_max", "bodies in each other, max", 3, "mm")
# Depth of the hand in the mesh; undefined if the mesh encloses nothing.
MESH_DEPTH = Figure("mesh_depth_max", "in the mesh, max", 3, "mm")
# Distance of the fingertips and the palm from the pose of least coupling energy outside the mesh
# (`hhsim.replay.reference.best_hands`), the largest of each tick in contact.
OFF_BEST = Figure("off_best_mean", "off the least-energy pose, mean", 3, "mm")
OFF_BEST_MAX = Figure("off_best_max", "off the least-energy pose, max", 3, "mm")


def require_scene(submission: Submission, scene: Scene) -> None:
    """Raise InputError unless a submission is of this scene, with a pose for each of its ticks."""
    digest, who = scene_digest(scene), submission.path or submission.method
    if not submission.scene:
        raise InputError(f"{who} does not say its scene: expected # scene: {digest}")
    if len(submission.scene) < 8 or not digest.startswith(submission.scene.lower()):
        theirs = scene_title(submission.made_by) if submission.made_by else "another scene"
        raise InputError(
            f"{who} is of {theirs} (scene {submission.scene[:12]}), and this is "
            f"{scene_title(scene_names(scene))} (scene {digest[:12]})"
        )
    sides, own = [hand.model.side for hand in scene.hands], [hand.hand for hand in submission.hands]
    if len(sides) != len(own):
        counts = [counted(len(hands), "hand") for hands in (own, sides)]
        raise InputError(f"{who} is of {counts[0]}: the scene has {counts[1]}")
    if own[0] not in ("", sides[0]):
        raise InputError(f"{who} is of a {own[0]} hand: the scene has a {sides[0]} one")
    free = free_bodies(scene)
    for name in [*free, *submission.bodies]:
        if (name in free) != (name in submission.bodies):
            there, found = ", ".join(free) or "none", ", ".join(submission.bodies) or "none"
            raise InputError(f"{who} has poses of bodies {found}; expected those that are free: {there}")
    time, wanted, rate = submission.time, scene.ticks.time, scene.ticks.rate
    both = min(len(time), len(wanted))
    off = np.flatnonzero(np.abs(time[:both] - wanted[:both]) * rate > MOST_OFF)
    if off.size or len(time) != len(wanted):
        first = f"tick {off[0]:,} is at {time[off[0]]:.6g} s" if off.size else f"it has {counted(len(time), 'tick')}"
        expected = f"expected {counted(len(wanted), 'tick')}, {rate:g} a second, from 0 s on"
        raise InputError(f"{who}: {first}; {expected}")


def suspicions(submission: Submission, scene: Scene) -> tuple[str, ...]:
    """Describe probable mistakes in poses, forces and times of a submission of this scene, a line each."""
    seen, sides = engine_scene(scene), [hand.model.side for hand in scene.hands]
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
            tree, there = body.tree, body.motion.poses.frame.seen_hand(placed)
        palm, finger = hand_clearance(tree.arrays(), hand_shape(hand), there, limit=FREE_DISTANCE)
        free &= np.minimum(palm, finger.min(axis=1)) >= FREE_DISTANCE
    return free if free.sum() >= LEAST_FREE_TICKS else np.ones(len(free), bool)


def shown_scene(scene: Scene, submission: Submission) -> Scene:
    """Return the scene with its free bodies driven by the poses of a submission."""
    moved = {body.name: _driven(body, submission.bodies[name]) for name, body in free_bodies(scene).items()}
    return replace(scene, bodies=tuple(moved.get(body.name, body) for body in scene.bodies))


def _driven(body: Body, shown: ObjectMotion) -> Body:
    to, count = shown.frame, (len(shown.position), 1)
    places, turns = to.points(np.tile(body.position, count)), to.orientations(np.tile(body.orientation, count))
    first = {"position": places[0], "orientation": turns[0]}
    return replace(body, motion=Driven(ObjectMotion(places, turns)), joint=None, **first)


def as_seen(submission: Submission, frame: RigidMotion) -> Submission:
    """Return a submission, in the world, as a frame that has moved sees it."""
    phalanx, palm, left = submission.phalanx_force, submission.palm_force, submission.left
    return replace(
        submission,
        poses=seen_hand(submission.poses, frame),
        phalanx_force=None if phalanx is None else frame.seen_vectors(phalanx),
        palm_force=None if palm is None else frame.seen_vectors(palm),
        left=left and as_seen(left, frame),
    )


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


def _mesh_depth(seen: EngineScene, hand: HandModel, placed: PlacedHand) -> float:
    """Return the largest depth of a hand in the bodies that enclose a space [m]; NaN where none does."""
    every = Bodies.of(seen.parts or seen.mesh)
    solid = [encloses(mesh) for mesh in every.meshes]
    bodies = Bodies(tuple(compress(every.meshes, solid)), tuple(compress(every.motions, solid)))
    return max(0.0, -float(bodies.clearance(hand_shape(hand), placed, NEAR).min())) if bodies.meshes else np.nan


def _off_best(
    seen: EngineScene, hand: HandModel, haptic: HandConfiguration, options: SolverOptions, placed: PlacedHand
) -> tuple[float, float]:
    if seen.parts is not None:
        # Where bodies move in the frame there is no one surface to be outside of.
        return np.nan, np.nan
    surface = contact_surface("mesh", seen.mesh, seen.tree).arrays
    users = forward_kinematics(hand, *haptic)
    palm, finger = hand_clearance(surface, hand_shape(hand), users, limit=NEAR)
    contact = np.minimum(palm, finger.min(axis=1)) < NEAR
    if not contact.any():
        return np.nan, np.nan
    try:
        best = best_hands(hand, surface, options, haptic)
    except HhsimError:
        return np.nan, np.nan
    off = np.linalg.norm(placed.ends - PlacedHand(best.joints, best.position, best.orientation).ends, axis=2)
    most = off.max(axis=1)[contact]
    return float(most.mean()), float(most.max())


@dataclass(frozen=True)
class HandScore:
    """Table of one hand of a run as `hhsim replay` has it, and what its poses tell besides."""

    summary: ReplaySummary
    errors: Mapping[Figure, float]  # SI; NaN where undefined

    @property
    def rows(self) -> tuple[SummaryRow, ...]:
        """Short table: depths, distances from the best poses, then the run's figures."""
        own = {figure.name: SummaryRow(figure, value) for figure, value in self.errors.items()}
        short = {row.name: row for row in short_table(self.summary.rows, self.summary.verdict.missed)}
        depths = [short.pop("penetration_max", None), own.pop(MESH_DEPTH.name), short.pop("contact_error_max", None)]
        return (*(row for row in depths if row is not None), *own.values(), *short.values())

    def to_json(self) -> dict[str, Any]:
        """Return it as a document, SI units."""
        return {**self.summary.to_json(), **{figure.name: value for figure, value in self.errors.items()}}


@dataclass(frozen=True)
class Score:
    """Hands of a scored run, figures of its free bodies, its probable mistakes, a line each, and the scene's digest."""

    hands: Mapping[str, HandScore]  # by their sides
    bodies: Mapping[Figure, float]
    suspicions: tuple[str, ...]
    scene: str

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences that belong to the table."""
        runs = [hand.summary for hand in self.hands.values()]
        timed = any(row.name.startswith("tick_") for run in runs for row in run.rows)
        said = dict.fromkeys(note for run in runs for note in run.notes)
        return (*((STATED_TIMES,) if timed else ()), *said)

    @property
    def body_rows(self) -> tuple[SummaryRow, ...]:
        """Rows of the table that are of the free bodies."""
        return tuple(SummaryRow(figure, value) for figure, value in self.bodies.items())

    def to_json(self) -> dict[str, Any]:
        """Return it as a document, SI units: of one hand its figures, of two those of each by its side."""
        hands = {side: hand.to_json() for side, hand in self.hands.items()}
        first = next(iter(hands.values()))
        document = dict(first) if len(hands) == 1 else {"result": first["result"], "hands": hands}
        bodies = {figure.name: value for figure, value in self.bodies.items()}
        document |= {"scene": self.scene, **bodies, "suspicions": list(self.suspicions)}
        return document | {"notes": list(self.notes)}


def scene_of(submission: Submission, folder: Path | None = None) -> Scene:
    """Make the scene of a submission again, by its own words or those of a folder that `hhsim scene` made.

    Raises InputError for another scene, or an unknown one.
    """
    who, names = submission.path or submission.method, dict(submission.made_by)
    if folder is not None:
        who = folder / SCENE_FILE
        try:
            names = json.loads(read_input_text(who))["made_by"]
        except (OSError, ValueError, KeyError, TypeError):
            raise InputError(f"{who}: no such file, or a damaged one; expected that of hhsim scene") from None
    if not submission.scene or not names:
        raise InputError(
            f"{who} does not say its scene: expected # scene: and # made_by: as in the example of hhsim scene, or "
            "--scene with the folder"
        )
    try:
        return named_scene(names)
    except InputError as error:
        raise InputError(f"the scene of {who} cannot be made again: {error}") from error


def submitted_method(submission: Submission) -> Method:
    """Return a method that answers each tick of a replay with the poses that were submitted for it."""
    given = {FORCES: submission.phalanx_force, TIMES: submission.duration}
    return Method(
        summary="poses that were computed elsewhere",
        engine=partial(_SubmittedEngine, submission),
        # A submission is expected to stay outside: a depth above the limit is no success.
        never_penetrates=True,
        gives=frozenset(what for what, values in given.items() if values is not None),
        compiled=False,
        beside_parts=True,
    )


def score(
    submission: Submission,
    scene: Scene,
    output_path: Path,
    *,
    surface: str = "spheres",
    command: Sequence[str] = (),
    progress: Progress = silent,
) -> Score:
    """Measure a submission and write a result file of it.

    Args:
        submission: Poses for each tick of the scene.
        output_path: The result, replaced when the new one is complete.
        surface: Surface of the object that contacts are with: spheres or mesh.
        command: Words of the command line, which the file states.

    Raises:
        InputError: It is of another scene, or ticks are missing.
        OutputError: The file cannot be written.
    """
    require_scene(submission, scene)
    doubts = suspicions(submission, scene)
    digest, shown = scene_digest(scene), shown_scene(scene, submission)
    seen = engine_scene(shown)
    # Beside what is free poses are in the world; the shown scene may go along with a body.
    given = submission
    if seen.carrier and submission.bodies:
        given = as_seen(submission, seen.carrier.since(*seen.carrier.at(0)))
    options = SolverOptions(method=f"{SUBMITTED}{submission.method}", surface=surface)
    file = submission.path.name if submission.path else ""
    said = {"method": submission.method, "file": file, "scene": digest, "suspicions": list(doubts)}
    # Of what is free poses are sent: nothing else in the file says where it goes.
    said |= {"bodies": list(submission.bodies)} if submission.bodies else {}
    solver = SceneSolver(shown, options, submitted_method(given))
    summaries = Replay(solver, {"submission": said}).into(output_path, command, progress)
    progress("the best poses", 0, 1)
    hands = dict[str, HandScore]()
    for hand, own, haptic, summary in zip(shown.hands, given.hands, seen.haptic, summaries, strict=True):
        placed = forward_kinematics(hand.model, *own.poses)
        off_best = _off_best(seen, hand.model, haptic, solver.options, placed)
        values = (_mesh_depth(seen, hand.model, placed), *off_best)
        errors = dict(zip((MESH_DEPTH, OFF_BEST, OFF_BEST_MAX), values, strict=True))
        hands[hand.model.side] = HandScore(summary, errors)
    several = submission.bodies and len(scene.bodies) > 1
    bodies = {BODY_DEPTH: body_depth(scene, shown)} if several else {}
    known = {side: _finite(of.errors) for side, of in hands.items()}
    of_hands = known if len(hands) > 1 else next(iter(known.values()))
    add_document(output_path, "score", of_hands | _finite(bodies))
    return Score(hands, bodies, doubts, digest)


def _finite(values: Mapping[Figure, float]) -> dict[str, Any]:
    return {figure.name: value for figure, value in values.items() if np.isfinite(value)}


class _SubmittedEngine(OutsideEngine):
    """Engine that answers each tick with the pose and the time that were submitted for it."""

    def __init__(self, submission: Submission, workspace: TickWorkspace) -> None:
        side = workspace.model.side
        submission = next(hand for hand in submission.hands if hand.hand in ("", side))
        made = partial(_SubmittedPoses, submission)
        super().__init__(made, submission.phalanx_force is not None, workspace)
        self.duration = submission.duration

    def _tick(self, sample: HandConfiguration, i: int, record: TickRecord) -> None:
        if self.workspace.parts_move:
            put_parts(self.workspace.surface, self.workspace.surface.motion.path[self.ticks])
        super()._tick(sample, i, record)

    def run(self, haptic: HapticBlock, record: TickRecord, bodies: WorldRecord) -> int:
        first = self.ticks
        done = super().run(haptic, record, bodies)
        took = np.zeros(done) if self.duration is None else np.round(1e9 * self.duration[first : first + done])
        # The time of looking a pose up here is no time of the method.
        record.duration_total[0, :done] = record.duration_cpu[0, :done] = took
        return done


class _SubmittedPoses:
    def __init__(self, submission: Submission, scene: MethodScene) -> None:
        self.submission, self.ticks = submission, 0

    def begin(self, pose: HandConfiguration) -> None:
        """Do nothing: the submission alone says where the hand is."""

    def tick(self, haptic: HandConfiguration) -> TickAnswer:
        of, i = self.submission, self.ticks
        self.ticks += 1
        phalanx = None if of.phalanx_force is None else of.phalanx_force[i]
        palm = None if of.palm_force is None else of.palm_force[i]
        return TickAnswer(of.poses.at(i), phalanx, palm)
