"""Tables whose columns are named after the joints of a hand: OpenXR's 26, WebXR's 25, MediaPipe's 21.

Names vary (left_index_tip_x, XR_HAND_JOINT_INDEX_TIP_EXT_x, R_IndexTip.PosX, WRIST_x, …). Positions are read, and
radius and validity where they are there. y is up; the bend of the fingers tells OpenXR's right-handed world from
Unity's left-handed one.
"""

from hhsim.motion.csv_file import CSV_SUFFIX
from hhsim.motion.csv_table import Table, read_table
from hhsim.recordings.content import Content, ReadOptions
from hhsim.recordings.correction import Changes
from hhsim.recordings.joint_arrays import joint_columns, joint_edits, joints_of_table, located
from hhsim.recordings.joint_names import JointName, joint_name
from hhsim.recordings.joint_positions import JointPositions
from hhsim.recordings.recording import Recording
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
)
