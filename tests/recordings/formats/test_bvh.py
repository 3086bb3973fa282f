"""BVH: our own hand in the rigs of several makers, and text that is none."""

from typing import Literal

import numpy as np
import pytest
from bvh_document import LOWER, RIGS, Rig, bvh_text
from joint_samples import words
from recording_samples import read_as, smooth_recording

from hhsim.errors import TrajectoryError
from hhsim.recordings.formats.bvh import finger_of, read_bvh, side_of

CLEAN = smooth_recording(25, jitter=0.0).changed(abduction=np.zeros((25, 5)))


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
    with pytest.raises(TrajectoryError, match="no hand with five fingers"):
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


def test_frames_that_are_broken_or_lost() -> None:
    lines = bvh_text(CLEAN, RIGS["mixamo"]).splitlines()
    frame = lines.index("MOTION") + 10
    for broken in (lines[frame][:50], lines[frame].replace(".", "x", 1)):
        with pytest.raises(TrajectoryError, match=rf"line {frame + 1}: frame .*; expected \d+ numbers"):
            read_as("bvh", "\n".join([*lines[:frame], broken, *lines[frame + 1 :]]) + "\n")
    short = read_as("bvh", "\n".join(lines[:-5]) + "\n")
    assert "20 frames where the file says 25" in words(short)
    cut = read_as("bvh", "\n".join(lines)[:-3])
    assert cut.sample_count == 24 and "has no line end" in words(cut)
