"""Poses of an object: in a file of their own in every layout, and among the arrays, columns and keys of recordings."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from joint_samples import Y_UP, array_npy, arrays_npz, words
from recorded_files import COUNT, MATRIX, OBJECT_CSV, PLACE, POINTS, SAMPLE, TIME, TURN, WXYZ, XYZW, columns_csv
from recording_samples import read_as
from scipy.spatial.transform import Slerp

from hhsim.arrays import FloatArray
from hhsim.errors import TrajectoryError
from hhsim.hand.quaternion import rotation_matrix
from hhsim.motion.trajectory import ObjectMotion
from hhsim.recordings.object_poses import with_object_poses
from hhsim.recordings.recording import Recording, unused_poses
from hhsim.recordings.registry import ReadOptions


def csv(header: str, *columns: FloatArray) -> bytes:
    """A table of these columns, without a header if it is empty."""
    return columns_csv(header, *columns).lstrip("\n").encode()


M = [f"m{row}{column}" for row in range(4) for column in range(4)]
FILES: dict[str, tuple[str, bytes]] = {
    "npy 4x4": (".npy", array_npy(MATRIX)),
    "npy 3x4": (".npy", array_npy(MATRIX[:, :3])),
    "npy 16": (".npy", array_npy(MATRIX.reshape(COUNT, 16))),
    "npy 12": (".npy", array_npy(MATRIX[:, :3].reshape(COUNT, 12))),
    "npy stamps and 12": (".npy", array_npy(np.concatenate([TIME[:, None], MATRIX[:, :3].reshape(COUNT, 12)], axis=1))),
    "npy of ARCTIC": (".npy", array_npy(np.concatenate([WXYZ[:, :1], TURN.as_rotvec(), 1e3 * PLACE], axis=1))),
    "npz pose": (".npz", arrays_npz(object_pose=MATRIX, object_name="mug")),
    "npz any name": (".npz", arrays_npz(a=MATRIX, gain=2.0)),
    "npz wxyz": (".npz", arrays_npz(position=PLACE, quat_wxyz=WXYZ)),
    "npz xyzw in mm": (".npz", arrays_npz(obj_trans=1e3 * PLACE, obj_rot_xyzw=XYZW, unit="mm", t=TIME)),
    "npz pose7": (".npz", arrays_npz(pose_xyzw=np.concatenate([PLACE, XYZW], axis=1))),
    "npz axis-angle": (".npz", arrays_npz(object_pos_cm=100.0 * PLACE, object_axis_angle=TURN.as_rotvec())),
    "npz matrices": (".npz", arrays_npz(objectPosition=PLACE, objectRotation=TURN.as_matrix())),
    "npz R and t": (".npz", arrays_npz(R=TURN.as_matrix(), t=PLACE, timestamps=TIME)),
    "npz of GRAB": (".npz", arrays_npz(object_transl=PLACE, object_global_orient=-TURN.as_rotvec())),
    "csv wxyz": (".csv", csv("px,py,pz,qw,qx,qy,qz", PLACE, WXYZ)),
    "csv xyzw": (
        ".csv",
        csv("time_s,object_x,object_y,object_z,object_qx,object_qy,object_qz,object_qw", TIME, PLACE, XYZW),
    ),
    "csv in mm": (".csv", csv("tx_mm,ty_mm,tz_mm,quat_x,quat_y,quat_z,quat_w,gain", 1e3 * PLACE, XYZW, TIME)),
    "csv of HOT3D": (".csv", csv(OBJECT_CSV, 7.0 + 0.0 * TIME, 1e9 * TIME, PLACE, WXYZ)),
    "csv remark": (
        ".csv",
        b"# unit: mm\n" + csv("pos_x,pos_y,pos_z,rotvec_x,rotvec_y,rotvec_z", 1e3 * PLACE, TURN.as_rotvec()),
    ),
    "csv m00": (".csv", csv(",".join(M), MATRIX)),
    "csv pose_0": (".csv", csv(",".join(f"pose_{k}" for k in range(12)), MATRIX[:, :3])),
    "csv bare": (".csv", csv("", MATRIX)),
    "csv bare stamps": (".csv", csv("", TIME, MATRIX)),
}


def read(tmp_path: Path, data: bytes, suffix: str, time: FloatArray = TIME, **options: Any) -> tuple[ObjectMotion, str]:
    path = tmp_path / f"poses{suffix}"
    path.write_bytes(data)
    recording = with_object_poses(hand_at(time), path, ReadOptions(**options))
    return recording.object_motion, words(recording)


def hand_at(time: FloatArray) -> Recording:
    """A hand that stands still beside the origin at stamps, shape (T,)."""
    rows = np.tile([0.1, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], (len(time), 1))
    return Recording(time, rows[:, :3], rows[:, 3:], np.zeros((len(time), 5, 3)), np.zeros((len(time), 5)))


def assert_pose(motion: ObjectMotion | None, place: FloatArray = PLACE, turn: FloatArray = MATRIX[:, :3, :3]) -> None:
    np.testing.assert_allclose(motion.position, place, atol=1e-9)
    np.testing.assert_allclose(rotation_matrix(motion.orientation), turn, atol=1e-9)


@pytest.mark.parametrize("form", FILES)
def test_every_layout_gives_the_known_motion(form: str, tmp_path: Path) -> None:
    suffix, data = FILES[form]
    motion, said = read(tmp_path, data, suffix)
    assert_pose(motion)
    stated = any(word in form for word in ("mm", "HOT3D", "axis-angle", "ARCTIC", "remark"))
    assert ("no unit of the object's poses" in said) is not stated
    left = {"npz pose": "object_name", "npz any name": "gain", "csv in mm": "gain"}.get(form)
    assert (f"not used: {left}" in said) if left else "not used" not in said


@pytest.mark.parametrize("order", ["wxyz", "xyzw"])
def test_an_open_order_of_quaternions_is_asked_for(order: str, tmp_path: Path) -> None:
    rows = np.concatenate([PLACE, {"wxyz": WXYZ, "xyzw": XYZW}[order]], axis=1)
    stamped = np.concatenate([TIME[:, None], rows], axis=1)
    for data, suffix in ((array_npy(rows), ".npy"), (csv("", stamped), ".txt")):
        with pytest.raises(TrajectoryError, match=r"poses\..*: '.*' does not say .* expected --pose-order wxyz\|xyzw"):
            read(tmp_path, data, suffix)
        assert_pose(read(tmp_path, data, suffix, pose_order=order)[0])


def test_stamps_of_its_own_are_interpolated(tmp_path: Path) -> None:
    stamps, ticks = np.linspace(0.0, 1.0, COUNT), np.linspace(0.013, 0.98, 77)
    straight = np.outer(stamps, [0.1, -0.2, 0.3])
    data = arrays_npz(t=stamps, pos=straight, quat_wxyz=WXYZ)
    motion, _ = read(tmp_path, data, ".npz", ticks)
    assert_pose(motion, np.outer(ticks, [0.1, -0.2, 0.3]), Slerp(stamps, TURN)(ticks).as_matrix())
    for late in (-0.1, 0.1):
        with pytest.raises(TrajectoryError, match=r"stamps from 0 to 1 s; expected poses for the recording's"):
            read(tmp_path, data, ".npz", ticks + late)
    holes = straight.copy()
    holes[[3, 8]] = np.nan
    motion, _ = read(tmp_path, arrays_npz(t=stamps, pos=holes, quat_wxyz=WXYZ), ".npz", ticks)
    missing = np.zeros(len(ticks), dtype=bool)
    for hole in (3, 8):
        missing |= (ticks > stamps[hole - 1]) & (ticks < stamps[hole + 1])
    assert missing.any() and (np.isnan(motion.position).all(axis=1) == missing).all()
    np.testing.assert_allclose(motion.position[~missing], np.outer(ticks, [0.1, -0.2, 0.3])[~missing], atol=1e-12)
    ticks = np.append(ticks, np.nan)
    assert np.isnan(read(tmp_path, data, ".npz", ticks)[0].orientation[-1]).all()


def test_one_row_is_an_object_at_rest_and_missing_rows_are_missing(tmp_path: Path) -> None:
    for data in (array_npy(MATRIX[:1]), array_npy(MATRIX[0])):
        motion, _ = read(tmp_path, data, ".npy")
        assert_pose(motion, np.tile(PLACE[0], (COUNT, 1)), np.tile(MATRIX[0, :3, :3], (COUNT, 1, 1)))
    holed = MATRIX.copy()
    holed[3] = np.nan
    motion, _ = read(tmp_path, array_npy(holed), ".npy")
    seen = np.arange(COUNT) != 3
    assert np.isnan(motion.position[3]).all() and np.isnan(motion.orientation[3]).all()
    assert_pose(motion.at(np.flatnonzero(seen)), PLACE[seen], MATRIX[seen, :3, :3])


SKEWED = MATRIX.copy()
SKEWED[7, 0, :3] *= 1.5
LONG = np.where(np.arange(COUNT)[:, None] == 4, 2.0, 1.0) * WXYZ
FAR = MATRIX.copy()
FAR[:, :3, 3] = 30.0


@pytest.mark.parametrize(
    ("data", "suffix", "said"),
    [
        (array_npy(MATRIX[:-1]), ".npy", rf"{COUNT - 1} poses of the object .* for {COUNT} samples of the hand"),
        (array_npy(MATRIX.transpose(0, 2, 1)), ".npy", "is the matrix transposed"),
        (array_npy(SKEWED), ".npy", "is no rotation in row 7"),
        (array_npy(MATRIX * [[-1.0], [1.0], [1.0], [1.0]]), ".npy", "is no rotation in row 0; expected .* det R = 1"),
        (arrays_npz(pos=PLACE, quat_wxyz=LONG), ".npz", "'quat_wxyz' is not of unit length in row 4"),
        (arrays_npz(pos=PLACE), ".npz", "'pos' is only one of an object's position and orientation"),
        (arrays_npz(pos=PLACE, quat_wxyz=WXYZ[:-2]), ".npz", f"'pos' has {COUNT} rows and 'quat_wxyz' {COUNT - 2}"),
        (arrays_npz(a=MATRIX, b=MATRIX), ".npz", r"several arrays that may be poses, it holds a \(12, 4, 4\)"),
        (array_npy(PLACE), ".npy", r"no poses, it holds rows \(12, 3\); expected \(T, 4, 4\)"),
        (array_npy(FAR), ".npy", "the object is 51.96 from the origin, which may be cm or mm; say --pose-unit"),
        (arrays_npz(pose=MATRIX, t=TIME[::-1]), ".npz", "the stamps of the poses do not increase"),
        (csv("a,b,c", PLACE), ".csv", "columns a, b, c; expected px, py, pz"),
        (csv("px,py,pz,rot_x,rot_y,rot_z", PLACE, PLACE), ".csv", "only one of an object's position and orientation"),
        (b'{"poses": 3}', ".json", r"JSON; expected poses as \.csv, \.npy or \.npz"),
        (b"\x00\x01", ".bin", "no text"),
    ],
)
def test_what_is_no_pose_is_refused_in_one_line(data: bytes, suffix: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(TrajectoryError, match=said) as error:
        read(tmp_path, data, suffix)
    assert str(error.value).startswith(str(tmp_path)) and "\n" not in str(error.value)


def test_far_positions_are_millimetres_and_an_option_states_the_unit(tmp_path: Path) -> None:
    far = MATRIX.copy()
    far[:, :3, 3] = 1e3 * PLACE + 400.0
    motion, said = read(tmp_path, array_npy(far), ".npy")
    assert_pose(motion, PLACE + 0.4)
    assert "taken for mm: --pose-unit" in said
    assert_pose(read(tmp_path, array_npy(far), ".npy", pose_unit="cm")[0], 10.0 * PLACE + 4.0)


def test_the_unit_of_poses_beside_a_far_hand_is_that_of_their_distance_from_it(tmp_path: Path) -> None:
    far = MATRIX.copy()
    far[:, :3, 3] = PLACE + 3200.0
    (tmp_path / "far.npy").write_bytes(array_npy(far))
    hand = SAMPLE.motion.changed(position=SAMPLE.motion.position + 3200.0)
    moved = with_object_poses(hand, tmp_path / "far.npy", ReadOptions()).object_motion
    np.testing.assert_allclose(moved.position, PLACE + 3200.0)


FRAME_PLACE, FRAME_TURN = PLACE @ Y_UP, Y_UP.T @ MATRIX[:, :3, :3]
"""The object's pose in our world, if the file's has y up."""


def test_without_a_stated_world_the_axes_are_kept_so_hand_and_object_stay_together() -> None:
    recording = read_as("keypoints", arrays_npz(keypoints=POINTS, t=TIME, obj_pose=MATRIX))
    assert_pose(recording.object_motion)
    np.testing.assert_allclose(recording.joints, POINTS, atol=1e-12)
    assert "its axes are the world's" in words(recording)


def test_wrong_rows_and_units_in_a_recording_are_refused() -> None:
    for arrays, said in (
        ({"obj_pose": MATRIX[:-1]}, f"{COUNT - 1} poses of the object .obj_pose. for {COUNT} samples"),
        (
            {"object_pos": 1e3 * PLACE + 500.0, "object_quat_wxyz": WXYZ},
            "the object is .* m from the hand; expected the unit",
        ),
    ):
        with pytest.raises(TrajectoryError, match=said):
            read_as("keypoints", arrays_npz(keypoints=POINTS, t=TIME, **arrays), world_up="y")
    data = arrays_npz(keypoints=POINTS, t=TIME, object_pos=1e3 * PLACE, object_quat_wxyz=WXYZ)
    assert_pose(read_as("keypoints", data, world_up="y", pose_unit="mm").object_motion, FRAME_PLACE, FRAME_TURN)


@pytest.mark.parametrize(
    "name",
    [
        "object/object_pose",
        "object.obj_pose",
        "a/b/c/d/e/object/pose",
        "object/mug/pose",
        "scene/objects/mug/transform",
    ],
)
def test_a_pose_is_found_at_any_depth(name: str) -> None:
    recording = read_as("keypoints", arrays_npz(keypoints=POINTS, t=TIME, **{name: MATRIX}), world_up="y")
    assert_pose(recording.object_motion, FRAME_PLACE, FRAME_TURN)


@pytest.mark.parametrize(
    "names",
    [("mug/T",), ("T_world_mug",), ("mug_pose",), ("object/mug/pose", "object/bowl/pose"), ("object/root_pose",)],
)
def test_what_looks_like_a_pose_and_is_not_used_is_a_doubt(names: tuple[str, ...]) -> None:
    """Poses of two objects are such, too: nobody knows which one the hand holds."""
    others: dict[str, Any] = {"camera/pose": MATRIX, "wrist_pose": MATRIX, "object/name": "mug", "bounds": PLACE}
    arrays = others | dict.fromkeys(names, MATRIX)
    recording = read_as("keypoints", arrays_npz(keypoints=POINTS, t=TIME, **arrays), world_up="y")
    (doubt,) = unused_poses(recording)
    assert all(name in doubt for name in names) and not any(name in doubt for name in others)
    assert recording.object_motion is None


def test_arrays_that_are_no_pose_are_named_and_do_not_stop_the_import() -> None:
    two = np.stack([MATRIX, MATRIX], axis=1)
    for arrays, left in (
        ({"object_pos": PLACE}, "object_pos (12, 3)"),
        ({"object_pose": two}, "object_pose (12, 2, 4, 4)"),
    ):
        recording = read_as("keypoints", arrays_npz(keypoints=POINTS, t=TIME, **arrays), world_up="y")
        assert recording.object_motion is None and f"the pose of an object: {left}" in words(recording)


def test_rows_of_zeros_are_missing(tmp_path: Path) -> None:
    zeros = np.where(np.arange(COUNT)[:, None, None] == 3, 0.0, MATRIX)
    quaternions = np.where(np.arange(COUNT)[:, None] == 3, 0.0, WXYZ)
    for data in (arrays_npz(T=zeros), arrays_npz(pos=PLACE, quat_wxyz=quaternions)):
        motion, _ = read(tmp_path, data, ".npz")
        assert (np.isnan(motion.position).any(axis=1) == (np.arange(COUNT) == 3)).all()
        assert (np.isnan(motion.orientation).any(axis=1) == (np.arange(COUNT) == 3)).all()


def recorded(**options: Any) -> Recording:
    return read_as("keypoints", arrays_npz(keypoints=1e3 * POINTS, timestamp_ms=1e3 * TIME + 5e6), **options)


def test_a_file_of_poses_moves_the_object_of_a_recording_in_its_coordinates(tmp_path: Path) -> None:
    (tmp_path / "poses.npz").write_bytes(arrays_npz(object_pose=MATRIX, t=TIME + 5e3))
    options = ReadOptions(world_up="y")
    recording = with_object_poses(recorded(world_up="y"), tmp_path / "poses.npz", options)
    assert_pose(recording.object_motion, FRAME_PLACE, FRAME_TURN)
    assert "the object's pose in the recording is replaced" not in words(recording)
    again = with_object_poses(recording, tmp_path / "poses.npz", options)
    assert "the object's pose in the recording is replaced" in words(again)
    with pytest.raises(TrajectoryError, match=r"the hand stays at the origin, .* expected --world-up"):
        with_object_poses(recorded(), tmp_path / "poses.npz", ReadOptions())
    fewer = recording.chosen(np.arange(1, COUNT, 3))
    (tmp_path / "poses.npy").write_bytes(array_npy(MATRIX))
    moved = with_object_poses(fewer, tmp_path / "poses.npy", options).object_motion
    assert_pose(moved, FRAME_PLACE[1::3], FRAME_TURN[1::3])
    (tmp_path / "poses.npz").write_bytes(arrays_npz(object_pose=MATRIX, t=TIME))
    with pytest.raises(
        TrajectoryError, match=r"poses\.npz: stamps from 0 to .*; expected poses for the recording's 5000"
    ):
        with_object_poses(recording, tmp_path / "poses.npz", options)


def test_of_a_table_of_several_objects_one_is_chosen(tmp_path: Path) -> None:
    table = csv(OBJECT_CSV, np.full(COUNT, 7), np.round(1e9 * TIME), PLACE, WXYZ).decode().replace("\n7.0,", "\nmug,")
    other = csv("", np.full(COUNT, 8), np.round(1e9 * TIME), PLACE + 1.0, WXYZ).decode()
    path = tmp_path / "dynamic_objects.csv"
    path.write_text(table + other)
    with pytest.raises(
        TrajectoryError, match=r"poses of the objects mug, 8\.0; expected one of them as --object-track"
    ):
        with_object_poses(hand_at(TIME), path, ReadOptions())
    moved = with_object_poses(hand_at(TIME), path, ReadOptions(object_track="mug"))
    assert_pose(moved.object_motion)
    assert "object_uid" not in words(moved)
