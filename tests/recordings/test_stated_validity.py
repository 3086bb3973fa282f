"""Joints of which a recording itself says that their position is not valid, in files of each kind."""

import json
from typing import Any

import numpy as np
import pytest
from joint_samples import arrays_npz, joint_sample, openxr_csv, webxr_json, words
from recording_samples import read_as

from hhsim.arrays import FloatArray
from hhsim.errors import TrajectoryError
from hhsim.motion.sample_flags import SampleFlag, marked
from hhsim.recordings.joint_names import (
    KEYPOINTS,
    MANO_JOINTS,
    OPENXR_JOINTS,
    hand_statement,
    missing_and_doubtful,
    stated_value,
)
from hhsim.recordings.recording import Recording

SAMPLE = joint_sample()
TIP = KEYPOINTS.index("index_tip")
LOST = [7, 8]
"""Samples without a valid position."""
WHERE = [k in LOST for k in range(40)]


def assert_lost(recording: Recording, finger: int | None) -> None:
    """Assert that the samples `LOST` of a finger, or of the whole hand, are missing, and no others."""
    fingers = range(5) if finger is None else [finger]
    lost = [[sample, each] for sample in LOST for each in fingers]
    assert np.argwhere(np.isnan(recording.abduction)).tolist() == lost
    assert np.flatnonzero(np.isnan(recording.position).any(axis=1)).tolist() == (LOST if finger is None else [])
    assert np.flatnonzero(marked(recording.flags, SampleFlag.INVALID)).tolist() == LOST
    assert "joints without a valid position, says the device: missing" in words(recording)


def with_column(name: str, good: str, bad: str) -> str:
    header, *rows = openxr_csv(SAMPLE).splitlines()
    cells = [bad if lost else good for lost in WHERE]
    return "\n".join([f"{header},{name}", *(f"{row},{cell}" for row, cell in zip(rows, cells))]) + "\n"


@pytest.mark.parametrize(
    ("name", "good", "bad", "finger"),
    [
        ("right_index_tip_locationFlags", "15", "1", 1),
        ("right_index_tip_flags", "0xf", "0x0", 1),
        ("right_index_tip_isValid", "True", "False", 1),
        ("right_index_tip_tracked", "1", "0", 1),
        ("right_index_tip_confidence", "0.9", "0", 1),
        ("right_isActive", "1", "0", None),
        ("right_hand_is_tracked", "true", "false", None),
        ("valid", "1.0", "0.0", None),
        ("right_confidence", "High", "-1", None),
    ],
)
def test_a_column_that_states_it(name: str, good: str, bad: str, finger: int | None) -> None:
    recording = read_as("openxr", with_column(name, good, bad))
    assert_lost(recording, finger)
    assert not any(name in each.text for each in recording.findings if each.text.startswith("not used"))


@pytest.mark.parametrize("name", ["left_isActive", "head_isTracked", "right_index_tip_orientationValid", "eye_valid"])
def test_a_column_that_states_something_else_is_not_taken(name: str) -> None:
    recording = read_as("openxr", with_column(name, "1", "0"))
    assert np.isfinite(recording.abduction).all() and not recording.flags.any()


@pytest.mark.parametrize(
    ("key", "good", "bad", "at"),
    [
        ("locationFlags", 15, 13, "joint"),
        ("isValid", True, False, "joint"),
        ("isActive", True, False, "hand"),
        ("tracked", 1, 0, "hand"),
        ("right_isActive", True, False, "frame"),
    ],
)
def test_a_key_that_states_it(key: str, good: Any, bad: Any, at: str) -> None:
    document = json.loads(webxr_json(SAMPLE))
    for frame, lost in zip(document["frames"], WHERE):
        hand = frame["hands"]["right"]
        {"joint": hand["index-finger-tip"], "hand": hand, "frame": frame}[at][key] = bad if lost else good
    recording = read_as("webxr", json.dumps(document))
    assert_lost(recording, 1 if at == "joint" else None)
    assert key not in words(recording).partition("not used:")[2]


@pytest.mark.parametrize("names", [KEYPOINTS, MANO_JOINTS, OPENXR_JOINTS])
def test_an_array_that_states_it(names: tuple[str, ...]) -> None:
    points, time = SAMPLE.named(names), SAMPLE.motion.time
    of_joints = np.ones((40, len(names)))
    of_joints[LOST, names.index("index_tip")] = 0.0
    for values, finger in ((of_joints, 1), (~np.array(WHERE), None)):
        data = arrays_npz(joints=points, t=time, is_valid=values)
        assert_lost(read_as("keypoints", data, world_up="y"), finger)


def test_a_file_that_says_that_no_joint_is_valid_is_refused() -> None:
    with pytest.raises(TrajectoryError, match=r"no joint has a valid position in any sample, says the file \(valid\)"):
        read_as("openxr", with_column("right_isActive", "0", "0"))


@pytest.mark.parametrize(
    ("stated", "missing", "doubtful"),
    [
        ({"flags": [15, 7, 2, 13, 0]}, [3, 4], [1, 2]),
        ({"valid": [1, 1, 0, 1, 0]}, [2, 4], []),
        ({"tracked": [1, 0, np.nan, 1, 1]}, [1], []),
        ({"tracked": [1, 0, 0, 1, 1], "valid": [1, 1, 0, np.nan, 1]}, [2], [1]),
        ({"confidence": [1.0, 0.4, 0.0, -1.0, np.nan]}, [2, 3], [1]),
        ({"confidence": [0.0, 1.0, 1.0, 1.0, 1.0], "flags": [15] * 5}, [], [0]),
        ({}, [], []),
    ],
)
def test_what_each_statement_means(stated: dict[str, Any], missing: list[int], doubtful: list[int]) -> None:
    given: dict[str, FloatArray] = {kind: np.array(values, np.float64)[:, None] for kind, values in stated.items()}
    for found, rows in zip(missing_and_doubtful(given, (5, 21)), (missing, doubtful)):
        assert found.shape == (5, 21) and (found == found[:, :1]).all()
        assert np.flatnonzero(found[:, 0]).tolist() == rows


def test_words_for_a_value() -> None:
    found = [stated_value(each) for each in (True, "false", "0x0F", " 3 ", "High", None, [1], "1e999")]
    np.testing.assert_array_equal(found, [1.0, 0.0, 15.0, 3.0, 1.0, np.nan, np.nan, np.inf])
    assert hand_statement("right_isActive") == ("right", "", "valid") and hand_statement("right") is None
