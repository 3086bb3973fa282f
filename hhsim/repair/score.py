"""Score of anyone's repaired recording beside the recorded one, by the same table as hhsim's own repair."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hhsim.errors import TrajectoryError
from hhsim.hand.configuration import HandConfiguration
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.field.field_table import FieldRow, FieldVerdict, doubts_of, field_rows, field_verdict
from hhsim.metrics.field.hands import FieldPair
from hhsim.recordings.fitted_hand import in_angles_of
from hhsim.recordings.recording import unused_poses
from hhsim.recordings.registry import ReadOptions, read_recording
from hhsim.repair.repair import checked_bodies, prepared
from hhsim.repair.request import RepairRequest
from hhsim.scene.declared_bodies import DeclaredBodies
from hhsim.solver.scene_solver import seen_hand

SAME_STAMP = 1e-6
"""Largest difference of stamps that are the same [s]: text files round them."""


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
