"""Hand model with the sizes of a recorded hand: bones, finger axes, limits, and radii or radii in proportion."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import OutputError, TrajectoryError
from hhsim.hand import model
from hhsim.hand.fingers import FINGERS
from hhsim.hand.model import HandModel
from hhsim.recordings.finger_ik import FingerAxes, finger_joints, usual_fingers
from hhsim.recordings.frames import in_palm, turned
from hhsim.recordings.joint_fit import fitted_angles, fitted_axes, recorded_limits
from hhsim.recordings.recorded_bones import RecordedBones, fit_error
from hhsim.recordings.recording import Recording, note
from hhsim.system.output_path import check_output_path, holds

BREADTHS = (0.26, 0.74)
"""Range of hand breadths that the palm model takes [hand lengths]."""
FITTED = "--fit-hand"
"""Name of the fitted hand in messages."""
SHORTEST = 0.004
"""Shortest bone, to the centre of the fingertip [m]."""


def fitted_hand(recording: Recording, source: str) -> tuple[Recording, str]:
    """Fit a hand to the joint centres of a recording: bones, finger axes, limits, and radii or radii in proportion.

    Limits are the default hand's, widened to hold the recorded motion. A recording without a world frame holds no joint
    centres any more: its fingers keep the default hand's axes and limits.

    Returns the recording with the angles of this hand and its palm moved so that the hand's knuckles are the recorded
    ones, and the text of a hand file with a right hand, or the mirror of a left one, whose first line names the source.
    Raises TrajectoryError for no joint centres, or bones that are no hand's, InputError for sizes that `hhsim replay
    --hand-file` refuses.
    """
    bones = recording.bones
    if bones is None:
        form = recording.form or "it"
        raise TrajectoryError(f"--fit-hand needs the centres of the joints, and {form} holds angles only")
    low, high = model.HAND_LENGTH_RANGE
    if not low <= bones.hand_length <= high:
        raise TrajectoryError(f"--fit-hand: the hand is {bones.hand_length:.3g} m long; expected {low:g} to {high:g} m")
    usual = usual_fingers()["base"]
    width = np.linalg.norm(bones.base[1] - bones.base[4]) / np.linalg.norm(usual[1] - usual[4])
    share = float(np.clip(width * model.BREADTH_PER_LENGTH * model.DEFAULT_HAND_LENGTH / bones.hand_length, *BREADTHS))
    breadth = share * bones.hand_length
    ours = model.default_fingers(bones.hand_length, breadth)
    radius = ours["radius"] if bones.radius is None else np.minimum.accumulate(bones.radius, axis=1)
    length = bones.length.copy()
    if bones.tip_on_surface:
        # A hand file's last bone ends in the centre of the fingertip's sphere.
        length[:, 2] -= radius[:, 3]
    short = np.argwhere(~(length > SHORTEST))
    if len(short):
        finger, bone = short[0]
        raise TrajectoryError(
            f"--fit-hand: bone {bone + 1} of the {FINGERS[finger]} is {1e3 * length[finger, bone]:.1f} mm long; "
            f"expected more than {1e3 * SHORTEST:g} mm"
        )
    mirror = model.MIRROR if bones.hand == "left" else np.ones(3)
    axes: dict[str, FloatArray] = {}
    if recording.joints is not None:
        recording, axes = _fitted(recording, recording.joints, bones, mirror)
    base = bones.base * mirror
    # From the recording's palm origin to that of this hand, palm frame [m].
    shift = base[1:].mean(axis=0) - ours["base"][1:].mean(axis=0)
    sizes = {"base": base - shift, "length": length} | axes | ({} if bones.radius is None else {"radius": radius})
    fingers = {finger: {key: rows[f] for key, rows in sizes.items()} for f, finger in enumerate(FINGERS)}
    radii = "radii in proportion to its length and breadth" if bones.radius is None else "radii as recorded"
    text = model.format_hand_file(
        bones.hand_length, breadth, fingers, f"Fitted to {source}: bones as medians, {radii}."
    )
    # What no hand file may hold is refused before it is written.
    HandModel.of_text(text, FITTED)
    moved = recording.changed(position=recording.position + turned(recording.orientation, shift * mirror))
    by = f"palm moved by {1e3 * np.linalg.norm(shift):.1f} mm in the hand: its knuckles are the fitted hand's"
    return moved.found(note(by)), text


def in_angles_of(recording: Recording, hand: HandModel) -> Recording:
    """Return a recording of joint centres in the angles of a hand that was fitted to other samples of the same hand.

    Raises TrajectoryError for no joint centres.
    """
    bones, joints = recording.bones, recording.joints
    if bones is None or joints is None:
        raise TrajectoryError(f"{recording.form or 'it'} holds angles only; expected the centres of joints")
    fingers = joints[:, 1:].reshape(-1, len(FINGERS), 4, 3)
    position = fingers[:, 1:, 0].mean(axis=1) - turned(recording.orientation, hand.base[1:].mean(axis=0))
    at = in_palm(fingers - position[:, None, None], recording.orientation)
    length = hand.length.copy()
    if bones.tip_on_surface:
        length[:, 2] += hand.radius[:, 3]
    axes = FingerAxes(hand.distal, hand.dorsal, hand.abduction_sign * hand.flexion_axis)
    flexion, abduction = fitted_angles(at, hand.base, length, axes, bones.hand)
    return recording.changed(position=position, flexion=flexion, abduction=abduction)


def _fitted(
    recording: Recording, joints: FloatArray, bones: RecordedBones, mirror: FloatArray
) -> tuple[Recording, dict[str, FloatArray]]:
    """Return the recording in the angles of a hand with its own finger axes, and these axes and limits by file keys."""
    fingers = joints[:, 1:].reshape(-1, len(FINGERS), 4, 3)
    at = in_palm(fingers - recording.position[:, None, None], recording.orientation)
    axes = fitted_axes(at, bones.base, bones.hand)
    flexion, abduction = fitted_angles(at, bones.base, bones.length, axes, bones.hand)
    rms, largest = fit_error(at, finger_joints(bones.base, bones.length, flexion, abduction, axes))
    bones = replace(bones, rms=rms, largest=largest)
    fitted = recording.changed(flexion=flexion, abduction=abduction, bones=bones)
    worst = int(np.nanargmax(rms))
    text = f"finger axes fitted: joints {1e3 * rms[worst]:.1f} mm off (rms) in the {FINGERS[worst]}, less in the others"
    keys = {"distal": axes.distal * mirror, "dorsal": axes.dorsal * mirror}
    return fitted.found(note(text)), keys | recorded_limits(flexion, abduction, axes, bones.hand)


def check_hand_path(path: Path) -> None:
    """Raise OutputError if no hand file can be written: a wrong suffix, another kind of file, or no permission."""
    if path.suffix.lower() != ".toml":
        raise OutputError(f"{path} is no name for a hand file: it has to end in .toml")
    check_output_path(path, "hand file", holds(b"hand_length"))
