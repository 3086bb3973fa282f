"""Another tool's repair beside the recording: the same table, whatever the file, in the frame of the object."""

from pathlib import Path

import numpy as np
import pytest
from field_hands import box
from joint_samples import array_npy, arrays_npz, joint_sample

from hhsim.arrays import FloatArray
from hhsim.errors import TrajectoryError
from hhsim.hand.quaternion import quaternion, rotation_matrix
from hhsim.metrics.field.field_table import MISSED
from hhsim.motion.trajectory import ObjectMotion
from hhsim.recordings.frames import world_matrix
from hhsim.recordings.registry import ReadOptions
from hhsim.repair.score import FieldScore, field_score

SAMPLE = joint_sample(count=12)
POINTS, TIME = SAMPLE.named(), SAMPLE.motion.time
OPTIONS = ReadOptions(world_up="y", hand="right")
WORLD = POINTS @ world_matrix("y").T
"""Joints in our world, where the box lies at the tip of the middle finger in the first sample."""
PLACE = WORLD[0, 12] - [0.0, 0.0, 0.045]


def written(path: Path, points: FloatArray, time: FloatArray = TIME, motion: ObjectMotion | None = None) -> Path:
    """Write joints, and the object's poses, which are in our world, in the axes of the file."""
    poses = {}
    if motion is not None:
        turn = world_matrix("y").T @ rotation_matrix(motion.orientation)
        poses = {"object_pos": motion.position @ world_matrix("y"), "object_rot": turn}
    path.write_bytes(arrays_npz(keypoints=points, t=time, **poses))
    return path


def score(tmp_path: Path, after: FloatArray, motion: ObjectMotion, before: FloatArray = POINTS) -> FieldScore:
    files = written(tmp_path / "before.npz", before, motion=motion), written(tmp_path / "after.npz", after)
    return field_score(*files, box(), OPTIONS, max_correction=0.02)


def still() -> ObjectMotion:
    return ObjectMotion(np.tile(PLACE, (len(TIME), 1)), np.tile([1.0, 0.0, 0.0, 0.0], (len(TIME), 1)))


def test_a_shifted_hand_is_scored_by_the_shift(tmp_path: Path) -> None:
    shift = np.array([0.0, 0.003, 0.0])
    found = score(tmp_path, POINTS + shift, still())
    rows = {row.name: row for row in found.rows}
    assert rows["mpjpe"].after == pytest.approx(0.003, abs=1e-9)
    assert rows["correction_max"].after == pytest.approx(0.003, abs=1e-9)
    assert rows["acceleration_ratio"].after == pytest.approx(1.0, abs=1e-9)
    assert rows["depth_joints_max"].before > 0.004
    # The tips are on the skin: the cone around the last bone is deeper inside by no more than its radius.
    radius = SAMPLE.hand.radius.max()
    assert 0.0 <= rows["depth_cones_max"].before - rows["depth_joints_max"].before <= radius
    assert found.verdict.word == MISSED
    assert "depth_joints_max" in found.verdict.missed


def test_figures_do_not_depend_on_the_motion_of_hand_and_object_together(tmp_path: Path) -> None:
    time = TIME - TIME[0]
    turn = quaternion(np.stack([0.3 * time, 0.5 * np.sin(time), 0.2 + 0.0 * time], axis=1))
    matrix, shift = rotation_matrix(turn), np.stack([0.1 * time, 0.02 * time, 0.05 * np.cos(time)], axis=1)
    moved = np.einsum("tij,tkj->tki", matrix, WORLD) + shift[:, None]
    motion = ObjectMotion(matrix @ PLACE + shift, turn)
    back = world_matrix("y")
    changed = POINTS + np.array([0.0, 0.003, 0.0])
    after = np.einsum("tij,tkj->tki", matrix, changed @ back.T) + shift[:, None]
    expected = {row.name: row for row in score(tmp_path, changed, still()).rows}
    found = {row.name: row for row in score(tmp_path, after @ back, motion, moved @ back).rows}
    for name, row in expected.items():
        if name not in ("acceleration", "jerk", "acceleration_ratio"):
            assert (found[name].before, found[name].after) == pytest.approx(
                (row.before, row.after), rel=1e-6, abs=1e-9, nan_ok=True
            )


def test_other_samples_stamps_and_poses_are_refused_in_one_line(tmp_path: Path) -> None:
    before = written(tmp_path / "before.npz", POINTS)

    def judged(after: Path) -> None:
        field_score(before, after, box(), OPTIONS, max_correction=0.02)

    with pytest.raises(TrajectoryError, match=r"short.npz: 11 samples; expected 12, as .*before.npz has$"):
        judged(written(tmp_path / "short.npz", POINTS[:-1], TIME[:-1]))
    late = TIME.copy()
    late[7:] += 0.001
    with pytest.raises(TrajectoryError, match=r"late.npz: sample 7 is at .* s; expected .* s, as .*before.npz has$"):
        judged(written(tmp_path / "late.npz", POINTS, late))
    bare = tmp_path / "bare.npy"
    bare.write_bytes(array_npy(POINTS))
    with pytest.raises(TrajectoryError, match="angles only, or no world frame"):
        field_score(bare, bare, box(), ReadOptions(rate=100.0, hand="right"), max_correction=0.02)
