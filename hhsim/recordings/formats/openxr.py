"""Tables whose columns are named after the joints of a hand: OpenXR's 26, WebXR's 25, MediaPipe's 21.

Names vary (left_index_tip_x, XR_HAND_JOINT_INDEX_TIP_EXT_x, R_IndexTip.PosX, WRIST_x, …). Positions are read, and
radius and validity where they are there. y is up; the bend of the fingers tells OpenXR's right-handed world from
Unity's left-handed one.
"""

import numpy as np

from hhsim.hand.fingers import FINGERS
from hhsim.hand.model import BREADTH_PER_LENGTH, CARPAL, METACARPAL
from hhsim.motion.csv_file import CSV_SUFFIX
from hhsim.motion.csv_table import Table, read_table
from hhsim.recordings.content import Content, ReadOptions
from hhsim.recordings.correction import Changes
from hhsim.recordings.frames import turned, world_matrix
from hhsim.recordings.joint_arrays import joint_columns, joint_edits, joints_of_table, located, table_of_joints
from hhsim.recordings.joint_names import KEYPOINTS, OPENXR_JOINTS, JointName, joint_name
from hhsim.recordings.joint_positions import JointPositions
from hhsim.recordings.recording import HandMotion, Recording
from hhsim.recordings.registry import RecordingFormat

FEWEST = 4
"""Number of joints with coordinates that mark this format."""


def _table(content: Content) -> tuple[Table, dict[str, JointName]]:
    """Return the table, and the meanings of its columns by their names."""
    table = read_table(content.text)
    return table, {column: joint_name(column) for column in table.header}


def _read(content: Content, options: ReadOptions) -> JointPositions:
    return joints_of_table(*_table(content), options, may_be_mirrored=True)


def _write(content: Content, options: ReadOptions, recording: Recording, made: Changes) -> bytes:
    table, names = _table(content)
    return content.edited(joint_edits(content.exact_text, table, names, options, made), table.decimal)


def _make(suffix: str, motion: HandMotion) -> bytes:
    """Return a table of 26 joints in OpenXR's world; palm and metacarpals are those of a usual hand of this size."""
    hand, joints = motion.configuration, motion.joints
    wrist, knuckle = joints[:, 0], joints[:, KEYPOINTS.index("middle_proximal")]
    (distal, lateral), mirror = CARPAL, -1.0 if motion.side == "left" else 1.0
    length = float(np.nanmedian(np.linalg.norm(knuckle - wrist, axis=1))) / (distal + METACARPAL[1][0])
    places = {name: joints[:, k] for k, name in enumerate(KEYPOINTS)} | {"palm": hand.position}
    for finger, across in zip(FINGERS[1:], lateral[1:]):
        base = length * np.array([-mirror * across * BREADTH_PER_LENGTH, distal, 0.0])
        places[f"{finger}_metacarpal"] = wrist + turned(hand.orientation, base)
    points = np.stack([places[name] for name in OPENXR_JOINTS], axis=1) @ world_matrix("y")
    return table_of_joints(motion, OPENXR_JOINTS, points)


def _sniff(content: Content, options: ReadOptions) -> bool:
    names = {column: joint_name(column) for column in content.header} if options.columns is None else {}
    return any(len(located(joints)) >= FEWEST for joints in joint_columns(names).values())


FORMAT = RecordingFormat(
    "openxr",
    "a table with columns named after the joints: OpenXR, WebXR, Unity XR Hands, MediaPipe",
    (CSV_SUFFIX,),
    _sniff,
    _read,
    write=_write,
    make=_make,
    made=(CSV_SUFFIX,),
)
