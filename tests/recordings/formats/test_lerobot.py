"""LeRobot data sets: joints of hands, angles by a mapping, episodes."""

from pathlib import Path

import numpy as np
import pytest
from joint_samples import Side, assert_our_own, joint_sample, words
from pose_samples import lerobot_bytes, lerobot_set
from recording_samples import read_as

from hhsim.errors import InputError, TrajectoryError
from hhsim.recordings.column_map import ColumnMap
from hhsim.recordings.formats import lerobot
from hhsim.recordings.registry import Content, ReadOptions, read_content, read_recording
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


@pytest.mark.parametrize("side", ["right", "left"])
def test_our_own_hand_comes_back(side: Side) -> None:
    sample = joint_sample(side)
    recording = read_content(Content(data=lerobot_bytes(sample, side=side)), ReadOptions())
    assert (recording.form, recording.hand) == ("lerobot", side)
    assert np.allclose(recording.time, sample.motion.time)
    assert_our_own(recording, sample)
    said = words(recording)
    assert "taken as left, then right" in said and "is there too" not in said


def test_angles_come_by_the_names_of_the_data_set(tmp_path: Path) -> None:
    path = lerobot_set(tmp_path)
    columns = parse_settings(ANGLES, ColumnMap, "map.toml")
    recording = read_recording(path, ReadOptions(columns=columns))
    assert np.allclose(recording.flexion[:, 1, :2], joint_sample().motion.flexion[:, 1, :2])
    assert recording.form == "lerobot" and read_recording(path).device == "glove"
    # Without the data set around it a column has a number for a name.
    numbered = parse_settings(ANGLES.replace("index_mcp", "0").replace("index_pip", "1"), ColumnMap, "map.toml")
    assert np.allclose(read_as("lerobot", path.read_bytes(), columns=numbered).flexion, recording.flexion)


def test_pages_with_checksums_are_held_against_them() -> None:
    data = lerobot_bytes(checksums=True)
    assert read_as("lerobot", data).checksums == "missing", "the library does not tell whether every page has one"
    place = len(data) // 2
    with pytest.raises(TrajectoryError, match=r"a damaged one: .*CRC checksum verification failed"):
        read_as("lerobot", data[:place] + bytes([data[place] ^ 1]) + data[place + 1 :])


def test_a_column_that_contradicts_its_statistics_is_refused_and_ends_no_process() -> None:
    data = lerobot_bytes()
    place = data.index(b"\x18\ttimestamp") - 1
    # In the footer: no stamp may be missing, where the histogram of its levels has two.
    assert data[place] == 2
    with pytest.raises(TrajectoryError, match="histogram size mismatch"):
        read_as("lerobot", data[:place] + b"\0" + data[place + 1 :])


def test_more_than_a_recording_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    for limit, size, said in (("MOST_BYTES", 5000, "observation.hand_joints has 0 MB"), ("MOST_CELLS", 100, "40 rows")):
        monkeypatch.setattr(lerobot, limit, size)
        with pytest.raises(TrajectoryError, match=f"{said}; expected"):
            read_as("lerobot", lerobot_bytes())


def test_an_episode_is_chosen_never_guessed() -> None:
    data = lerobot_bytes(episodes=3)
    with pytest.raises(TrajectoryError, match="3 episodes, 0 to 2; say which: --episode"):
        read_as("lerobot", data)
    recording = read_as("lerobot", data, episode=2)
    assert recording.sample_count == 40 and any("episode 2 of 3" in f.text for f in recording.findings)
    with pytest.raises(InputError, match="--episode 7: the file has 0, 1, 2"):
        read_as("lerobot", data, episode=7)


def test_a_refusal_says_what_the_file_holds() -> None:
    import io

    import pyarrow
    from pyarrow import parquet

    stream = io.BytesIO()
    parquet.write_table(pyarrow.table({"action": [[1.0, 2.0]] * 3, "timestamp": [0.0, 0.1, 0.2]}), stream)
    with pytest.raises(TrajectoryError, match=r"no hand_joints; it holds action \(2\), timestamp \(1\); expected"):
        read_as("lerobot", stream.getvalue())
    with pytest.raises(TrajectoryError, match="not a Parquet file, or a damaged one"):
        read_as("lerobot", lerobot_bytes()[:-40])


def test_columns_that_unpack_to_far_more_than_their_file_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    data = lerobot_bytes()
    monkeypatch.setattr(lerobot, "most_unpacked", lambda size: size // 10)
    with pytest.raises(TrajectoryError, match=r"[\d,]+ bytes in a file of [\d,]+; expected a recording of a hand"):
        lerobot._columns(data)
