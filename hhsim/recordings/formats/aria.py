"""Project Aria's hand_tracking_results.csv of MPS: 21 landmarks of each hand in the frame of the glasses [m].

Their order is five fingertips from thumb to little finger, wrist, two joints of the thumb, three of each other finger,
and the palm's centre. The thumb's saddle joint is none of them: it is put where a usual hand of this size has it. The
glasses move with the head, so an object's poses are to be in their frame too. A confidence below 0 is no hand.
"""

import re
from itertools import chain

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.hand.fingers import FINGERS
from hhsim.motion.trajectory import HandSide
from hhsim.recordings.finger_ik import palm_from_knuckles, usual_hand
from hhsim.recordings.frames import turned
from hhsim.recordings.joint_names import KEYPOINTS
from hhsim.recordings.recording import SIDES
from hhsim.recordings.registry import Content, JointPositions, ReadOptions, RecordingFormat

LANDMARKS = (
    *(f"{finger}_tip" for finger in FINGERS),
    *("wrist", "thumb_proximal", "thumb_distal"),
    *(f"{finger}_{part}" for finger in FINGERS[1:] for part in ("proximal", "intermediate", "distal")),
    "palm",
)
"""OpenXR's names of the landmarks in their order."""
STAMPS, SURE = "tracking_timestamp_us", "{}_tracking_confidence"
_LANDMARK = re.compile(r"tx_(left|right)_landmark_0_device")


def landmark_columns(side: HandSide) -> dict[str, list[str]]:
    """Return the three columns of each landmark of a hand."""
    return {joint: [f"t{axis}_{side}_landmark_{k}_device" for axis in "xyz"] for k, joint in enumerate(LANDMARKS)}


def _read(content: Content, options: ReadOptions) -> JointPositions:
    """Read the hand of the options, else the one in more frames; raises TrajectoryError."""
    table = content.table
    columns = {side: [*chain(*landmark_columns(side).values())] for side in SIDES}
    columns = {side: names for side, names in columns.items() if names[0] in table.header}
    seen = {side: table.numbers([SURE.format(side)])[0][:, 0] >= 0.0 for side in columns}
    content.note(*table.notes)
    side = content.chosen_side({side: int(each.sum()) for side, each in seen.items()}, options.hand)
    values = content.numbers(table, columns[side])
    values[~seen[side]] = np.nan
    places = dict(zip(LANDMARKS, values.reshape(len(values), -1, 3).swapaxes(0, 1), strict=True))
    places["thumb_metacarpal"] = _saddle(places, side)
    content.note("the thumb's saddle joint is that of a usual hand of this size: the file has none")
    return JointPositions(
        position=np.stack([places[joint] for joint in KEYPOINTS], axis=1),
        what=f"{len(LANDMARKS)} landmarks of the {side} hand, in the frame of the glasses",
        time=table.numbers([STAMPS])[0][:, 0],
        time_unit="us",
        hand=side,
        unit=1.0,
        device="Project Aria, MPS",
    )


def _saddle(places: dict[str, FloatArray], side: HandSide) -> FloatArray:
    """Return the thumb's saddle joint [m], shape (T, 3), fixed in the palm where a usual hand has it."""
    wrist, knuckles = places["wrist"], np.stack([places[f"{finger}_proximal"] for finger in FINGERS[1:]], axis=1)
    base, usual = usual_hand(side).base, usual_hand(side).wrist
    lengths = np.linalg.norm(knuckles[:, 1] - wrist, axis=1)
    known = lengths[np.isfinite(lengths)]
    size = float(np.median(known)) / float(np.linalg.norm(base[2] - usual)) if known.size else 1.0
    palm = palm_from_knuckles(knuckles, wrist, side)
    return np.asarray(wrist + turned(palm, np.broadcast_to(size * (base[0] - usual), wrist.shape)))


FORMAT = RecordingFormat(
    "aria",
    "Project Aria's hand_tracking_results.csv of MPS",
    (".csv",),
    lambda content, options: options.columns is None and any(map(_LANDMARK.fullmatch, content.header)),
    _read,
)
