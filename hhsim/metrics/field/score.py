"""Score of anyone's repaired recording beside the recorded one, by the same table as hhsim's own repair."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import InputError, TrajectoryError
from hhsim.hand.forward_kinematics import PlacedHand, hand_shape
from hhsim.hand.model import HandModel
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.field.field_table import FieldRow, field_rows
from hhsim.metrics.field.field_verdict import FieldVerdict, doubts_of, field_verdict
from hhsim.metrics.field.hands import FieldHands, FieldPair
from hhsim.motion.trajectory import ObjectMotion, RigidMotion
from hhsim.recordings.fitted_hand import fitted_hand
from hhsim.recordings.frames import in_palm, turned
from hhsim.recordings.object_poses import with_object_poses
from hhsim.recordings.recording import Recording, unused_poses
from hhsim.recordings.registry import ReadOptions, read_recording
from hhsim.recordings.unit_detection import clean_units

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
    motion: ObjectMotion | None = None,
    options: ReadOptions | None = None,
    *,
    max_correction: float,
    poses: Path | None = None,
    displacement_frames: tuple[int, ...] = (),
) -> FieldScore:
    """Compute the table of the field of two files, and judge the repair.

    Args:
        recorded: Recording before the repair.
        repaired: The same after it, by any tool, in any format.
        mesh: Closed surface of the object in its own frame.
        motion: Pose of the object at each sample, our world; None for the recording's own, or one that stands still in
            our world.
        options: Options for reading both files.
        poses: File of the object's poses, for a recording that has none.
        max_correction: Largest displacement of a joint that the verdict allows [m].
        displacement_frames: As of `FieldPair`.

    Raises:
        TrajectoryError: A file that is no recording of joint centres, or files of other samples or stamps.
        InputError: A motion of another number of poses, or a recorded hand without usable sizes.
    """
    before, after = (clean_units(read_recording(path, options, recorded)) for path in (recorded, repaired))
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
    if poses is not None:
        before = with_object_poses(before, poses, options or ReadOptions())
    hands = _judged_pair(before, after, mesh, before.object_motion if motion is None else motion)
    rows = field_rows(FieldPair(*hands, displacement_frames=displacement_frames))
    doubts = doubts_of(rows) if motion is not None else (*unused_poses(before), *doubts_of(rows))
    return FieldScore(rows, field_verdict(rows, max_correction, doubts), doubts)


def _judged_pair(
    before: Recording, after: Recording, mesh: Mesh, motion: ObjectMotion | None
) -> tuple[FieldHands, FieldHands]:
    """Return both hands with the radii and the palm of the hand that fits the recorded one, around their own joints."""
    samples = before.sample_count
    if motion is not None and len(motion.position) != samples:
        raise InputError(f"{len(motion.position):,} poses of the object; expected {samples:,}, one a sample")
    if motion is None:
        motion = ObjectMotion(np.zeros((samples, 3)), np.tile([1.0, 0.0, 0.0, 0.0], (samples, 1)))
    frame = motion.since(np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
    fitted, text = fitted_hand(before, before.name or "the recording")
    hand = HandModel.of_text(text, "fitted hand", before.hand or "right")
    shift = in_palm(fitted.position - before.position, before.orientation)
    # Tips on the skin: the sphere of a fingertip has its centre a radius before it.
    tip = hand.radius[:, 3:] if before.bones is not None and before.bones.tip_on_surface else np.zeros((5, 1))
    return _judged(before, hand, shift, tip, mesh, frame), _judged(after, hand, shift, tip, mesh, frame)


def _judged(
    recording: Recording, hand: HandModel, shift: FloatArray, tip: FloatArray, mesh: Mesh, frame: RigidMotion
) -> FieldHands:
    """Return a recording in the object's frame, with the radii and the palm of `hand` around its joints.

    `shift` is from the recording's palm origin to the hand's, palm frame [m], shape (T, 3); `tip` is from the centre of
    each fingertip's sphere to the recorded tip [m], shape (5, 1).
    """
    assert recording.joints is not None
    seen = frame.seen_points(recording.joints)
    chains = seen[:, 1:].reshape(-1, 5, 4, 3).copy()
    last = chains[:, :, 3] - chains[:, :, 2]
    length = np.maximum(np.linalg.norm(last, axis=2, keepdims=True), 1e-9)
    chains[:, :, 3] -= last / length * np.minimum(tip, length)
    palm = recording.position + turned(recording.orientation, shift)
    placed = PlacedHand(chains, frame.seen_points(palm), frame.seen_orientations(recording.orientation))
    down = np.tile([0.0, 0.0, -1.0], (recording.sample_count, 1))
    return FieldHands(
        recording.time,
        seen,
        mesh,
        shape=hand_shape(hand),
        placed=PlacedHand(*map(np.ascontiguousarray, placed)),
        world=recording.joints,
        down=frame.seen_vectors(down),
    )
