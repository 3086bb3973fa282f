"""LeRobot data sets: joints of hands, angles by a mapping, episodes."""

from pathlib import Path

import numpy as np
from joint_samples import joint_sample
from pose_samples import lerobot_set
from recording_samples import read_as

from hhsim.recordings.column_map import ColumnMap
from hhsim.recordings.registry import ReadOptions, read_recording
from hhsim.system.settings_file import parse_settings

ANGLES = """
hand = "right"
[time]
column = "timestamp"
[angle]
unit = "deg"
[joint]
index_flex1 = "observation.state.index_mcp"
index_flex2 = "observation.state.index_pip"
"""


def test_angles_come_by_the_names_of_the_data_set(tmp_path: Path) -> None:
    path = lerobot_set(tmp_path)
    columns = parse_settings(ANGLES, ColumnMap, "map.toml")
    recording = read_recording(path, ReadOptions(columns=columns))
    assert np.allclose(recording.flexion[:, 1, :2], joint_sample().motion.flexion[:, 1, :2])
    assert recording.form == "lerobot" and read_recording(path).device == "glove"
    # Without the data set around it a column has a number for a name.
    numbered = parse_settings(ANGLES.replace("index_mcp", "0").replace("index_pip", "1"), ColumnMap, "map.toml")
    assert np.allclose(read_as("lerobot", path.read_bytes(), columns=numbered).flexion, recording.flexion)
