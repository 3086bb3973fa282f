"""Hand model with the sizes of a recorded hand: its bones, and its radii or radii in proportion to it."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import OutputError, TrajectoryError
from hhsim.hand.fingers import FINGERS
from hhsim.hand.hand_file import format_hand_file
from hhsim.hand.model import (
    BREADTH_PER_LENGTH,
    DEFAULT_HAND_LENGTH,
    HAND_LENGTH_RANGE,
    MIRROR,
    HandModel,
    default_fingers,
)
from hhsim.recordings.finger_ik import usual_fingers
from hhsim.recordings.frames import turned
from hhsim.recordings.recording import Recording, note
from hhsim.system.input_file import read_input
from hhsim.system.output_path import check_output_path

BREADTHS = (0.26, 0.74)
"""Range of hand breadths that the palm model takes [hand lengths]."""
SHORTEST = 0.004
"""Shortest bone, to the centre of the fingertip [m]."""


class FittedHand(NamedTuple):
    """Sizes of a right hand, or of the mirror of a left one, palm frame.

    Attributes:
        hand_length, hand_breadth: Sizes [m].
        base: First joint of each finger [m], shape (5, 3).
        length: Lengths of the bones, the last one to the centre of the tip's sphere [m], shape (5, 3).
        radius: Radii at the joints and the tip [m], shape (5, 4); not growing towards the tip.
        measured: True if the radii were recorded.
        shift: Vector from the recording's palm origin to that of this hand, recorded palm frame [m], shape (3,).
    """

    hand_length: float
    hand_breadth: float
    base: FloatArray
    length: FloatArray
    radius: FloatArray
    measured: bool
    shift: FloatArray


def fitted_hand(recording: Recording) -> FittedHand:
    """Fit a hand to a recording; raise TrajectoryError without joint centres, or for bones that are no hand's."""
    bones = recording.bones
    if bones is None:
        form = recording.form or "it"
        raise TrajectoryError(f"--fit-hand needs the centres of the joints, and {form} holds angles only")
    low, high = HAND_LENGTH_RANGE
    if not low <= bones.hand_length <= high:
        raise TrajectoryError(f"--fit-hand: the hand is {bones.hand_length:.3g} m long; expected {low:g} to {high:g} m")
    usual = usual_fingers()["base"]
    width = np.linalg.norm(bones.base[1] - bones.base[4]) / np.linalg.norm(usual[1] - usual[4])
    share = float(np.clip(width * BREADTH_PER_LENGTH * DEFAULT_HAND_LENGTH / bones.hand_length, *BREADTHS))
    breadth = share * bones.hand_length
    ours = default_fingers(bones.hand_length, breadth)
    radius = ours["radius"] if bones.radius is None else np.minimum.accumulate(bones.radius, axis=1)
    length = bones.length.copy()
    if bones.tip_on_surface:
        length[:, 2] -= radius[:, 3]
    short = np.argwhere(~(length > SHORTEST))
    if len(short):
        finger, bone = short[0]
        raise TrajectoryError(
            f"--fit-hand: bone {bone + 1} of the {FINGERS[finger]} is {1e3 * length[finger, bone]:.1f} mm long; "
            f"expected more than {1e3 * SHORTEST:g} mm"
        )
    mirror = MIRROR if bones.hand == "left" else np.ones(3)
    base = bones.base * mirror
    shift = base[1:].mean(axis=0) - ours["base"][1:].mean(axis=0)
    measured = bones.radius is not None
    return FittedHand(bones.hand_length, breadth, base - shift, length, radius, measured, shift * mirror)


def for_hand(recording: Recording, hand: FittedHand) -> Recording:
    """Return the recording with its palm moved so that the knuckles of the fitted hand are the recorded ones."""
    moved = recording.position + turned(recording.orientation, hand.shift)
    text = f"palm moved by {1e3 * np.linalg.norm(hand.shift):.1f} mm in the hand: its knuckles are the fitted hand's"
    return recording.changed(position=moved).found(note(text))


def format_fitted_hand(hand: FittedHand, source: str) -> str:
    """Return the hand as the text of a hand file; `source` names the recording in its first line.

    Raises:
        InputError: `hhsim replay --hand-file` could make no hand of it.
    """
    fingers = {finger: {"base": hand.base[f], "length": hand.length[f]} for f, finger in enumerate(FINGERS)}
    if hand.measured:
        fingers = {finger: sizes | {"radius": hand.radius[f]} for f, (finger, sizes) in enumerate(fingers.items())}
    radii = "radii as recorded" if hand.measured else "radii in proportion to its length and breadth"
    title = f"Fitted to {source}: bones as medians, {radii}."
    text = format_hand_file(hand.hand_length, hand.hand_breadth, fingers, title)
    # What no hand file may hold is refused before it is written.
    HandModel.of_text(text, "--fit-hand")
    return text


def check_hand_path(path: Path) -> None:
    """Raise OutputError if no hand file can be written: a wrong suffix, another kind of file, or no permission."""
    if path.suffix.lower() != ".toml":
        raise OutputError(f"{path} is no name for a hand file: it has to end in .toml")
    check_output_path(path)
    if path.exists() and "hand_length" not in read_input(path).decode(errors="replace"):
        raise OutputError(f"{path} exists and is no hand file, so it is not replaced: name another file")
