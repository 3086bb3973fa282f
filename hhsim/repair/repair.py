"""Repair of one recording: from its file to the same file without penetration, its result and its figures."""

from collections.abc import Sequence
from pathlib import Path
from time import perf_counter

import numpy as np

from hhsim.errors import InputError, named
from hhsim.hand.model import HandModel, Side
from hhsim.mesh.catalogue import resolve_object
from hhsim.metrics.field.field_table import field_rows, field_table
from hhsim.metrics.field.field_verdict import field_verdict
from hhsim.metrics.field.hands import FieldHands, FieldPair
from hhsim.recordings.correction import Correction
from hhsim.recordings.fitted_hand import fitted_hand
from hhsim.recordings.object_poses import with_object_poses
from hhsim.recordings.recording import Recording
from hhsim.recordings.registry import ReadOptions, read_recording, write_recording
from hhsim.recordings.unit_detection import repair_units
from hhsim.render.before_after import deepest_frames, draw_before_after
from hhsim.render.hand_meshes import FINE, hand_surface, piece_surfaces
from hhsim.repair.offline import OfflineOptions, repair_frames
from hhsim.repair.page import repair_page
from hhsim.repair.projection import correct
from hhsim.repair.recorded_scene import RecordedScene, corrected_angles, recorded_scene
from hhsim.repair.request import PICTURE, REPORT, RESULT, RepairOutcome, RepairRequest
from hhsim.repair.result_file import write_result
from hhsim.result.reader import load_result
from hhsim.system.atomic_write import write_atomically
from hhsim.system.output_path import check_output_path
from hhsim.system.progress import Progress, silent
from hhsim.trees.contact_surface import contact_surface
from hhsim.trees.triangle_tree import tree_of_any


def repair_recording(
    request: RepairRequest, *, command: Sequence[str] = (), progress: Progress = silent
) -> RepairOutcome:
    """Repair a recording, and write it, its result and its report.

    Raises:
        InputError: Options that do not fit the recording or the object.
        TrajectoryError: A recording, or object poses, that cannot be read.
        MeshError: A mesh that cannot be used.
        OutputError: A file cannot be written.
    """
    paths = _paths(request)
    read = _options(request)
    recording = read_recording(request.recording, read)
    with named(request.recording):
        recording = repair_units(recording)
    mesh, level = resolve_object(request.object, request.unit, request.size, solid=False)
    progress("tree", 0, 1)
    tree = tree_of_any(mesh, level)
    if request.object_poses is not None:
        recording = with_object_poses(recording, request.object_poses, read)
    with named(request.recording):
        recording, hand = _hand(recording, request)
        recorded = recorded_scene(recording, mesh, tree, hand, request.recording.stem)
    scene = recorded.scene
    began = perf_counter()
    surface = contact_surface("mesh", scene.mesh, scene.tree)
    options = OfflineOptions(max_correction=request.max_correction)
    found = repair_frames(hand, surface, recorded.haptic, options, progress)
    marked = found.marked
    if recording.joints is None:
        seen = corrected_angles(hand, recorded.haptic, found.posture)
    else:
        limit = request.max_correction
        written = correct(
            recorded.joints,
            hand,
            recorded.haptic,
            found.posture,
            surface,
            tip_on_surface=recorded.tip_on_surface,
            max_correction=limit,
            progress=progress,
        )
        seen, marked = written.correction, marked | written.marked
    took = perf_counter() - began
    correction = recorded.in_the_world(seen, recording)
    write_recording(request.recording, read, recording, correction, paths["recording"])
    said = {"object": request.object, "trajectory": str(request.recording), "recording": request.recording.name}
    write_result(scene, seen.posture, marked, paths["result"], description=said, command=command, progress=progress)
    force = np.linalg.norm(load_result(paths["result"])["force/phalanx"].sum(axis=2), axis=2)
    before, after = recorded.judged(seen)
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
        table=field_table(rows, f"{request.recording.name} with {scene.mesh.name}"),
    )
    progress("picture", 0, 1)
    _draw(recorded, seen, before, paths["picture"])
    write_atomically(paths["report"], repair_page(outcome, before, after, paths["picture"].read_bytes()).encode())
    return outcome


def _draw(recorded: RecordedScene, seen: Correction, before: FieldHands, path: Path) -> None:
    """Draw our hand in the deepest frames, as recorded and as repaired."""
    chosen = deepest_frames(np.nan_to_num(-before.distance))
    hand = recorded.scene.hand
    pieces = piece_surfaces(hand, *FINE)
    skins = [
        [hand_surface(hand, posture.at(frame), pieces) for frame in chosen] for posture in (seen.fitted, seen.posture)
    ]
    shown = [np.stack([skin.points for skin in frames]) for frames in skins]
    numbers = recorded.frames[chosen].tolist()
    time = recorded.scene.ticks.time[chosen]
    faces, rows = skins[0][0].faces, range(len(chosen))
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


def _options(request: RepairRequest) -> ReadOptions:
    """Return the options for reading the recording; its own world will do where it says nothing of an axis up."""
    given = {"hand": request.hand, "mano_model": request.mano_model, "usual_up": "z", **request.options}
    return ReadOptions(**given)


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
