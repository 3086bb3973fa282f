"""Repair of one recording: from its file to the same file without penetration, its result and its figures."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from hhsim.arrays import BoolArray, FloatArray
from hhsim.errors import InputError, MeshError, named
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel, Side
from hhsim.mesh.catalogue import resolve_object
from hhsim.metrics.field.field_table import field_rows, field_table
from hhsim.metrics.field.field_verdict import field_verdict
from hhsim.metrics.field.hands import FieldHands, FieldPair
from hhsim.recordings.correction import Correction
from hhsim.recordings.fitted_hand import fitted_hand
from hhsim.recordings.mano_model import read_mano_model
from hhsim.recordings.object_poses import with_object_poses
from hhsim.recordings.outliers import suspect_joints
from hhsim.recordings.recording import Recording, note
from hhsim.recordings.registry import Content, ReadOptions, format_of, read_recording, write_recording
from hhsim.recordings.unit_detection import clean_units
from hhsim.render.before_after import deepest_frames, draw_before_after
from hhsim.render.hand_meshes import hand_surface, piece_surfaces
from hhsim.repair.offline import repair_frames
from hhsim.repair.page import repair_page
from hhsim.repair.projection import correct
from hhsim.repair.recorded_scene import RecordedScene, recorded_scene
from hhsim.repair.request import PICTURE, REPORT, RESULT, RepairOutcome, RepairRequest
from hhsim.repair.result_file import write_result
from hhsim.repair.skin import Skin, mano_skin, moved_skin, read_skin
from hhsim.repair.skin_depth import push_out
from hhsim.repair.skin_hull import hand_with_skin, with_palm
from hhsim.repair.written_hand import WrittenHand
from hhsim.result.reader import load_result
from hhsim.result.schema import TWO_HANDED
from hhsim.result.writer import add_skin
from hhsim.system.atomic_write import write_atomically
from hhsim.system.output_path import check_output_path
from hhsim.system.progress import Progress, silent
from hhsim.trees.contact_surface import ContactSurface, contact_surface, encloses
from hhsim.trees.triangle_tree import tree_of_any

ROUNDING = 2e-6
"""Distance of written joints from corrected ones that numbers of a file make [m]."""


def repair_recording(
    request: RepairRequest, *, command: Sequence[str] = (), progress: Progress = silent
) -> RepairOutcome:
    """Repair a recording, and write it, its result and its report.

    Raises InputError for options that do not fit the recording or the object, TrajectoryError for a recording or object
    poses that cannot be read, MeshError for a mesh that cannot be used, OutputError for a file that cannot be written.
    """
    paths = _paths(request)
    # The recording's own world will do where it says nothing of an axis up.
    given = {"hand": request.hand, "mano_model": request.mano_model, "usual_up": "z", **request.options}
    read = ReadOptions(**given)
    recording = _in_our_units(request.recording, read)
    mesh, level = resolve_object(request.object, request.unit, request.size)
    if not encloses(mesh):
        raise MeshError(f"{request.object} encloses nothing, so that no hand is inside; expected a closed mesh")
    recording = recording.found(*map(note, (*mesh.repairs, *mesh.warnings)))
    progress("tree", 0, 1)
    tree = tree_of_any(mesh, level)
    if request.object_poses is not None:
        recording = with_object_poses(recording, request.object_poses, read)
    with named(request.recording):
        recording, hand = _hand(recording, request)
    skin = _skin(request.recording, request.skin, recording, hand, read)
    if skin is None:
        hand = with_palm(hand, request.palm)
    else:
        hand, fit = hand_with_skin(hand, skin, _posture(recording), request.palm)
        text = (
            f"hand fitted to the skin: {100.0 * fit.contained:.1f} % of its vertices are contained, the others are "
            f"{1e3 * fit.excess_mean:.3f} mm outside in the mean of all, {1e3 * fit.excess_max:.2f} mm at most"
        )
        recording = recording.found(note(text))
    with named(request.recording):
        recorded = recorded_scene(recording, mesh, tree, hand, request.recording.stem)
    recording = suspect_joints(recording)
    gone = recording.sample_count - len(recorded.frames)
    if gone:
        text = f"{gone} of {recording.sample_count} samples have no whole hand or no object: left as they are"
        recording = recording.found(note(text))
    scene = recorded.scene
    began = perf_counter()
    surface = contact_surface("mesh", scene.mesh, scene.tree)
    recording = recording.found(*map(note, surface.notes))
    seen_skin = None if skin is None else recorded.seen_skin(skin)
    seen, marked = _corrected(request, recorded, surface, seen_skin, progress)
    took = perf_counter() - began
    correction = recorded.in_the_world(seen, recording)
    off = write_recording(request.recording, read, recording, correction, paths["recording"])
    if off is not None and off > ROUNDING:
        text = f"the format holds the corrected joints to {1e3 * off:.3f} mm; the figures are of what it holds"
        recording = recording.found(note(text))
    # What is judged is what the file says.
    written = _in_our_units(paths["recording"], read, request.recording)
    after_skin = None
    if skin is not None:
        after_skin = _skin(paths["recording"], None, written, hand, read)
        after_skin = after_skin or replace(skin, vertices=moved_skin(skin, _joints(recording), correction))
    said: dict[str, Any] = {
        "object": request.object,
        "trajectory": str(request.source),
        "recording": request.source.name,
        "marked": recorded.frames[marked].tolist(),
        **({} if request.of_both is None else {TWO_HANDED: True}),
    }
    write_result(scene, surface, seen.posture, paths["result"], description=said, command=command, progress=progress)
    if after_skin is not None:
        add_skin(paths["result"], after_skin.vertices[recorded.frames], after_skin.faces)
    force = np.linalg.norm(load_result(paths["result"])["force/phalanx"].sum(axis=2), axis=2)
    before = recorded.judged(recorded.joints, seen.fitted, seen_skin)
    joints, posture = recorded.seen_hand(written, seen.posture)
    after = recorded.judged(joints, posture, None if after_skin is None else recorded.seen_skin(after_skin))
    progress("figures", 0, 1)
    rows = field_rows(FieldPair(before, after, force=force))
    verdict = field_verdict(rows, request.max_correction)
    frames = tuple(int(frame) for frame in recorded.frames[marked])
    figures = {f"{row.name}_{when}": getattr(row, when) for row in rows for when in ("before", "after")}
    figures["time_per_frame"] = took / len(recorded.frames)
    outcome = RepairOutcome(
        figures={name: float(value) for name, value in figures.items() if np.isfinite(value)},
        frames=len(recorded.frames),
        marked=frames,
        verdict=verdict.line,
        ok=not verdict.missed and not frames,
        findings=tuple(finding.text for finding in recording.findings),
        paths=paths,
        table=field_table(rows, f"{request.source.name} with {scene.mesh.name}"),
    )
    progress("picture", 0, 1)
    _draw(recorded, seen, before, after, paths["picture"])
    write_atomically(paths["report"], repair_page(outcome, before, after, paths["picture"].read_bytes()).encode())
    return outcome


def _corrected(
    request: RepairRequest, recorded: RecordedScene, surface: ContactSurface, skin: Skin | None, progress: Progress
) -> tuple[Correction, BoolArray]:
    """Return the correction as the object sees it, and a mask of the frames to be marked, shape (F,)."""
    hand, haptic, limit = recorded.scene.hand, recorded.haptic, request.max_correction
    free = repair_frames(hand, surface, haptic, limit, progress)
    on_surface = recorded.tip_on_surface
    first, marked = correct(
        recorded.joints, hand, haptic, free, surface, tip_on_surface=on_surface, object_moved=recorded.moved,
        max_correction=limit, progress=progress,
    )  # fmt: skip
    if skin is None:
        return first, marked
    progress("skin", 0, 1)
    pushed = push_out(recorded.scene.mesh, hand, skin, recorded.joints, haptic, first.posture)
    moved = ~np.logical_and.reduce(
        [np.equal(a, b).reshape(len(a), -1).all(axis=1) for a, b in zip(first.posture, pushed.posture, strict=True)]
    )
    posture = pushed.posture
    last = WrittenHand(recorded.joints, hand, haptic, on_surface)
    rotation, joints, fitted = first.rotation.copy(), first.joints.copy(), first.fitted
    rotation[moved], joints[moved] = last.rotation(posture)[moved], last.moved(recorded.joints, posture)[moved]
    far = np.linalg.norm(joints - recorded.joints, axis=2).max(axis=1) > limit
    return Correction(fitted, posture, rotation, joints, first.changed | moved), far | ~pushed.is_freed


def _in_our_units(path: Path, read: ReadOptions, original: Path | None = None) -> Recording:
    recording = read_recording(path, read, original)
    with named(path):
        return clean_units(recording)


def _joints(recording: Recording) -> FloatArray:
    assert recording.joints is not None
    return recording.joints


def _posture(recording: Recording) -> HandConfiguration:
    return HandConfiguration(recording.position, recording.orientation, recording.flexion, recording.abduction)


def _skin(path: Path, skin: Path | None, recording: Recording, hand: HandModel, read: ReadOptions) -> Skin | None:
    """Return the skin of a file, or of the MANO model that moves in a recording; None without any."""
    if skin is not None:
        if recording.joints is None:
            raise InputError("--skin needs the centres of the joints, and this recording holds angles alone")
        return read_skin(skin, recording, hand, _posture(recording))
    content = Content.of_recording(path)
    mano = format_of(content, read).mano
    if mano is None or read.mano_model is None:
        return None
    model = read_mano_model(read.mano_model)
    return mano_skin(model, *mano(content, read), recording.file_frame) if len(model.faces) else None


def _draw(recorded: RecordedScene, seen: Correction, before: FieldHands, after: FieldHands, path: Path) -> None:
    """Draw the skin, or our hand, in the deepest frames, as recorded and as repaired."""
    chosen = deepest_frames(np.nan_to_num(-before.distance))
    if before.skin is not None and after.skin is not None and before.faces is not None:
        shown, faces = [before.skin[chosen], after.skin[chosen]], before.faces
    else:
        hand = recorded.scene.hand
        pieces = piece_surfaces(hand)
        hands = [[hand_surface(hand, posed.at(k), pieces) for k in chosen] for posed in (seen.fitted, seen.posture)]
        shown, faces = [np.stack([one.points for one in frames]) for frames in hands], hands[0][0].faces
    numbers, rows = recorded.frames[chosen].tolist(), range(len(chosen))
    time = recorded.scene.ticks.time[chosen]
    draw_before_after(recorded.scene.mesh, shown[0], shown[1], faces, path, rows, time, numbers)


def _paths(request: RepairRequest) -> dict[str, Path]:
    """Return the files to write; InputError for a name that does not fit, OutputError for one that cannot be."""
    given, out = request.recording, request.out
    if out.suffix.lower() != given.suffix.lower():
        raise InputError(f"{out}: the repaired recording has the format of the given one; expected {given.suffix}")
    if out.exists() and given.exists() and out.samefile(given):
        raise InputError(f"{out} is the recording itself, so it is not replaced: name another file")
    names = {"result": RESULT, "report": REPORT, "picture": PICTURE}
    paths = {"recording": out} | {what: request.beside(name) for what, name in names.items()}
    for path in paths.values():
        check_output_path(path)
    return paths


def _hand(recording: Recording, request: RepairRequest) -> tuple[Recording, HandModel]:
    """Return the recording fitted by a hand of its own sizes, and that hand."""
    side: Side = "left" if recording.hand == "left" else "right"
    if recording.joints is None:
        hand = HandModel.default(side) if request.hand_file is None else HandModel.from_toml(request.hand_file, side)
        return recording, hand
    if request.hand_file is not None:
        raise InputError("--hand-file is for recordings of angles; the joints of this one tell the sizes of its hand")
    fitted, text = fitted_hand(recording, request.recording.name)
    return fitted, HandModel.of_text(text, "the fitted hand", side)
