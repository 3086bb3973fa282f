"""BVH: our own hand in the rigs of several makers, and text that is none."""

from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from bvh_document import LOWER, RIGS, Rig, bvh_text
from correction_samples import a_correction
from joint_samples import words
from recording_samples import read_as, smooth_recording

from hhsim.errors import TrajectoryError
from hhsim.motion.sample_flags import SampleFlag, marked
from hhsim.recordings.cleaning import clean_recording
from hhsim.recordings.formats.bvh import finger_of, read_bvh, side_of
from hhsim.recordings.recording import turn
from hhsim.recordings.registry import ReadOptions, read_recording, write_recording

CLEAN = smooth_recording(25, jitter=0.0).changed(abduction=np.zeros((25, 5)))


@pytest.mark.parametrize("side", ["right", "left"])
@pytest.mark.parametrize("rig", RIGS)
def test_our_own_hand_comes_back_from_every_rig(rig: str, side: Literal["right", "left"]) -> None:
    recording = read_as("bvh", bvh_text(CLEAN, RIGS[rig], side), name="take")
    assert recording.hand == side and np.allclose(recording.time, CLEAN.time, atol=1e-4)
    assert np.abs(recording.position - CLEAN.position).max() < 1e-5
    assert np.abs(turn(recording.orientation, CLEAN.orientation)).max() < 1e-5
    assert np.abs(recording.flexion - CLEAN.flexion).max() < 1e-4
    assert np.abs(recording.abduction).max() < 1e-4
    assert recording.hand_length is not None and 0.17 < recording.hand_length < 0.2
    assert recording.form == "bvh" and f"{side} hand at" in words(recording)
    repaired = clean_recording(recording)
    assert repaired.trajectory.hand == side and {finding.kind for finding in repaired.findings} == {"note"}


def test_abduction_comes_back_where_the_finger_is_straight() -> None:
    spread = smooth_recording(25, jitter=0.0)
    spread = spread.changed(flexion=0.2 * spread.flexion)
    recording = read_as("bvh", bvh_text(spread, RIGS["mixamo"]))
    assert np.abs(recording.abduction - spread.abduction).max() < 0.01


def test_positions_are_those_of_a_chain_turned_by_hand() -> None:
    text = """HIERARCHY
ROOT a
{
  OFFSET 1 2 3
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT b
  {
    OFFSET 0 1 0
    CHANNELS 3 Zrotation Xrotation Yrotation
    End Site
    {
      OFFSET 0 1 0
    }
  }
}
MOTION
Frames: 2
Frame Time: 0.01
5 0 0 90 0 0 0 0 0
0 0 0 90 90 0 0 0 90
"""
    bvh = read_bvh(text)
    at, _ = bvh.pose()
    assert np.allclose(at[0], [[5, 0, 0], [4, 0, 0], [3, 0, 0]])
    # About z first, then about the turned x, which is the world's y by then: the bone's y becomes the world's z.
    assert np.allclose(at[1], [[0, 0, 0], [0, 0, 1], [0, 0, 2]])
    assert [joint.name for joint in bvh.joints] == ["a", "b", "b end"]


def test_names_of_many_makers() -> None:
    sides = {
        "mixamorig:RightHandThumb1": "right", "LeftInHandIndex": "left", "rThumb1": "right", "lMid2": "left",
        "f_index.01.R": "right", "index_01_l": "left", "Bip01 R Finger0": "right", "RHand": "right", "Ring1": "",
        "L_Hand": "left", "Root": "", "hand": "", "Bright": "", "mixamorigRightHand": "right", "lefthandthumb1": "left",
    }  # fmt: skip
    assert {name: side_of(name) for name in sides} == sides
    fingers = {
        "RightHandThumb1": "thumb", "rMid1": "middle", "Bip01 L Finger2": "middle", "Bip01 L Finger41": "little",
        "right_pinky3": "little", "RightHandRing2": "ring", "RightFoot": "", "pointer.L": "index",
        "Earring": "", "Spring_R": "", "R_Ring_Mid": "ring", "Middle_Thumb": "thumb", "R_Middle_Mid": "middle",
        "rSmallToe1": "", "MidSpine": "middle", "LeftFinger1Tip": "thumb", "finger5-2.R": "little", "lindex1": "index",
        "RightFirstMC": "thumb", "left_fifth_dp": "little", "FirstSpine": "", "ringfinger1": "ring", "Bring": "",
        "RightIndexFinger2": "index",
    }  # fmt: skip
    assert {name: finger_of(name) for name in fingers} == fingers


HANG = """JOINT {name}1
{{
OFFSET 0 {far} 0
JOINT {name}2
{{
OFFSET 0 1 0
JOINT {name}3
{{
OFFSET 0 1 0
JOINT {name}4
{{
OFFSET 0 1 0
}}
}}
}}
}}
"""


@pytest.mark.parametrize("name", ["Earring", "EarRing", "R_KeyRing", "MidSpine", "RightSmallToe"])
def test_what_hangs_from_elsewhere_is_no_finger(name: str) -> None:
    text = bvh_text(CLEAN, RIGS["mixamo"])
    offset = text.index("JOINT")
    other = read_as("bvh", text[:offset] + HANG.format(name=name, far=5) + text[offset:])
    assert np.abs(other.flexion - read_as("bvh", text).flexion).max() == 0.0


def test_five_fingers_that_hang_apart_are_no_hand() -> None:
    text = bvh_text(CLEAN, RIGS["mixamo"]).replace("HandRing", "HandTwist")
    above = "".join(f"JOINT Neck{k}\n{{\nOFFSET 0 1 0\n" for k in range(4))
    offset = text.index("JOINT")
    ears = above + HANG.format(name="RightEarRing", far=5) + 4 * "}\n"
    with pytest.raises(TrajectoryError, match="right: thumb, index, middle, ring, little apart"):
        read_as("bvh", text[:offset] + ears + text[offset:])


@pytest.mark.parametrize("side", ["right", "left"])
def test_a_hand_whose_joints_name_no_side_is_read_where_it_is_alone(side: Literal["right", "left"]) -> None:
    rig = Rig("world", "wrist", "{finger}{n}", LOWER)
    recording = read_as("bvh", bvh_text(CLEAN, rig, side), hand=side)
    assert recording.hand == side and np.abs(recording.flexion - CLEAN.flexion).max() < 1e-4
    # Both arms hang from one root.
    head, motion = bvh_text(CLEAN, rig, side).split("MOTION\n")
    start, inner = head.index("\tJOINT"), head.rstrip().removesuffix("}")
    frames = motion.splitlines()
    two = (
        inner
        + head[start:]
        + "MOTION\n"
        + "\n".join(frames[:2] + [f"{f} {' '.join(f.split()[6:])}" for f in frames[2:]])
    )
    with pytest.raises(TrajectoryError, match="2 hands, at 'wrist' and 'wrist', and no joint names a side"):
        read_as("bvh", two + "\n", hand=side)


def test_position_channels_of_0_leave_a_joint_at_its_offset(tmp_path: Path) -> None:
    text = bvh_text(CLEAN, RIGS["mixamo"])
    head, motion = text.split("MOTION\n")
    frames = motion.splitlines()
    six = head.replace("CHANNELS 3 Z", "CHANNELS 6 Xposition Yposition Zposition Z")
    rows = [np.array(line.split(), float).reshape(-1, 3) for line in frames[2:]]
    # Three numbers of the root's place stay, each rotation after it gets three zeros before it.
    zeros = [np.r_[row[:2].ravel(), np.c_[np.zeros((len(row) - 2, 3)), row[2:]].ravel()] for row in rows]
    lines = [" ".join(f"{value:.8f}" for value in row) for row in zeros]
    file = tmp_path / "six.bvh"
    file.write_text(six + "MOTION\n" + "\n".join(frames[:2] + lines) + "\n")
    recording = read_recording(file)
    assert "21 joints with position channels that are 0" in words(recording)
    assert np.abs(recording.flexion - read_as("bvh", text).flexion).max() < 1e-9
    # What a correction moves, it moves by the root's channels.
    off = write_recording(file, ReadOptions(), recording, a_correction(recording), tmp_path / "out.bvh")
    assert off is not None and off < 1e-5


def test_both_hands_in_one_file() -> None:
    right, left = bvh_text(CLEAN, RIGS["neuron"], "right"), bvh_text(CLEAN, RIGS["neuron"], "left")
    head, motion = right.split("MOTION\n")
    other_head, other_motion = left.split("MOTION\n")
    # The left arm hangs from the same root, after the right one.
    inner = "\n".join(other_head.split("\n")[5:])
    root = head.rstrip().removesuffix("}")
    pairs = zip(motion.splitlines()[2:], other_motion.splitlines()[2:])
    rows = [f"{one} {' '.join(other.split()[6:])}" for one, other in pairs]
    both = root + inner + "MOTION\n" + "\n".join(motion.splitlines()[:2] + rows) + "\n"
    recording = read_as("bvh", both)
    assert recording.hand == "right" and "the left one is there too" in words(recording)
    assert np.abs(recording.flexion - CLEAN.flexion).max() < 1e-4
    assert np.abs(read_as("bvh", both, hand="left").flexion - CLEAN.flexion).max() < 1e-4


def test_units_come_from_the_hand_or_the_user() -> None:
    text = bvh_text(CLEAN, RIGS["mixamo"])
    assert "taken for cm" in words(read_as("bvh", text))
    assert "taken for" not in words(read_as("bvh", text, length_unit="cm"))
    z_up = read_as("bvh", text, world_up="z")
    assert np.allclose(z_up.flexion, CLEAN.flexion, atol=1e-4)
    assert np.allclose(z_up.position[:, 2], -CLEAN.position[:, 1], atol=0.2)


def test_frames_that_are_broken_or_lost() -> None:
    lines = bvh_text(CLEAN, RIGS["mixamo"]).splitlines()
    first = lines.index("MOTION") + 3
    lines[first + 7] = lines[first + 7][:50]
    lines[first + 9] = lines[first + 9].replace(".", "x", 1)
    recording = read_as("bvh", "\n".join(lines) + "\n")
    assert "2 frames without" in words(recording)
    repaired = clean_recording(recording)
    assert repaired.trajectory.flags is not None
    assert np.flatnonzero(marked(repaired.trajectory.flags, SampleFlag.PALM_FILLED)).tolist() == [7, 9]
    short = read_as("bvh", "\n".join(lines[:-5]) + "\n")
    assert "20 frames where the file says 25" in words(short)
    cut = read_as("bvh", "\n".join(lines)[:-3])
    assert cut.sample_count == 24 and "has no line end" in words(cut)


TEXT = bvh_text(CLEAN, RIGS["mixamo"])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("HIERARCHY", "a BVH hierarchy without MOTION"),
        ("HIERARCHY\n}", "line 2 is '}', which no BVH"),
        ("HIERARCHY\nJOINT a", "line 2 is 'JOINT a', which no BVH"),
        ("HIERARCHY\nROOT a\n{\n}", "line 4: a has no OFFSET"),
        ("HIERARCHY\nROOT a\n{\nOFFSET 1 2 nan", "line 4: OFFSET 1 2 nan; expected 3 number"),
        ("HIERARCHY\nROOT a\n{\nCHANNELS 1 Wrotation", "expected CHANNELS, their number"),
        ("HIERARCHY\nhello", "line 2 is 'hello'"),
        (TEXT.replace("Frame Time: 0.010000", "Frame Time: 0"), "expected seconds between frames"),
        (TEXT.split("Frame Time")[0], "no Frames: and Frame Time:"),
        (TEXT[: TEXT.index("Frame Time") + 20] + "\n", "no frames"),
        (TEXT.replace("HandIndex", "HandToe"), "no hand with five fingers of three joints each"),
        (
            TEXT.replace("Hand", "Foot").replace("Thumb", "A"),
            r"such as mixamorig:RightArm, .*expected right or left, and",
        ),
        ("HIERARCHY\n" + "ROOT a\n{\nOFFSET 0 0 0\n" + "JOINT b\n{\nOFFSET 0 0 0\n" * 3000, "more than 2000 joints"),
    ],
)
def test_what_is_no_hand_is_refused(text: str, said: str) -> None:
    with pytest.raises(TrajectoryError, match=said):
        read_as("bvh", text)
    with pytest.raises(TrajectoryError, match="no left hand; the file has a right one"):
        read_as("bvh", TEXT, hand="left")
