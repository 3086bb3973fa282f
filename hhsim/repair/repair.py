"""Repair of one recording: from its file to the same file without penetration, its result and its figures.

Anyone's repaired recording has a score beside the recorded one, by the same table.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

from hhsim import __version__
from hhsim.arrays import BoolArray, FloatArray
from hhsim.errors import InputError, MeshError, TrajectoryError, named
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import SIDES, HandModel, Side
from hhsim.linkage.file import names_a_linkage
from hhsim.mesh.catalogue import names_a_body_file, names_a_file
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.field.field_table import FieldRow, FieldVerdict, doubts_of, field_rows, field_table, field_verdict
from hhsim.metrics.field.hands import Bodies, FieldHands, FieldPair
from hhsim.metrics.moving_parts import MovingParts, placed_mesh
from hhsim.motion.trajectory import RigidMotion
from hhsim.recordings.cleaning import suspect_joints
from hhsim.recordings.fitted_hand import FITTED, fitted_hand, in_angles_of
from hhsim.recordings.object_poses import with_object_poses
from hhsim.recordings.recording import Recording, note, unused_poses
from hhsim.recordings.registry import (
    BONES,
    Content,
    Correction,
    ReadOptions,
    check_target,
    format_of,
    read_recording,
    repaired_suffix,
    write_recording,
)
from hhsim.render.before_after import deepest_frames, draw_before_after
from hhsim.render.triangle_soup import hand_surface, piece_surfaces
from hhsim.repair.projection import GivenObject, HandJudge, Projection, farthest
from hhsim.repair.recorded_scene import RecordedScene, recorded_scene
from hhsim.repair.request import MAX_CORRECTION, PICTURE, REPORT, RESULT, RepairOutcome, RepairRequest
from hhsim.repair.skin import Skin, mano_skin, moved_skin, push_out
from hhsim.repair.skin_hull import hand_with_skin, with_palm
from hhsim.repair.tracks import LINEARISATIONS, put_at, repair_frames, solver_beside
from hhsim.repair.written_hand import WrittenHand, change_between
from hhsim.replay.replay import Replay
from hhsim.result.writer import add_skin
from hhsim.scene.declared_bodies import DeclaredBodies, load_object
from hhsim.scene.engine_scene import seen_hand
from hhsim.solver.method import SUBMITTED
from hhsim.solver.options import UNLIMITED, SolverOptions
from hhsim.solver.solver import SceneSolver
from hhsim.submissions.pose_file import Submission
from hhsim.submissions.score import submitted_method
from hhsim.system.atomic_write import new_files, write_atomically
from hhsim.system.counted import counted
from hhsim.system.input_file import file_state
from hhsim.system.output_path import check_output_path
from hhsim.system.progress import Progress, silent
from hhsim.table.html import render
from hhsim.trees.contact_surface import encloses
from hhsim.trees.triangle_tree import triangle_tree

LOADED = 64
"""Objects that a process keeps loaded."""
VOLUME_FRAMES = 12
"""Frames whose intersection volume is computed, beside the deepest one; `hhsim score` computes that of all."""
TREE_LEVEL = 2
"""Level of the tree of an object's triangles in the result."""
METHOD = "hhsim repair"
"""Name of the method in the result of a repair."""
MOST_LISTED = 20
"""Number of marked frames that the page lists by their numbers."""
ROUNDING = 2e-6
"""Distance of written joints from corrected ones that numbers of a file make [m]."""
SAME_STAMP = 1e-6
"""Largest difference of stamps that are the same [s]: text files round them."""


def repair_recording(
    request: RepairRequest, *, command: Sequence[str] = (), progress: Progress = silent
) -> RepairOutcome:
    """Repair a recording, and write it, its result and its report.

    Raises InputError for options that do not fit the recording or the object, TrajectoryError for a recording or object
    poses that cannot be read, MeshError for a mesh that cannot be used, OutputError for a file that cannot be written,
    or that is there: nothing is replaced. Its files appear together at the end, or none does.
    """
    _check_paths(request, RESULT, REPORT, PICTURE)
    with new_files(request.out) as folder:
        outcome = _repaired(replace(request, out=folder / request.out.name), command, progress)
    paths = {what: request.out.with_name(path.name) for what, path in outcome.paths.items()}
    return replace(outcome, paths=paths)


def _repaired(request: RepairRequest, command: Sequence[str], progress: Progress) -> RepairOutcome:
    """Repair a recording into a folder that holds no other files."""
    names = {"result": RESULT} | ({"report": REPORT, "picture": PICTURE} if request.pictures else {})
    paths = {"recording": request.out} | {what: request.beside(name) for what, name in names.items()}
    # The recording's own world will do where it says nothing of an axis up.
    read, bodies = replace(request.read, usual_up="z"), bodies_of(request)
    recording = read_recording(request.recording, read)
    skin = _skin(request.recording, read, recording)
    recording, recorded = prepared(request, read, recording, bodies, skin)
    check_target(request.recording, recording, request.out)
    scene, began = recorded.scene, process_time()
    seen_skin = None if skin is None else recorded.seen_skin(skin)
    seen, marked = corrected(request.max_correction, recorded, seen_skin, progress)
    took = process_time() - began
    correction = recorded.in_the_world(seen, recording)
    off = write_recording(request.recording, read, recording, correction, paths["recording"])
    if off is not None and off > ROUNDING:
        text = f"the format holds the corrected joints to {1e3 * off:.3f} mm; the figures are of what it holds"
        recording = recording.found(note(text))
    if not recording.is_written_back:
        held = "joint angles in our world" if recording.joints is None else "21 joints [m] in the axes of the file"
        text = f"format {recording.form} is read and not written: {paths['recording'].name} has {held}, and the stamps"
        recording = recording.found(note(text))
    # What is judged is what the file says, without angles that fit its joints.
    again = replace(read, fits_angles=recording.joints is None)
    if recording.is_written_back:
        written = read_recording(request.out, again, request.recording)
    else:
        # A new file has every number as it is.
        joints = None if recording.joints is None else correction.joints
        written = recording.changed(**correction.posture._asdict(), joints=joints)
    after_skin = None
    if skin is not None:
        after_skin = _skin(paths["recording"], read, written)
        assert recording.joints is not None
        after_skin = after_skin or replace(skin, vertices=moved_skin(skin, recording.joints, correction))
    said: dict[str, Any] = {
        "object": request.object,
        "trajectory": str(request.source),
        "recording": request.source.name,
        "marked": recorded.frames[marked].tolist(),
    }
    forces = equilibrium_forces(recorded, seen.posture)
    submission = Submission(METHOD, "", scene.ticks.time, seen.posture, *forces)
    # The hand of the written recording is outside; ours is inside by what the fit left.
    method, options = submitted_method(submission), SolverOptions(method=f"{SUBMITTED}{METHOD}", surface="mesh")
    solver = SceneSolver(scene, options, replace(method, never_penetrates=False))
    Replay(solver, said).into(paths["result"], command, progress)
    if after_skin is not None:
        add_skin(paths["result"], after_skin.vertices[recorded.frames], after_skin.faces)
    force = np.linalg.norm(forces[0].sum(axis=2), axis=2)
    before = recorded.judged(recorded.joints, recorded.haptic, seen_skin)
    joints, posture = recorded.seen_hand(written, seen.posture)
    after = recorded.judged(joints, posture, None if after_skin is None else recorded.seen_skin(after_skin))
    progress("figures", 0, 1)
    rows = field_rows(FieldPair(before, after, force=force, volume_frames=VOLUME_FRAMES))
    # Bodies that go by poses of their own need none of the recording.
    doubts = (*(() if bodies.recorded_poses else unused_poses(recording)), *doubts_of(rows))
    verdict = field_verdict(rows, request.max_correction, doubts)
    frames = tuple(int(frame) for frame in recorded.frames[marked])
    figures = {f"{row.name}_{when}": getattr(row, when) for row in rows for when in ("before", "after")}
    figures["time_per_frame"] = took / len(recorded.frames)
    outcome = RepairOutcome(
        figures={name: float(value) for name, value in figures.items() if np.isfinite(value)},
        frames=len(recorded.frames),
        marked=frames,
        verdict=verdict.line,
        ok=not verdict.missed and not frames,
        doubts=doubts,
        findings=tuple(finding.text for finding in recording.findings),
        paths=paths,
        table=field_table(rows, f"{request.source.name} with {scene.name}", doubts),
    )
    if request.pictures:
        progress("picture", 0, 1)
        _draw(recorded, seen.posture, before, after, paths["picture"])
        write_atomically(paths["report"], _page(outcome, paths["picture"].read_bytes()).encode())
    return outcome


def prepared(
    request: RepairRequest,
    read: ReadOptions,
    recording: Recording,
    bodies: DeclaredBodies,
    skin: Skin | None = None,
    fitted: HandModel | None = None,
) -> tuple[Recording, RecordedScene]:
    """Fit a hand to a recording in our units, and put it beside bodies with their trees; errors as of the repair.

    The returned recording has the angles of the fitted hand. `skin` is that of the recorded hand, `fitted` a hand that
    was fitted before, to other samples of it.
    """
    for mesh in bodies.meshes.values():
        recording = recording.found(*map(note, (*mesh.repairs, *mesh.warnings)))
    if request.object_poses is not None:
        recording = with_object_poses(recording, request.object_poses, read)
    side: Side = "left" if recording.hand == "left" else "right"
    with named(request.recording):
        if fitted is not None:
            recording, hand = in_angles_of(recording, fitted), fitted
        elif recording.joints is None:
            own = request.hand_file
            hand = HandModel.default(side) if own is None else HandModel.from_toml(own, side)
        elif request.hand_file is not None:
            whose = "--hand-file is for recordings of angles"
            raise InputError(f"{whose}; the joints of this one tell the sizes of its hand")
        else:
            recording, text = fitted_hand(recording, request.recording.name)
            hand = HandModel.of_text(text, FITTED, side)
    if skin is None:
        hand = with_palm(hand, request.palm) if fitted is None else hand
    else:
        hand, fit = hand_with_skin(hand, skin, HandConfiguration.of(recording), request.palm)
        text = (
            f"hand fitted to the skin: {100.0 * fit.contained:.1f} % of its vertices are contained, the others are "
            f"{1e3 * fit.excess_mean:.3f} mm outside in the mean of all, {1e3 * fit.excess_max:.2f} mm at most"
        )
        recording = recording.found(note(text))
    with named(request.recording):
        began = 0.0
        if len(bodies.settings) > 1:
            # Joints of the object are at 0 s at the first stamp of the hand, or of both that are repaired.
            both = [] if request.of_both is None else [replace(read, hand=each) for each in SIDES]
            hands = [read_recording(request.source, options) for options in both] or [recording]
            began = min(float(np.nanmin(each.time)) + each.first_stamp for each in hands)
        recorded = recorded_scene(recording, bodies, hand, request.recording.stem, began)
    recording = suspect_joints(recording)
    gone = recording.sample_count - len(recorded.frames)
    if gone:
        text = f"{gone} of {recording.sample_count} samples have no whole hand or no object: left as they are"
        recording = recording.found(note(text))
    touched = recorded.touched
    notes = touched.surface("mesh").notes if isinstance(touched, MovingParts) else touched.notes
    return recording.found(*map(note, notes)), recorded


def corrected(
    limit: float, recorded: RecordedScene, skin: Skin | None, progress: Progress
) -> tuple[Correction, BoolArray]:
    """Return the correction as the object sees it, and a mask of the frames to be marked, shape (F,)."""
    hand, given, haptic = recorded.hand, recorded.touched, recorded.haptic
    free = repair_frames(hand, given, haptic, limit, progress)
    written, moved = WrittenHand(recorded.joints, hand, haptic, recorded.tip_on_surface), recorded.moved
    return correct(written, free, given, skin=skin, object_moved=moved, max_correction=limit, progress=progress)


def correct(
    written: WrittenHand,
    posture: HandConfiguration,
    given: GivenObject,
    *,
    skin: Skin | None = None,
    object_moved: RigidMotion | None = None,
    max_correction: float = MAX_CORRECTION,
    progress: Progress = silent,
) -> tuple[Correction, BoolArray]:
    """Move recorded joints with the bones of our hand, and on until the written hand does not penetrate.

    Args:
        written: Recorded joints and our hand that fits them, in the object's frame, T frames.
        posture: Our hand as repaired, in the object's frame.
        given: Object, of parts that move with their poses in each frame.
        skin: Skin of the recorded hand in the object's frame, which is then outside too.
        object_moved: Motion of the object's frame in the world, in which accelerations are measured; None: it stands
            still.
        max_correction: Largest move of a joint [m] of a frame that is not marked.
        progress: Called with the stage, the frames done and their number.

    Returns:
        The correction, in the frame of the joints; frames without a need are as they were. A mask of the frames whose
        written hand or skin penetrates or whose joints move by more than the limit, shape (T,).
    """
    joints, fitted = written.joints, written.fitted
    projection = Projection(written, HandJudge(written.hand, given))
    recorded = projection.clearance(fitted)
    found = projection.corrected(posture, recorded < 0.0, object_moved, progress)
    changed = np.any(change_between(fitted, found) != 0.0, axis=1)
    inside = np.where(changed, projection.clearance(found), recorded) < 0.0
    if skin is not None:
        progress("skin", 0, 1)
        pushed = push_out(projection.judge, skin, joints, fitted, found)
        found, inside = pushed.posture, ~pushed.is_freed
        changed |= pushed.is_freed & (pushed.depth > 0.0)
    rotation, moved = np.tile(np.eye(3), (len(joints), BONES, 1, 1)), joints.copy()
    rotation[changed] = written.rotation(found)[changed]
    moved[changed] = written.moved(joints, found)[changed]
    return Correction(fitted, found, rotation, moved, changed), inside | (farthest(moved, joints) > max_correction)


def bodies_of(request: RepairRequest) -> DeclaredBodies:
    """Return the bodies of a request with their trees; InputError for some that are free, MeshError for an open one.

    A mesh file, as it is, and a name of the catalogue are loaded once in a process.
    """
    word, path = request.object, Path(request.object)
    if names_a_linkage(word) or (names_a_file(word) and names_a_body_file(word)):
        # What else such a file names is not looked at.
        return _load(word, request.unit, request.size)
    return _loaded_bodies(word, file_state(path) if path.is_file() else None, request.unit, request.size)


@lru_cache(maxsize=LOADED)
def _loaded_bodies(word: str, state: tuple[object, ...] | None, unit: str | None, size: float | None) -> DeclaredBodies:
    found = _load(word, unit, size)
    if state is not None and file_state(Path(word)) != state:
        raise InputError(f"{word} changed while it was read; the same command reads it anew")
    return found


def _load(word: str, unit: str | None, size: float | None) -> DeclaredBodies:
    return checked_bodies(load_object(word, unit=unit, size=size, solid=True), word)


def checked_bodies(bodies: DeclaredBodies, word: str) -> DeclaredBodies:
    """Return bodies, which are called `word`, with their trees; errors as of `bodies_of`."""
    free = [body.name for body in bodies.settings if body.is_free]
    if free:
        raise InputError(f"{word} has free bodies ({', '.join(free)}); expected fixed and driven ones")
    for name, mesh in bodies.meshes.items():
        if not encloses(mesh):
            what = word if len(bodies.meshes) == 1 else f"body '{name}' of {word}"
            raise MeshError(f"{what} encloses nothing, so that no hand is inside; expected a closed mesh")
    # A hand is kept out of the triangles themselves: their tree is the broad phase of who reads the result.
    return bodies.with_trees(lambda mesh: triangle_tree(mesh, TREE_LEVEL))


def _skin(path: Path, read: ReadOptions, recording: Recording) -> Skin | None:
    """Return the skin of the MANO model that moves in a recording; None without any."""
    content = Content(path)
    mano = format_of(content, read).mano
    if mano is None or read.mano_model is None:
        return None
    model, rotation, pose, translation, betas = mano(content, read)
    if not len(model.faces):
        return None
    return mano_skin(model, rotation, pose, translation, betas, recording.file_frame)


def _draw(
    recorded: RecordedScene, posture: HandConfiguration, before: FieldHands, after: FieldHands, path: Path
) -> None:
    """Draw the skin, or our hand, in the deepest frames, as recorded and as repaired."""
    chosen = deepest_frames(np.nan_to_num(-before.distance))
    if before.skin is not None and after.skin is not None and before.faces is not None:
        shown, faces = [before.skin[chosen], after.skin[chosen]], before.faces
    else:
        hand = recorded.hand
        pieces = piece_surfaces(hand)
        hands = [[hand_surface(hand, posed.at(k), pieces) for k in chosen] for posed in (recorded.haptic, posture)]
        shown, faces = [np.stack([one.points for one in frames]) for frames in hands], hands[0][0].faces
    numbers = recorded.frames[chosen].tolist()
    time = recorded.scene.ticks.time[chosen]
    bodies = Bodies.of(recorded.seen.parts or recorded.seen.mesh)
    frames = [bodies.at(int(frame)) for frame in chosen]
    shapes = [placed_mesh(each.meshes, each.motions) if each.motions else each.meshes[0] for each in frames]
    # The table's depth: of a thin object the deepest vertex lies less deep than the cone that it is of.
    depth = [np.maximum(-hands.distance[chosen], 0.0) for hands in (before, after)]
    draw_before_after(shapes, shown[0], shown[1], faces, path, time, numbers, depth)


def _page(outcome: RepairOutcome, worst: bytes) -> str:
    """Return the page of a repair: verdict, figures before and after, and `worst`, a PNG of its deepest frames."""
    table = outcome.table
    assert table is not None
    marked = f"Each of {counted(outcome.frames, 'frame')} has a repair within the limit."
    if outcome.marked:
        listed = ", ".join(map(str, outcome.marked[:MOST_LISTED]))
        listed += ", …" if len(outcome.marked) > MOST_LISTED else ""
        share = f"{len(outcome.marked)} of {counted(outcome.frames, 'frame')}"
        marked = (
            f"Marked are {share}, in which a joint moves by more than the limit or no free hand was found: {listed}."
        )
    stated = {"verdict": outcome.verdict, "missed": not outcome.ok, "marked": marked, "findings": outcome.findings}
    made_by = {"generator": METHOD, "version": __version__}
    return render("repair/repair.html", title=table.title, figures=table, worst=worst, **stated, **made_by)


def _check_paths(request: RepairRequest, *beside: str) -> None:
    """Raise OutputError for a file that cannot be written anew."""
    for path in (request.out, *map(request.beside, beside)):
        check_output_path(path)


def repair_both_hands(
    request: RepairRequest, *, command: Sequence[str] = (), progress: Progress = silent
) -> list[RepairOutcome]:
    """Repair the right hand of a recording, and then the left one of what that wrote; errors as `repair_recording`.

    Result, report and picture of each lie beside `request.out`, with its side in their names. Each hand is kept out of
    the object, not of the other hand.
    """
    out, given = request.out, request.recording
    _check_paths(request, *(f"{side}-{name}" for side in SIDES for name in (RESULT, REPORT, PICTURE)))
    if repaired_suffix(given, request.read) != given.suffix:
        raise InputError(f"{given}: its format is read and not written; repair each hand for itself: --hand right|left")
    found, recording = list[RepairOutcome](), given
    with new_files(out) as folder:
        for side in SIDES:
            beside = folder / f"{out.stem}-{side}{out.suffix}"
            one = replace(
                request, recording=recording, read=replace(request.read, hand=side), out=beside, of_both=given
            )
            outcome = repair_recording(one, command=command, progress=progress)
            paths = {what: out.with_name(path.name) for what, path in outcome.paths.items()}
            found.append(replace(outcome, paths={**paths, "recording": out}))
            if recording != given:
                recording.unlink()
            recording = beside
        recording.replace(folder / out.name)
    return found


@dataclass(frozen=True)
class FieldScore:
    """Table of the field of a repaired recording, and the verdict on it."""

    rows: tuple[FieldRow, ...]
    verdict: FieldVerdict
    doubts: tuple[str, ...]  # sentences on the object, which may be in another place than it was


def field_score(
    recorded: Path,
    repaired: Path,
    mesh: Mesh,
    options: ReadOptions | None = None,
    *,
    max_correction: float,
    poses: Path | None = None,
) -> FieldScore:
    """Compute the table of the field of two files, and judge the repair.

    Args:
        recorded: Recording before the repair.
        repaired: The same after it, by any tool, in any format.
        mesh: Closed surface of the object in its own frame.
        options: Options for reading both files.
        poses: File of the object's poses, for a recording that has none; else it stands still in our world.
        max_correction: Largest displacement of a joint that the verdict allows [m].

    Raises:
        TrajectoryError: A file that is no recording of joint centres, or files of other samples or stamps.
        InputError: A recorded hand without usable sizes.
        MeshError: A mesh that encloses nothing.
    """
    read = options or ReadOptions()
    before, after = (read_recording(path, read, recorded) for path in (recorded, repaired))
    for path, recording in ((recorded, before), (repaired, after)):
        if recording.joints is None:
            expected = "expected the centres of the joints in a world whose up axis is known (--world-up)"
            raise TrajectoryError(f"{path}: angles only, or no world frame; {expected}")
    counts = before.sample_count, after.sample_count
    if counts[0] != counts[1]:
        raise TrajectoryError(f"{repaired}: {counts[1]:,} samples; expected {counts[0]:,}, as {recorded} has")
    off = ~np.isclose(after.time, before.time, rtol=0.0, atol=SAME_STAMP, equal_nan=True)
    if off.any():
        k = int(np.argmax(off))
        stamps = f"{after.time[k]:.6f} s; expected {before.time[k]:.6f} s"
        raise TrajectoryError(f"{repaired}: sample {k} is at {stamps}, as {recorded} has")
    request = RepairRequest(recorded, mesh.name, repaired, object_poses=poses)
    bodies = checked_bodies(DeclaredBodies.of_mesh(mesh), mesh.name)
    recording, scene = prepared(request, read, before, bodies)
    fitted = HandConfiguration.of(in_angles_of(after, scene.hand)).at(scene.frames)
    posture = scene.seen_hand(after, seen_hand(fitted, scene.moved))
    hands = scene.judged(scene.joints, scene.haptic, None), scene.judged(*posture, None)
    rows = field_rows(FieldPair(*hands))
    doubts = (*unused_poses(recording), *doubts_of(rows))
    return FieldScore(rows, field_verdict(rows, max_correction, doubts), doubts)


def equilibrium_forces(recorded: RecordedScene, posture: HandConfiguration) -> tuple[FloatArray, FloatArray]:
    """Compute the contact forces that balance the coupling where a hand comes to rest from a posture [N].

    They are on the phalanges, shape (T, 5, 3, 3), and on the palm, shape (T, 3), as the object sees them.
    """
    options = SolverOptions(surface="mesh", linearisations=LINEARISATIONS, budget=UNLIMITED)
    given, haptic = recorded.touched, recorded.haptic
    solver = solver_beside(given, recorded.hand, options)
    phalanx, palm = np.zeros((posture.ticks, 5, 3, 3)), np.zeros((posture.ticks, 3))
    for frame in range(posture.ticks):
        shown = posture.part(frame, frame + 1)
        put_at(solver, given, frame)
        solver.place(*shown.at(0))
        # The shown abduction is held: it has no force.
        record = solver.run(*haptic.part(frame, frame + 1)._replace(abduction=shown.abduction))
        phalanx[frame] = record.phalanx[0]
        palm[frame] = record.total[0] - record.phalanx[0].sum(axis=(0, 1))
    return phalanx, palm
