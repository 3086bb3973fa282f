"""Tables whose columns are named after the joints of a hand: OpenXR's 26, WebXR's 25, MediaPipe's 21.

Names vary (left_index_tip_x, XR_HAND_JOINT_INDEX_TIP_EXT_x, R_IndexTip.PosX, WRIST_x, …). Positions are read, and
radius and validity where they are there. y is up; the bend of the fingers tells OpenXR's right-handed world from
Unity's left-handed one.
"""

from hhsim.motion.csv_file import CSV_SUFFIX
from hhsim.recordings.joint_arrays import joint_columns, joints_of_table, located
from hhsim.recordings.joint_names import joint_name
from hhsim.recordings.registry import Content, JointPositions, ReadOptions, RecordingFormat

FEWEST = 4
"""Number of joints with coordinates that mark this format."""


def _read(content: Content, options: ReadOptions) -> JointPositions:
    names = {name: joint_name(name) for name in content.table.header}
    return joints_of_table(content, content.table, names, options, may_be_mirrored=True)


def _sniff(content: Content, options: ReadOptions) -> bool:
    names = {column: joint_name(column) for column in content.header} if options.columns is None else {}
    return any(len(located(joints)) >= FEWEST for joints in joint_columns(names).values())


FORMAT = RecordingFormat(
    "openxr",
    "a table with columns named after the joints: OpenXR, WebXR, Unity XR Hands, MediaPipe",
    (CSV_SUFFIX,),
    _sniff,
    _read,
)
