"""Score of a submission: its poses through the same code that measures a method, and its errors and suspicions."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np

from hhsim.errors import HhsimError, InputError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.forward_kinematics import PlacedHand, forward_kinematics, hand_shape
from hhsim.hand.model import HandModel
from hhsim.kernels.mesh.bvh import build_mesh_bvh
from hhsim.kernels.parts.surface import JointedSurface
from hhsim.kernels.tick.block import HapticBlock, TickRecord
from hhsim.metrics.mesh_penetration import mesh_clearance, ticks_looked_at
from hhsim.metrics.metrics import hand_clearance
from hhsim.metrics.run_metric import Figure
from hhsim.replay.replay import replay_scene
from hhsim.replay.summary import ReplaySummary
from hhsim.replay.summary_table import SummaryRow, short_table
from hhsim.replay.verdict import STATED_TIMES
from hhsim.result.writer import state
from hhsim.scene.scene import Scene
from hhsim.solver.known_methods import SUBMITTED, known_for_now
from hhsim.solver.method import FORCES, TIMES, Method
from hhsim.solver.options import SolverOptions
from hhsim.solver.outside_method import MethodHere, MethodScene, OutsideEngine, TickAnswer
from hhsim.solver.reference_optimum import best_hands
from hhsim.solver.scene_solver import SeenScene, seen_scene
from hhsim.solver.workspace import TickWorkspace
from hhsim.submissions.pose_file import Submission
from hhsim.submissions.scene_file import NOT_SCORED, named_scene, read_scene, scene_digest
from hhsim.submissions.scene_folder import SCENE_FILE
from hhsim.submissions.suspicions import require_scene, suspicions
from hhsim.system.progress import Progress, silent
from hhsim.trees.contact_surface import contact_surface, encloses, put_parts

NEAR = 1e-3
"""Distance of the user's hand from the mesh [m] below which a tick counts for the least-energy pose."""

MESH_DEPTH = Figure("mesh_depth_max", "in the mesh, max", 3, "mm")
OFF_BEST = Figure("off_best_mean", "off the least-energy pose, mean", 3, "mm")
OFF_BEST_MAX = Figure("off_best_max", "off the least-energy pose, max", 3, "mm")


class PoseErrors(NamedTuple):
    """Measures of poses besides the figures of a run; NaN where undefined."""

    mesh_depth_max: float  # largest depth of the hand in the mesh [m]; undefined if the mesh encloses nothing
    # Largest distance of the fingertips and the palm from the pose of least coupling energy outside the mesh
    # (`hhsim.solver.reference_optimum.best_hands`) [m], over the ticks in contact.
    off_best_mean: float
    off_best_max: float


def _mesh_depth(seen: SeenScene, hand: HandModel, placed: PlacedHand) -> float:
    if not encloses(seen.mesh):
        return np.nan
    palm, finger = hand_clearance(seen.tree.arrays(), hand_shape(hand), placed, limit=NEAR)
    # The spheres cover the mesh: a hand outside of them is outside of the mesh.
    inside = ticks_looked_at(np.minimum(palm, finger.min(axis=1)) < 0.0)
    if inside.size == 0:
        return 0.0
    bvh = build_mesh_bvh(seen.mesh.vertices, seen.mesh.faces)
    return max(0.0, -float(mesh_clearance(bvh, hand_shape(hand), placed.at(inside)).min()))


def _off_best(seen: SeenScene, hand: HandModel, options: SolverOptions, placed: PlacedHand) -> tuple[float, float]:
    haptic = seen.haptic[0]
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
class Score:
    """Table of a run as `hhsim replay` has it, its probable mistakes, a line each, and the digest of its scene."""

    summary: ReplaySummary
    errors: PoseErrors
    suspicions: tuple[str, ...]
    scene: str

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences that belong to the table."""
        timed = any(row.name.startswith("tick_") for row in self.summary.rows)
        said = (STATED_TIMES,) if timed else ()
        return (*said, *self.summary.notes)

    @property
    def rows(self) -> tuple[SummaryRow, ...]:
        """Short table: depths, distances from the best poses, then the run's figures."""
        named = zip((MESH_DEPTH, OFF_BEST, OFF_BEST_MAX), self.errors)
        own = {row.name: row for row in (SummaryRow(figure, value) for figure, value in named)}
        short = {row.name: row for row in short_table(self.summary.rows, self.summary.verdict.missed)}
        depths = [short.pop("penetration_max", None), own.pop(MESH_DEPTH.name), short.pop("contact_error_max", None)]
        return (*(row for row in depths if row is not None), *own.values(), *short.values())

    def to_json(self) -> dict[str, Any]:
        """Return it as a document, SI units."""
        more = {"scene": self.scene, **self.errors._asdict(), "suspicions": list(self.suspicions)}
        more["notes"] = list(self.notes)
        return {**self.summary.to_json(), **more}


def scene_of(submission: Submission, folder: Path | None = None) -> Scene:
    """Find the scene of a submission: in a folder that `hhsim scene` made, beside the submission, or made by its names.

    Raises InputError for another scene, or an unknown one.
    """
    if folder is not None:
        return read_scene(folder / SCENE_FILE if folder.is_dir() else folder)
    beside = (submission.path or Path()).parent / SCENE_FILE
    if submission.path is not None and beside.is_file():
        return read_scene(beside)
    if not submission.scene or not submission.made_by:
        raise InputError(
            f"{submission.path or submission.method} does not say its scene: expected # scene: and # made_by: as in "
            "the example of hhsim scene, or --scene with the folder"
        )
    try:
        return named_scene(submission.made_by)
    except InputError as error:
        who = submission.path or submission.method
        raise InputError(f"the scene of {who} cannot be made again: {error}; --scene names its folder") from error


def submitted_method(name: str, submission: Submission) -> Method:
    """Return a method of this name that answers each tick of a replay with the pose that was submitted for it."""
    given = {FORCES: submission.phalanx_force, TIMES: submission.duration}
    return Method(
        summary="poses that were computed elsewhere",
        engine=cast(Any, partial(_SubmittedEngine, name, submission)),
        # A submission is expected to stay outside: a depth above the limit is no success.
        never_penetrates=True,
        gives=frozenset(what for what, values in given.items() if values is not None),
        compiled=False,
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
        InputError: It is of another scene, or of several bodies, or ticks are missing.
        OutputError: The file cannot be written.
    """
    if len(scene.solids) > 1:
        raise InputError(f"{scene.name}: {NOT_SCORED}")
    require_scene(submission, scene)
    doubts = suspicions(submission, scene)
    digest = scene_digest(scene)
    name = f"{SUBMITTED}{submission.method}"
    with known_for_now(name, submitted_method(name, submission)):
        options = SolverOptions(method=name, surface=surface)
        file = submission.path.name if submission.path else ""
        said = {"method": submission.method, "file": file, "scene": digest, "suspicions": list(doubts)}
        more: dict[str, Any] = {"description": {"submission": said}, "command": command, "progress": progress}
        summary = replay_scene(scene, options, output_path, **more)
        progress("the best poses", 0, 1)
        hand, seen = scene.hands[0].model, seen_scene(scene)
        placed = forward_kinematics(hand, *submission.poses)
        off_best = _off_best(seen, hand, options.at_rate(scene.ticks.rate), placed)
        errors = PoseErrors(_mesh_depth(seen, hand, placed), *off_best)
    assert summary.path is not None
    known = {key: value for key, value in errors._asdict().items() if np.isfinite(value)}
    state(summary.path, "score", known)
    return Score(summary, errors, doubts, digest)


class _SubmittedEngine(OutsideEngine):
    """Engine that answers each tick with the pose and the time that were submitted for it."""

    def __init__(self, name: str, submission: Submission, workspace: TickWorkspace) -> None:
        made = partial(_SubmittedPoses, submission)
        forces = submission.phalanx_force is not None
        super().__init__(partial(MethodHere, name, made, forces), forces, workspace)
        self.duration = submission.duration

    def _tick(self, sample: HandConfiguration, i: int, record: TickRecord) -> None:
        surface = self.workspace.surface
        if isinstance(surface, JointedSurface):
            put_parts(surface, surface.path[self.runner.ticks])
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
