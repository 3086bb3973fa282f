"""The object's pose over time, and the world as the object sees it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from driven_scenes import carried, swing
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from hhsim.errors import TrajectoryError
from hhsim.motion.file import load_trajectory, save_trajectory
from hhsim.motion.trajectory import ObjectMotion, Trajectory

TIME = np.arange(40) / 200.0


def still(count: int = 40) -> Trajectory:
    random = np.random.default_rng(3)
    return Trajectory(
        TIME[:count],
        random.normal(0.0, 0.1, (count, 3)),
        random.normal(size=(count, 4)),
        np.full((count, 5, 3), 0.2),
        np.zeros((count, 5)),
        object_position=np.array([0.1, -0.2, 0.3]),
        object_orientation=np.array([0.8, 0.0, 0.6, 0.0]),
        name="still",
    )


@given(st.integers(0, 2**32 - 1))
def test_what_the_object_sees_is_the_inverse_by_scipys_rotations(seed: int) -> None:
    random = np.random.default_rng(seed)
    now = Rotation.random(5, rng=random)
    first, place, was = Rotation.random(rng=random), random.normal(size=(5, 3)), random.normal(size=3)
    poses = ObjectMotion(place, now.as_quat(scalar_first=True))
    moved = poses.since(was, first.as_quat(scalar_first=True))
    points = random.normal(size=(5, 2, 3))
    turn = now * first.inv()
    for i in range(5):
        np.testing.assert_allclose(moved.points(points)[i], turn[i].apply(points[i] - was) + place[i], atol=1e-13)
        np.testing.assert_allclose(moved.vectors(points)[i], turn[i].apply(points[i]), atol=1e-13)
    np.testing.assert_allclose(moved.seen_points(moved.points(points)), points, atol=1e-13)
    np.testing.assert_allclose(moved.seen_vectors(moved.vectors(points)), points, atol=1e-13)
    np.testing.assert_allclose(moved.seen_orientations(moved.orientations(moved.turn)), moved.turn, atol=1e-13)


def test_ticks_are_the_same_bytes_however_many_at_a_time() -> None:
    moved, points = swing(TIME), np.random.default_rng(1).normal(size=(40, 7, 3))
    whole = moved.points(points)
    for i in range(40):
        part = type(moved)(moved.turn[i : i + 1], moved.shift[i : i + 1])
        assert part.points(points[i : i + 1]).tobytes() == whole[i : i + 1].tobytes()


def test_an_object_that_stands_still_is_no_motion() -> None:
    fixed = still()
    poses = ObjectMotion(np.tile(fixed.object_position, (40, 1)), np.tile(fixed.object_orientation, (40, 1)))
    same = replace(fixed, object_motion=poses, object_position=np.zeros(3))
    assert same.object_motion is None
    assert same.object_position.tobytes() == fixed.object_position.tobytes()
    assert same.resampled(1000.0).object_motion is None


def test_ticks_on_a_sample_take_its_pose_bit_for_bit_and_others_lie_between() -> None:
    motion = carried(still(), swing(TIME))
    assert motion.object_motion is not None
    assert motion.object_position.tobytes() == motion.object_motion.position[0].tobytes()
    ticks = motion.resampled(1000.0).object_motion
    assert ticks is not None
    for at_tick, at_sample in zip(ticks, motion.object_motion):
        np.testing.assert_array_equal(at_tick[::5], at_sample)
    np.testing.assert_allclose(np.linalg.norm(ticks.orientation, axis=1), 1.0, atol=1e-15)
    held = motion.resampled(1000.0, "hold").object_motion
    assert held is not None
    np.testing.assert_array_equal(held.position[3], motion.object_motion.position[0])


@pytest.mark.parametrize("suffix", [".h5", ".csv"])
def test_a_file_gives_the_objects_motion_back_bit_for_bit(tmp_path: Path, suffix: str) -> None:
    motion = carried(still(), swing(TIME))
    path = tmp_path / f"m{suffix}"
    save_trajectory(motion, path)
    back = load_trajectory(path)
    assert motion.object_motion is not None and back.object_motion is not None
    for given_, read in zip(motion.object_motion, back.object_motion):
        assert given_.tobytes() == read.tobytes()
    if suffix == ".csv":
        path.write_text(path.read_text().replace("object_qw", "object_qq"))
        with pytest.raises(TrajectoryError, match="no column object_qw of hhsim's own; it has object_qq instead"):
            load_trajectory(path)


@pytest.mark.parametrize(
    ("position", "orientation", "says"),
    [
        (np.zeros((39, 3)), np.ones((40, 4)), r"object_position has shape \(39, 3\); expected \(40, 3\)"),
        (np.full((40, 3), np.nan), np.ones((40, 4)), "object_position has 120 NaN or infinite"),
        (np.full((40, 3), 400.0), np.ones((40, 4)), "object_position is 400 .* is it in millimetres"),
        (np.zeros((40, 3)), np.zeros((40, 4)), "object_orientation has 40 zero quaternion"),
    ],
)
def test_a_bad_motion_of_the_object_is_refused_in_one_line(
    position: np.ndarray, orientation: np.ndarray, says: str
) -> None:
    with pytest.raises(TrajectoryError, match=says):
        replace(still(), object_motion=ObjectMotion(position, orientation))
