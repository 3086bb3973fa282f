"""Names of joints, and of columns of stamps, as makers write them."""

import numpy as np
import pytest

from hhsim.recordings.joint_names import KEYPOINTS, OPENXR_JOINTS, WEBXR_JOINTS, joint_name
from hhsim.recordings.unit_detection import TimeColumn, time_column


@pytest.mark.parametrize(
    ("seconds", "fraction", "expected"),
    [
        ([5, 6], [900_000_000, 100_000_000], [5.9e9, 6.1e9]),
        # Two clocks of one name: each has the whole stamp.
        ([5.9, 6.1], [5_900_000_000, 6_100_000_000], [5.9e9, 6.1e9]),
        ([0.25, 0.5], [250_000_000, 500_000_000], [0.25e9, 0.5e9]),
    ],
)
def test_seconds_and_nanoseconds_make_one_stamp(
    seconds: list[float], fraction: list[float], expected: list[float]
) -> None:
    held = {"sec": np.array(seconds, float), "nanosec": np.array(fraction, float)}
    column = time_column(held)
    assert column is not None and column.stamps(held.__getitem__).tolist() == expected


def test_the_sets_are_as_large_as_their_standards_say() -> None:
    assert (len(KEYPOINTS), len(WEBXR_JOINTS), len(OPENXR_JOINTS)) == (21, 25, 26)
    assert KEYPOINTS[4] == "thumb_tip" and KEYPOINTS[5] == "index_proximal" and KEYPOINTS[20] == "little_tip"
    for joint in OPENXR_JOINTS:
        assert joint_name(joint) == ("", joint, "")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("left_index_tip_x", ("left", "index_tip", "x")),
        ("XR_HAND_JOINT_INDEX_TIP_EXT", ("", "index_tip", "")),
        ("index-finger-phalanx-proximal", ("", "index_proximal", "")),
        ("pinky-finger-metacarpal", ("", "little_metacarpal", "")),
        ("R_IndexTip.PosX", ("right", "index_tip", "x")),
        ("RightHandThumbDistal_pz", ("right", "thumb_distal", "z")),
        ("INDEX_FINGER_MCP_y", ("", "index_proximal", "y")),
        ("THUMB_IP", ("", "thumb_distal", "")),
        ("right_wrist_qx", ("right", "wrist", "rotation")),
        ("left_palm_radius", ("left", "palm", "radius")),
        ("LeftMiddleProximalRotationX", ("left", "middle_proximal", "rotation")),
        ("ring_tip_valid", ("", "ring_tip", "valid")),
        ("left_ring_tip_locationFlags", ("left", "ring_tip", "flags")),
        ("R_IndexTip.isTracked", ("right", "index_tip", "tracked")),
        ("right_palm_positionValid", ("right", "palm", "valid")),
        ("right_palm_orientationValid", ("right", "palm", "")),
        ("thumb_intermediate_x", ("", "", "x")),
        ("emg_3", ("", "", "")),
    ],
)
def test_what_a_name_says(text: str, said: tuple[str, str, str]) -> None:
    assert joint_name(text) == said


@pytest.mark.parametrize(
    ("names", "found"),
    [
        (["x", "y"], None),
        (["frame", "t"], TimeColumn("t", None)),
        (["timestamp_ms", "x"], TimeColumn("timestamp_ms", "ms")),
        (["Time [s]"], TimeColumn("Time [s]", "s")),
        (["timestampNs"], TimeColumn("timestampNs", "ns")),
        (["time_seconds"], TimeColumn("time_seconds", "s")),
        (["time_of_day", "host_time", "device_time_us"], TimeColumn("device_time_us", "us", ("host_time",))),
        (["stampNanoSec"], TimeColumn("stampNanoSec", "ns")),
        (
            ["header.stamp.sec", "header.stamp.nanosec"],
            TimeColumn("header.stamp.sec", "ns", (), "header.stamp.nanosec"),
        ),
        (["stamp_nsecs", "x", "stamp_secs"], TimeColumn("stamp_secs", "ns", (), "stamp_nsecs")),
        (["tv_sec", "tv_usec"], TimeColumn("tv_sec", "us", (), "tv_usec")),
        (["seconds", "nanos"], TimeColumn("seconds", "ns", (), "nanos")),
        (["device_time_s", "stamp_sec", "stamp_nsec"], TimeColumn("device_time_s", "s", ("stamp_sec", "stamp_nsec"))),
        (["x_s", "y_ns"], None),
    ],
)
def test_the_stamps_are_found_with_their_unit(names: list[str], found: TimeColumn | None) -> None:
    assert time_column(names) == found
