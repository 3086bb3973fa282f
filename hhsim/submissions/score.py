"""Score of a submission: its poses through the same code that measures a method, and its errors and suspicions."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, cast

import numpy as np

from hhsim.errors import HhsimError, InputError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.forward_kinematics import PlacedHand, forward_kinematics, hand_shape
from hhsim.hand.model import HandModel
from hhsim.kernels.parts.surface import JointedSurface
from hhsim.kernels.tick.block import HapticBlock, TickRecord
from hhsim.metrics.field.hands import object_bvh
from hhsim.metrics.mesh_penetration import mesh_clearance, ticks_looked_at
from hhsim.metrics.metrics import hand_clearance
from hhsim.metrics.run_metric import Figure
from hhsim.motion.trajectory import RigidMotion
from hhsim.replay.replay import Replay
from hhsim.replay.summary import ReplaySummary
from hhsim.replay.summary_table import SummaryRow, short_table
from hhsim.replay.verdict import STATED_TIMES
from hhsim.result.writer import add_document
from hhsim.scene.body import Driven
from hhsim.scene.scene import Scene
from hhsim.solver.method import FORCES, SUBMITTED, TIMES, Method, known_for_now
from hhsim.solver.options import SolverOptions
from hhsim.solver.outside_method import MethodHere, MethodScene, OutsideEngine, TickAnswer
from hhsim.solver.reference_optimum import best_hands
from hhsim.solver.scene_solver import SceneSolver, SeenScene, along, seen_scene
from hhsim.solver.workspace import TickWorkspace
from hhsim.submissions.pose_file import Submission
from hhsim.submissions.scene_folder import SCENE_FILE, named_scene, scene_digest
from hhsim.submissions.suspicions import BODY_DEPTH, as_seen, body_depth, require_scene, shown_scene, suspicions
from hhsim.system.input_file import read_input_text
from hhsim.system.progress import Progress, silent
from hhsim.trees.contact_surface import contact_surface, encloses, put_parts

NEAR = 1e-3
"""Distance of the user's hand from the mesh [m] below which a tick counts for the least-energy pose."""

# Depth of the hand in the mesh; undefined if the mesh encloses nothing.
MESH_DEPTH = Figure("mesh_depth_max", "in the mesh, max", 3, "mm")
# Distance of the fingertips and the palm from the pose of least coupling energy outside the mesh
# (`hhsim.solver.reference_optimum.best_hands`), the largest of each tick in contact.
OFF_BEST = Figure("off_best_mean", "off the least-energy pose, mean", 3, "mm")
OFF_BEST_MAX = Figure("off_best_max", "off the least-energy pose, max", 3, "mm")


def _mesh_depth(shown: Scene, hand: HandModel, placed: PlacedHand) -> float:
    """Return the largest depth of a hand, placed in the world, in the bodies [m]; NaN where none encloses a space."""
    depths = [np.nan]
    for body in shown.solids:
        if not encloses(body.mesh):
            continue
        mesh, tree, there = body.placed_mesh, body.placed_tree, placed
        if isinstance(body.motion, Driven):
            mesh, tree, poses = body.mesh, body.tree, body.motion.poses
            there = RigidMotion(poses.orientation, poses.position).seen_hand(placed)
        palm, finger = hand_clearance(tree.arrays(), hand_shape(hand), there, limit=NEAR)
        # The spheres cover the mesh: a hand outside of them is outside of the mesh.
        inside = ticks_looked_at(np.minimum(palm, finger.min(axis=1)) < 0.0)
        depths.append(0.0)
        if inside.size:
            depths.append(-float(mesh_clearance(object_bvh(mesh), hand_shape(hand), there.at(inside)).min()))
    return float(np.nanmax(depths)) if len(depths) > 1 else np.nan


def _off_best(
    seen: SeenScene, hand: HandModel, haptic: HandConfiguration, options: SolverOptions, placed: PlacedHand
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


def submitted_method(name: str, submission: Submission) -> Method:
    """Return a method of this name that answers each tick of a replay with the poses that were submitted for it."""
    given = {FORCES: submission.phalanx_force, TIMES: submission.duration}
    return Method(
        summary="poses that were computed elsewhere",
        engine=cast(Any, partial(_SubmittedEngine, name, submission)),
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
    seen = seen_scene(shown)
    given = as_seen(submission, seen_scene(scene), seen)
    name = f"{SUBMITTED}{submission.method}"
    with known_for_now(name, submitted_method(name, given)):
        options = SolverOptions(method=name, surface=surface)
        file = submission.path.name if submission.path else ""
        said = {"method": submission.method, "file": file, "scene": digest, "suspicions": list(doubts)}
        # Of what is free poses are sent: nothing else in the file says where it goes.
        said |= {"bodies": list(submission.bodies)} if submission.bodies else {}
        solver = SceneSolver(shown, options)
        run = Replay(solver, {"submission": said})
        with run.writer(output_path, command) as writer:
            run.go(progress)
            summaries = run.finish()
        progress("the best poses", 0, 1)
        hands = dict[str, HandScore]()
        for hand, own, haptic, summary in zip(shown.hands, given.hands, seen.haptic, summaries, strict=True):
            placed = forward_kinematics(hand.model, *own.poses)
            world = placed
            if seen.carrier is not None:
                frame = along(seen.carrier)
                at = HandConfiguration(*own.poses)
                places, turns = frame.points(at.position), frame.orientations(at.orientation)
                world = forward_kinematics(hand.model, *at._replace(position=places, orientation=turns))
            off_best = _off_best(seen, hand.model, haptic, options.at_rate(scene.ticks.rate), placed)
            values = (_mesh_depth(shown, hand.model, world), *off_best)
            errors = dict(zip((MESH_DEPTH, OFF_BEST, OFF_BEST_MAX), values, strict=True))
            hands[hand.model.side] = HandScore(summary, errors)
    several = submission.bodies and len(scene.bodies) > 1
    bodies = {BODY_DEPTH: body_depth(scene, shown)} if several else {}
    known = {side: _finite(of.errors) for side, of in hands.items()}
    of_hands = known if len(hands) > 1 else next(iter(known.values()))
    add_document(writer.path, "score", of_hands | _finite(bodies))
    return Score(hands, bodies, doubts, digest)


def _finite(values: Mapping[Figure, float]) -> dict[str, Any]:
    return {figure.name: value for figure, value in values.items() if np.isfinite(value)}


class _SubmittedEngine(OutsideEngine):
    """Engine that answers each tick with the pose and the time that were submitted for it."""

    def __init__(self, name: str, submission: Submission, workspace: TickWorkspace) -> None:
        side = workspace.model.side
        submission = next(hand for hand in submission.hands if hand.hand in ("", side))
        made = partial(_SubmittedPoses, submission)
        forces = submission.phalanx_force is not None
        super().__init__(partial(MethodHere, name, made, forces), forces, workspace)
        self.duration = submission.duration

    def _tick(self, sample: HandConfiguration, i: int, record: TickRecord) -> None:
        surface = self.workspace.surface
        if isinstance(surface, JointedSurface):
            put_parts(surface, surface.motion.path[self.runner.ticks])
        super()._tick(sample, i, record)

    def run(self, haptic: HapticBlock, record: TickRecord) -> int:
        first = self.runner.ticks
        done = super().run(haptic, record)
        took = np.zeros(done) if self.duration is None else np.round(1e9 * self.duration[first : first + done])
        # The time of looking a pose up here is no time of the method.
        record.duration_total[:done] = record.duration_cpu[:done] = took
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
