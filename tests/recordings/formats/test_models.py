"""Dexmo's channels, BVH and MANO: calibrations, rigs of many makers, plain skinning; nothing of a pickle runs."""

import os
import pickle
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from bvh_document import LOWER, RIGS, Rig, bvh_text
from joint_samples import arrays_npz, joint_sample, words
from pose_samples import mano_fields
from recording_samples import read_as, smooth_recording
from scipy.sparse import csc_matrix
from scipy.spatial.transform import Rotation

from hhsim.arrays import FloatArray
from hhsim.errors import InputError, TrajectoryError
from hhsim.hand.model import HandModel
from hhsim.motion.npz_arrays import read_npz
from hhsim.recordings.column_map import JOINT_NAMES
from hhsim.recordings.dexmo_regression import BEND, CHANNELS, DexmoRegression, read_calibration
from hhsim.recordings.formats.bvh import finger_of, side_of
from hhsim.recordings.formats.mano import KEYPOINT_JOINTS, TIPS, poses_of, read_mano_model
from hhsim.recordings.registry import Changes, Content, ReadOptions, format_of, read_recording

CLEAN = smooth_recording(25, jitter=0.0).changed(abduction=np.zeros((25, 5)))


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


def two_arms(one: str, other: str) -> str:
    """The motion of one file, with the arm of another one behind its own at the same root."""
    (head, motion), (arm, moved) = (text.split("MOTION\n") for text in (one, other))
    pairs = zip(motion.splitlines()[2:], moved.splitlines()[2:])
    rows = [f"{own} {' '.join(others.split()[6:])}" for own, others in pairs]
    root = head.rstrip().removesuffix("}") + arm[arm.index("\tJOINT") :]
    return "\n".join([f"{root}MOTION", *motion.splitlines()[:2], *rows]) + "\n"


@pytest.mark.parametrize("side", ["right", "left"])
def test_a_hand_whose_joints_name_no_side_is_read_where_it_is_alone(side: Literal["right", "left"]) -> None:
    rig = Rig("world", "wrist", "{finger}{n}", LOWER)
    recording = read_as("bvh", bvh_text(CLEAN, rig, side), hand=side)
    assert recording.hand == side and np.abs(recording.flexion - CLEAN.flexion).max() < 1e-4
    with pytest.raises(TrajectoryError, match="2 hands, at 'wrist' and 'wrist', and no joint names a side"):
        read_as("bvh", two_arms(*[bvh_text(CLEAN, rig, side)] * 2), hand=side)


def test_both_hands_in_one_file() -> None:
    both = two_arms(*(bvh_text(CLEAN, RIGS["neuron"], side) for side in ("right", "left")))
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


def any_fields() -> dict[str, Any]:
    """A model with every array at random."""
    random = np.random.default_rng(3)
    fields = mano_fields(joint_sample().hand)
    weights = random.uniform(0.0, 1.0, (778, 16))
    regressor = random.uniform(0.0, 1.0, (16, 778))
    return fields | {
        "shapedirs": random.normal(0.0, 1e-3, (778, 3, 10)),
        "posedirs": random.normal(0.0, 1e-3, (778, 3, 135)),
        "weights": weights / weights.sum(axis=1, keepdims=True),
        "J_regressor": regressor / regressor.sum(axis=1, keepdims=True),
    }


def test_joints_and_tips_are_those_of_a_plain_skinning(tmp_path: Path) -> None:
    fields = any_fields()
    np.savez(tmp_path / "model.npz", **fields)
    random = np.random.default_rng(4)
    turn, pose = random.normal(0.0, 0.7, (5, 3)), random.normal(0.0, 0.5, (5, 45))
    shift, betas = random.normal(0.0, 0.3, (5, 3)), random.normal(0.0, 1.0, 10)
    model = read_mano_model(tmp_path / "model.npz")
    found = model.keypoints(turn, pose, shift, betas)
    skinned = model.vertices(turn, pose, shift, betas)
    rest = fields["v_template"] + fields["shapedirs"] @ betas
    joints = fields["J_regressor"] @ rest
    parents = fields["kintree_table"][0]
    for t in range(5):
        turns = Rotation.from_rotvec(np.concatenate([turn[t], pose[t]]).reshape(16, 3)).as_matrix()
        skin = rest + fields["posedirs"] @ (turns[1:] - np.eye(3)).ravel()
        world: list[Any] = []
        for j in range(16):
            local = np.eye(4)
            local[:3, :3] = turns[j]
            local[:3, 3] = joints[j] - (joints[parents[j]] if j else 0.0)
            world.append(world[parents[j]] @ local if j else local)
        at = np.array([matrix[:3, 3] for matrix in world])
        relative = np.array(
            [m @ np.block([[np.eye(3), -joints[j, :, None]], [np.zeros(3), 1.0]]) for j, m in enumerate(world)]
        )
        blend = np.einsum("vj,jab->vab", fields["weights"], relative)
        vertices = np.einsum("vab,vb->va", blend, np.concatenate([skin, np.ones((778, 1))], axis=1))[:, :3]
        expected = [at[0]]
        for finger in range(5):
            expected += [*at[list(KEYPOINT_JOINTS[1 + 3 * finger : 4 + 3 * finger])], vertices[TIPS[finger]]]
        assert np.allclose(found[t], np.array(expected) + shift[t], atol=1e-12)
        assert np.allclose(skinned[t], vertices + shift[t], atol=1e-12)
    assert np.allclose(skinned[:, list(TIPS)], found[:, 4::4], atol=1e-12)


def test_a_wrist_that_moves_needs_a_translation(tmp_path: Path) -> None:
    np.savez(tmp_path / "model.npz", **any_fields())
    options = ReadOptions(mano_model=tmp_path / "model.npz", mano_pose="axis-angle")
    row, still = np.zeros(1, np.int64), np.zeros((1, 3))
    turn = np.tile(np.eye(3), (1, 16, 1, 1))
    made = Changes(row, np.full((1, 21, 3), 1e-3), turn, still, still, np.zeros((1, 20)), 6)

    def corrected(made: Changes, **more: Any) -> dict[str, Any]:
        content = Content(data=arrays_npz(poses=np.zeros((2, 48)), **more))
        names = {"pose": "poses"} | ({"translation": "trans"} if more else {})
        return read_npz(poses_of(content, names, "right").corrected(content, options, made))

    with pytest.raises(InputError, match="the file holds no translation: expected an array trans"):
        corrected(made)
    assert np.allclose(corrected(made._replace(shift=0.0 * made.shift))["poses"], 0.0)
    assert np.array_equal(corrected(made, trans=np.zeros((2, 3)))["trans"], [[1e-3] * 3, [0.0] * 3])


def test_triangles_may_be_missing_but_not_wrong(tmp_path: Path) -> None:
    path, fields = tmp_path / "model.pkl", any_fields()
    path.write_bytes(pickle.dumps(fields))
    assert read_mano_model(path).faces.shape == (0, 3)
    faces = np.array([[0, 1, 2], [777, 2, 1]], dtype=np.uint32)
    path.write_bytes(pickle.dumps(fields | {"f": faces}))
    assert np.array_equal(read_mano_model(path).faces, faces)
    for wrong, said in ((faces + 1, "a vertex that does not exist"), (np.zeros(4), r"'f' has shape \(4,\)")):
        path.write_bytes(pickle.dumps(fields | {"f": wrong}))
        with pytest.raises(TrajectoryError, match=said):
            read_mano_model(path)


def test_a_pickle_of_data_is_read_and_another_is_not_loaded(tmp_path: Path) -> None:
    fields = any_fields()
    path = tmp_path / "MANO_RIGHT.pkl"
    for protocol in (2, 4):
        path.write_bytes(pickle.dumps(fields | {"J_regressor": csc_matrix(fields["J_regressor"])}, protocol=protocol))
        model = read_mano_model(path)
        assert np.array_equal(model.regressor, fields["J_regressor"])
        assert np.array_equal(model.mean, fields["hands_mean"])
    path.write_bytes(pickle.dumps(fields | {"extra": os.system}))
    with pytest.raises(TrajectoryError, match=r"holds posix.system, which is not data, so it is not loaded; make an"):
        read_mano_model(path)


@pytest.mark.soak
def test_what_is_no_model_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "model.pkl"
    fields = any_fields()
    looped = fields["kintree_table"].copy()
    looped[0, 1] = 5
    cases: list[tuple[bytes, str]] = [
        (b"", "no pickle, or a damaged one"),
        (pickle.dumps([1]), "a pickle of something else"),
        (pickle.dumps({"a": 1}), "no 'v_template', it holds a; expected a MANO model"),
        (pickle.dumps(fields | {"weights": np.zeros(3)}), r"'weights' has shape \(3,\); expected \(778, 16\)"),
        (pickle.dumps(fields | {"hands_mean": "x"}), "'hands_mean' is no array of numbers"),
        (pickle.dumps(fields | {"kintree_table": looped}), "no tree of 16 joints"),
    ]
    for data, said in cases:
        path.write_bytes(data)
        with pytest.raises(TrajectoryError, match=said):
            read_mano_model(path)
    with pytest.raises(TrajectoryError, match="no such file"):
        read_mano_model(tmp_path / "none.pkl")


DEFAULT = DexmoRegression.default()
LOW = np.linspace(700.0, 1300.0, 11)
HIGH = LOW + np.where(np.arange(11) == 3, 37.0, 2000.0)


def test_the_default_opens_closes_and_stays_within_the_hand() -> None:
    flexion, abduction = DEFAULT.angles(np.zeros(11))
    assert not flexion.any() and np.degrees(abduction[0]) == pytest.approx(-10.0) and not abduction[1:].any()
    fist, _ = DEFAULT.angles(np.isin(np.arange(11), BEND).astype(float))
    assert np.allclose(np.degrees(fist[1:]), [85.0, 100.0, 200.0 / 3.0])
    assert np.allclose(fist[1:, 2] / fist[1:, 1], 2.0 / 3.0)
    limits = HandModel.default()
    random = np.random.default_rng(1).uniform(0.0, 1.0, (200, 11))
    flexion, abduction = DEFAULT.angles(random)
    assert flexion.shape == (200, 5, 3) and abduction.shape == (200, 5)
    assert (flexion >= limits.flexion_min).all() and (flexion <= limits.flexion_max).all()
    assert (abduction >= limits.abduction_min).all() and (abduction <= limits.abduction_max).all()


def test_the_bends_of_a_posture_are_the_channels_that_made_it() -> None:
    bend = np.random.default_rng(2).uniform(0.0, 1.0, (50, 5))
    channels = np.zeros((50, 11))
    channels[:, BEND] = bend
    flexion, _ = DEFAULT.angles(channels)
    assert np.allclose(DEFAULT.bends(flexion), bend)
    assert (DEFAULT.bends(flexion + 3.0) == 1.0).all() and (DEFAULT.bends(flexion - 3.0) == 0.0).all()
    mixed = flexion + np.random.default_rng(3).normal(0.0, 0.05, flexion.shape)
    best = DEFAULT.bends(mixed)

    def off(bend: FloatArray) -> FloatArray:
        channels[:, BEND] = bend
        return np.asarray(((DEFAULT.angles(channels)[0] - mixed) ** 2).sum(axis=2))

    for step in (-0.01, 0.01):
        assert (off(np.clip(best + step, 0.0, 1.0)) >= off(best) - 1e-12).all()


CALIBRATION = """[channel]
{}

[angle]
unit = 'deg'

[joint]
index_flex2 = {{ offset = 2.0, index_bend = 98.0 }}
""".format("\n".join(f"{name} = {{ open = {a}, closed = {b} }}" for name, a, b in zip(CHANNELS, LOW, HIGH)))


def test_raw_counts_are_read_by_a_calibration(tmp_path: Path) -> None:
    (tmp_path / "glove.toml").write_text(CALIBRATION)
    glove = read_calibration(tmp_path / "glove.toml")
    assert glove.in_counts and not DEFAULT.in_counts
    row = JOINT_NAMES.index("index_flex2")
    assert np.degrees(glove.offset[row]) == pytest.approx(2.0)
    assert np.degrees(glove.slope[row, 4]) == pytest.approx(98.0)
    assert np.allclose(np.delete(glove.slope, row, axis=0), np.delete(DEFAULT.slope, row, axis=0))
    channels = np.random.default_rng(4).uniform(0.0, 1.0, (20, 11))
    names = ",".join(name.replace("little", "pinky") for name in CHANNELS)
    rows = (f"{0.01 * k},{','.join(map(repr, row))}" for k, row in enumerate((LOW + channels * (HIGH - LOW)).tolist()))
    (tmp_path / "session.csv").write_text("\n".join([f"time,{names}", *rows]) + "\n")
    recording = read_recording(tmp_path / "session.csv", ReadOptions(dexmo=glove))
    assert np.allclose(recording.flexion, glove.angles(LOW + channels * (HIGH - LOW))[0])


def test_the_page_has_the_header_of_a_gloves_table(repository: Path) -> None:
    page = (repository / "docs" / "lab" / "recordings.md").read_text(encoding="utf-8")
    header = next(line for line in page.splitlines() if line.startswith("time,thumb_rotate"))
    assert format_of(Content(data=f"{header}\n".encode()), ReadOptions()).name == "dexmo"
    assert len(header.split(",")) == 12
