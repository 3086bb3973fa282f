"""21 keypoints as bare numbers in four kinds of file."""

import io
import json
import pickle
import re
import zipfile
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from correction_samples import a_correction
from hypothesis import given
from hypothesis import strategies as st
from joint_samples import array_npy, arrays_npz, assert_our_own, joint_sample, words
from recording_samples import read_as

from hhsim.errors import InputError, TrajectoryError
from hhsim.hand.fingers import FINGERS
from hhsim.recordings.formats import keypoints
from hhsim.recordings.joint_names import JOINT_ORDERS, KEYPOINTS, MANO_JOINTS, OPENXR_JOINTS, UNITY_JOINTS, WEBXR_JOINTS
from hhsim.recordings.registry import Content, ReadOptions, read_content, read_recording, write_recording

SAMPLE = joint_sample()
POINTS, TIME = SAMPLE.named(), SAMPLE.motion.time


def table(header: list[str], *, stamps: bool = True, points: Any = POINTS) -> str:
    rows = [[*([t] if stamps else []), *point.ravel().tolist()] for t, point in zip(TIME, points)]
    return "\n".join([",".join(header), *(",".join(map(repr, map(float, row))) for row in rows)]) + "\n"


def zipped(name: str) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr(name, "time,a\n0,1\n")
    return file.getvalue()


FILES: dict[str, Any] = {
    "npy": array_npy(POINTS),
    "npy flat": array_npy(POINTS.reshape(-1, 63)),
    "npz": arrays_npz(keypoints=POINTS, t=TIME, other=POINTS[:, :5]),
    "npz any name": arrays_npz(a=POINTS.reshape(-1, 63), timestamps_ms=1e3 * TIME),
    "csv plain": table(["time_s", *(f"c{k}" for k in range(63))]),
    "csv numbered": table(["time_s", *(f"right_lm{k:02d}_{a}" for k in range(21) for a in "xyz")]),
    "csv xyz": table([f"{a}{k}" for k in range(21) for a in "xyz"], stamps=False),
    "csv bare": table(["none"], stamps=False).partition("\n")[2],
    "csv savetxt": table(["none"], stamps=False).partition("\n")[2].replace(",", " "),
    "csv of pandas": table([str(k) for k in range(63)], stamps=False),
    "json list": json.dumps(POINTS.tolist()),
    "json frames": json.dumps([{"t": t, "landmarks": p} for t, p in zip(TIME.tolist(), POINTS.tolist())]),
    "json objects": json.dumps(
        {
            "fps": 30,
            "frames": [
                {"timestamp_ms": 1e3 * t, "world_landmarks": [dict(zip("xyz", p)) for p in points]}
                for t, points in zip(TIME.tolist(), POINTS.tolist())
            ],
        }
    ),
}


@pytest.mark.parametrize("form", FILES)
def test_our_own_hand_comes_back(form: str) -> None:
    data = FILES[form] if isinstance(FILES[form], bytes) else FILES[form].encode()
    options = ReadOptions(rate=100.0, world_up="y")
    recording = read_content(Content(data=data, name="take"), options)
    assert (recording.form, recording.hand, recording.sample_count) == ("keypoints", "right", 40)
    assert_our_own(recording, SAMPLE)
    made = "no stamps: made from the rate, 100 Hz" in words(recording)
    assert made is (form in ("npy", "npy flat", "csv xyz", "csv bare", "csv savetxt", "csv of pandas", "json list"))
    assert np.allclose(recording.time, np.arange(40) / 100 if made else TIME, atol=1e-9)
    still = read_content(Content(data=data, name="take"), ReadOptions(rate=100.0))
    assert (still.position == 0.0).all() and "the wrist stands still" in words(still)


IN_MANO = POINTS[:, [KEYPOINTS.index(joint) for joint in MANO_JOINTS]]
MANO_FILES: dict[str, Any] = {
    "npy": array_npy(IN_MANO),
    "npz": arrays_npz(joints=IN_MANO, t=TIME),
    "mirrored": arrays_npz(joints=1e3 * IN_MANO * [-1.0, 1.0, 1.0], t=TIME),
    "csv": table([f"{a}{k}" for k in range(21) for a in "xyz"], stamps=False, points=IN_MANO).encode(),
    "json": json.dumps(IN_MANO.tolist()).encode(),
}


@pytest.mark.parametrize("form", MANO_FILES)
def test_manos_order_is_found_by_the_bones_and_kept_for_the_way_back(form: str) -> None:
    recording = read_as("keypoints", MANO_FILES[form], rate=100.0, world_up="y")
    assert "21 joints in MANO's order" in words(recording) and "by the lengths of its bones" in words(recording)
    assert recording.joints is not None
    if form == "mirrored":
        assert recording.hand == "left"
    else:
        assert_our_own(recording, SAMPLE)
    # Rows of the file from joints in our order, as a writer makes them.
    back = recording.file_frame.to_file(recording.joints)
    rows = np.empty_like(back)
    rows[:, list(recording.joint_order)] = back
    scale = [-1e3, 1e3, 1e3] if form == "mirrored" else 1.0
    np.testing.assert_allclose(rows, IN_MANO * scale, atol=1e-12 * np.abs(scale).max())
    same = read_as("keypoints", array_npy(POINTS), rate=100.0, world_up="y")
    assert same.joint_order == tuple(range(21)) and "MediaPipe's order" in words(same)


@pytest.mark.parametrize("names", [OPENXR_JOINTS, WEBXR_JOINTS, UNITY_JOINTS])
def test_rows_of_openxrs_and_webxrs_joints(names: tuple[str, ...]) -> None:
    noisy = joint_sample(noise=0.006).named(names)
    assert read_as("keypoints", array_npy(noisy), rate=100.0).joint_order == tuple(map(names.index, KEYPOINTS))
    assert_our_own(read_as("keypoints", json.dumps(SAMPLE.named(names).tolist()), rate=100.0, world_up="y"), SAMPLE)
    recording = read_as("keypoints", array_npy(SAMPLE.named(names)), rate=100.0)
    assert_our_own(recording, SAMPLE)
    assert ("Unity's order (the wrist before the palm)" in words(recording)) is (names is UNITY_JOINTS)
    assert [names[k] for k in recording.joint_order] == list(KEYPOINTS)
    with pytest.raises(InputError, match=f"--joint-order mano: {len(names)} joints a sample; expected 21"):
        read_as("keypoints", array_npy(SAMPLE.named(names)), rate=100.0, joint_order="mano")


@given(st.integers(0, 2**32 - 1), st.sampled_from(["mediapipe", "mano"]))
def test_no_posture_of_our_hand_is_taken_for_the_other_order(seed: int, order: str) -> None:
    random = np.random.default_rng(seed)
    hand = SAMPLE.hand
    flexion = random.uniform(hand.flexion_min, hand.flexion_max)
    abduction = random.uniform(hand.abduction_min, hand.abduction_max)
    fingers = hand.joints(np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), flexion, abduction)
    wrist = np.array([-0.070 * hand.hand_breadth, -0.223 * hand.hand_length, 0.0])
    points = np.concatenate([wrist[None], fingers.reshape(20, 3)])[None]
    rows = points[:, [KEYPOINTS.index(joint) for joint in JOINT_ORDERS[order]]]
    assert keypoints.order_by_bones(rows, keypoints.ORDERS[21]) == order


SEGMENTS_OF = {finger: [joint for joint in KEYPOINTS if joint.startswith(finger)] for finger in FINGERS}
NODES = [joint for joint in WEBXR_JOINTS if joint.startswith("thumb")]
FOREIGN: dict[str, list[str]] = {
    "InterHand": [*(joint for finger in FINGERS for joint in SEGMENTS_OF[finger][::-1]), "wrist"],
    "FrankMocap": [*MANO_JOINTS[:16], *(f"{finger}_tip" for finger in ("index", "middle", "little", "ring", "thumb"))],
    "FPHAB": [
        "wrist",
        *(SEGMENTS_OF[f][0] for f in FINGERS),
        *(joint for f in FINGERS for joint in SEGMENTS_OF[f][1:]),
    ],
    "tips first": ["wrist", *(joint for finger in FINGERS for joint in SEGMENTS_OF[finger][::-1])],
    "fingers reversed": ["wrist", *(joint for finger in FINGERS[::-1] for joint in SEGMENTS_OF[finger])],
    "level by level": ["wrist", *(SEGMENTS_OF[finger][k] for k in range(4) for finger in FINGERS)],
    "MANUS": [*WEBXR_JOINTS[:1], *WEBXR_JOINTS[5:], *NODES],
    "palm last": [*WEBXR_JOINTS, "palm"],
}


@pytest.mark.parametrize("maker", FOREIGN)
@pytest.mark.parametrize("noise", [0.0, 0.004])
def test_rows_in_an_order_that_is_not_known_are_refused_with_how_far_each_is_off(maker: str, noise: float) -> None:
    rows = joint_sample(noise=noise).named(tuple(FOREIGN[maker]))
    for data in (array_npy(rows), array_npy(1e3 * rows), json.dumps(rows.tolist()).encode()):
        with pytest.raises(TrajectoryError, match=r"in no order that is known, by their bones: in .* mm") as error:
            read_as("keypoints", data, rate=100.0, hand="right")
        assert "--mirror" not in str(error.value) and "\n" not in str(error.value)
    if len(FOREIGN[maker]) == 21:
        assert "in MediaPipe's" in str(error.value) and "in MANO's" in str(error.value)


def test_a_stated_order_is_taken_and_must_have_as_many_joints() -> None:
    line = np.zeros((40, 21, 3))
    line[:, 1:, 0] = 0.1
    line[:, :, 1] = np.sin(TIME)[:, None]
    with pytest.raises(TrajectoryError, match=r"the bone to thumb_proximal is 0 mm, 0\.001 times a hand's"):
        read_as("keypoints", arrays_npz(points=line, t=TIME))
    with pytest.raises(InputError, match="--joint-order openxr: 21 joints a sample; expected 25 or 26"):
        read_as("keypoints", array_npy(POINTS), rate=100.0, joint_order="openxr")
    foreign = array_npy(SAMPLE.named(tuple(FOREIGN["FPHAB"])))
    for side in ("right", "left", ""):
        try:
            text = words(read_as("keypoints", foreign, rate=100.0, joint_order="mano", hand=side))
        except TrajectoryError as error:
            text = str(error)
        assert "times a hand's" in text and "--mirror" not in text
    told = read_as("keypoints", array_npy(IN_MANO), rate=100.0, world_up="y", joint_order="smplx")
    assert_our_own(told, SAMPLE)
    assert "as --joint-order says" in words(told)


def test_missing_joints_and_noise_leave_the_order() -> None:
    noisy = joint_sample(noise=0.004).named()[:, [KEYPOINTS.index(joint) for joint in MANO_JOINTS]].copy()
    noisy[::3, 5] = np.nan
    assert keypoints.order_by_bones(noisy, keypoints.ORDERS[21]) == "mano"


@pytest.mark.parametrize(
    "document",
    [
        {"fps": 100, "hand": "right", "object_pose": [[1, 2]] * 41, "joints": [None, *POINTS.tolist()]},
        {"hand": "right", "data": [{"t": t, "joints": p} for t, p in zip(TIME.tolist(), POINTS.tolist())]},
        {"hand": "right", "fps": 100, "kp3d": POINTS.reshape(-1, 63).tolist()},
        {"meta": [[0, 1, 2]] * 50, "fps": 100, "hand": "right", "p": [{"q": {"r": p}} for p in POINTS.tolist()]},
    ],
)
def test_points_of_json_are_found_under_any_key(document: dict[str, Any]) -> None:
    recording = read_content(Content(data=json.dumps(document).encode()), ReadOptions())
    assert (recording.form, recording.hand, recording.sample_count) == ("keypoints", "right", len(POINTS))
    assert np.abs(recording.flexion - SAMPLE.motion.flexion).max() < 1e-6


def test_columns_that_name_their_joints_are_read_by_name_in_any_order() -> None:
    names = [f"{joint}_{axis}" for joint in KEYPOINTS for axis in "xyz"]
    lines = [line.split(",") for line in table(["time_s", *names]).splitlines()]
    order = [0, 1, 2, 3, *(k for finger in range(4, -1, -1) for k in range(4 + 12 * finger, 16 + 12 * finger))]
    for columns in (range(64), order):
        text = "\n".join(",".join(line[k] for k in columns) for line in lines) + "\n"
        recording = read_content(Content(data=text.encode(), name="take"), ReadOptions(world_up="y"))
        assert (recording.form, recording.hand) == ("openxr", "right")
        assert_our_own(recording, SAMPLE)


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (array_npy(POINTS), "no stamps of the samples; say how many there are a second: --rate"),
        (array_npy(POINTS[:, :20]), r"the array has shape \(40, 20, 3\); expected \(T, 21, 3\)"),
        (array_npy(POINTS[:, :16]), r"shape \(40, 16, 3\); .*: 16 joints lack the fingertips"),
        (array_npy(POINTS)[:3000], "not an .npy array, or a damaged one"),
        (arrays_npz(a=POINTS[:, :5]), r"no array of shape \(T, 21, 3\).* it holds a \(40, 5, 3\)"),
        (arrays_npz(a=POINTS, b=POINTS), "2 arrays of joints, a, b; say which one: --array NAME"),
        (arrays_npz(a=POINTS, t=TIME[:5]), r"array 't' has shape \(5,\); expected \(40,\)"),
        (zipped("quest.csv"), r"a zip archive of quest\.csv, without an array"),
        (b'{"landmarks": 3}', "no frames in JSON that is an object with landmarks"),
        (b'{"landmarks": [[1, 2]]}', "1 frames, but no hand in any"),
        (b"a,b\n1,2\n", "2 columns; expected 63 coordinates of 21 points"),
    ],
)
def test_what_is_no_recording_is_refused(data: bytes, said: str) -> None:
    with pytest.raises(TrajectoryError, match=said):
        read_as("keypoints", data)


@pytest.mark.parametrize("shape", [(0, 21, 3), (0, 63), (0, 25, 3), (0, 78)])
def test_an_array_without_samples_is_refused(shape: tuple[int, ...]) -> None:
    for data in (array_npy(np.zeros(shape)), arrays_npz(joints=np.zeros(shape), t=np.zeros(0))):
        with pytest.raises(TrajectoryError, match=re.escape(f"has shape {shape}: no samples")):
            read_as("keypoints", data, rate=30.0)


def hdf5(path: Path, **arrays: Any) -> Path:
    """Write arrays in groups, whose names have double underscores."""
    with h5py.File(path, "w") as file:
        file.attrs["fps"] = 100
        for name, values in arrays.items():
            file[name.replace("__", "/")] = values
        file["joint_names"] = [*MANO_JOINTS]
    return path


def test_an_hdf5_of_others_is_read_and_written_as_an_npz_would_be(tmp_path: Path) -> None:
    given = SAMPLE.named(MANO_JOINTS)
    path = hdf5(tmp_path / "take.hdf5", hands__right=given, frame_id=np.arange(len(given)))
    recording = read_recording(path, ReadOptions(hand="right", world_up="y"))
    assert (recording.form, recording.hand, recording.checksums) == ("keypoints", "right", "missing")
    assert_our_own(recording.changed(time=TIME), SAMPLE)
    assert "100 samples a second, as 'fps' says" in words(recording) and "not used: frame_id (40,)" in words(recording)
    correction = a_correction(recording)
    off = write_recording(path, ReadOptions(hand="right", world_up="y"), recording, correction, tmp_path / "out.hdf5")
    assert off is not None and off < 1e-6
    with h5py.File(path) as old, h5py.File(tmp_path / "out.hdf5") as new:
        moved = np.any(old["hands/right"][()] != new["hands/right"][()], axis=(1, 2))
        assert np.array_equal(moved, correction.changed) and new.attrs["fps"] == 100
        assert np.array_equal(old["frame_id"], new["frame_id"])


def test_an_hdf5_of_others_lists_its_arrays_and_takes_one(tmp_path: Path) -> None:
    path = hdf5(tmp_path / "two.h5", left=POINTS, hands__right=POINTS)
    with pytest.raises(TrajectoryError, match=r"2 arrays of joints, hands/right, left; say which one: --array NAME"):
        read_recording(path)
    assert read_recording(path, ReadOptions(array="left", joint_order="mediapipe", hand="right")).sample_count == 40
    with pytest.raises(
        TrajectoryError, match=r"no array of shape .*; it holds a/b \(3, 2\), joint_names \(21,\), fps \(\)$"
    ):
        read_recording(hdf5(tmp_path / "none.h5", a__b=np.zeros((3, 2))))
    (tmp_path / "cut.h5").write_bytes(path.read_bytes()[:3000])
    with pytest.raises(TrajectoryError, match="a damaged HDF5 file"):
        read_recording(tmp_path / "cut.h5")


def test_one_of_several_arrays_is_read_and_written(tmp_path: Path) -> None:
    path, out = tmp_path / "two.npz", tmp_path / "free.npz"
    path.write_bytes(arrays_npz(left_hand=POINTS + 1.0, right_hand=POINTS, t=TIME))
    options = ReadOptions(array="right_hand", world_up="y", hand="right")
    recording = read_recording(path, options)
    assert_our_own(recording, SAMPLE)
    write_recording(path, options, recording, a_correction(recording), out)
    with np.load(path) as before, np.load(out) as after:
        assert before["left_hand"].tobytes() == after["left_hand"].tobytes()
        assert np.abs(after["right_hand"] - before["right_hand"]).max() > 1e-4
    with pytest.raises(InputError, match="unknown array 'righthand': did you mean right_hand"):
        read_recording(path, ReadOptions(array="righthand"))


def test_a_header_that_numpy_cannot_even_split_is_refused() -> None:
    data = array_npy(POINTS)
    with pytest.raises(TrajectoryError, match=r"not an .npy array"):
        read_as("keypoints", data[:40] + b"(((\x00\x97\xfa'''(" + data[50:])


class Planted:
    """Object whose pickle runs a command where a plain unpickler loads it."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> Any:
        return Path.touch, (self.path,)


@pytest.mark.parametrize("protocol", [2, 4, 5])
def test_a_pickled_dictionary_comes_back_corrected_and_runs_nothing(protocol: int, tmp_path: Path) -> None:
    sample, path, planted = joint_sample(), tmp_path / "take.pkl", tmp_path / "planted"
    held: dict[str, Any] = {
        "joints": sample.named(),
        "t": sample.motion.time,
        "seen": np.arange(3),
        "by": {"who": "me"},
    }
    path.write_bytes(pickle.dumps(held, protocol))
    options = ReadOptions(world_up="y", hand="right")
    recording = read_recording(path, options)
    assert recording.joints is not None
    correction = a_correction(recording)
    off = write_recording(path, options, recording, correction, tmp_path / "new.pkl")
    assert off is not None and off < 1e-9
    new = pickle.loads((tmp_path / "new.pkl").read_bytes())
    assert list(new) == list(held) and new["by"] == held["by"] and np.array_equal(new["seen"], held["seen"])
    assert not np.array_equal(new["joints"], held["joints"])
    path.write_bytes(pickle.dumps(held | {"more": Planted(planted)}, protocol))
    with pytest.raises(TrajectoryError, match=r"take\.pkl: holds .*, which is not data, so it is not loaded"):
        read_recording(path, options)
    assert not planted.exists()


def test_each_hand_of_two_arrays_is_read_by_its_side() -> None:
    data = arrays_npz(right_joints=POINTS, left_joints=POINTS * [-1.0, 1.0, 1.0])
    for side in ("right", "left"):
        assert read_as("keypoints", data, hand=side, rate=30.0).hand == side
    with pytest.raises(TrajectoryError, match=r"--array NAME or --hand right\|left"):
        read_as("keypoints", data, rate=30.0)
