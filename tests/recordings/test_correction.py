"""What a correction means for a file: its coordinates, its rows, and the parameters of its own hand."""

import numpy as np
import pytest
from correction_samples import a_correction
from joint_samples import joint_sample
from scipy.spatial.transform import Rotation

from hhsim.hand.quaternion import rotation_matrix
from hhsim.recordings.correction import BONE_OF, BONES, changes
from hhsim.recordings.formats.bvh import euler_angles
from hhsim.recordings.frames import FileFrame
from hhsim.recordings.joint_names import KEYPOINTS, OPENXR_JOINTS


def test_every_joint_of_openxr_has_its_bone() -> None:
    assert set(BONE_OF) == set(OPENXR_JOINTS) and set(BONE_OF.values()) == set(range(BONES))
    assert [BONE_OF[f"index_{part}"] for part in ("metacarpal", "proximal", "distal", "tip")] == [0, 4, 6, 6]
    assert [BONE_OF[f"thumb_{part}"] for part in ("metacarpal", "proximal", "distal", "tip")] == [1, 2, 3, 3]


def test_changes_are_those_of_the_world_in_the_coordinates_of_the_file() -> None:
    motion = joint_sample().motion
    joints = joint_sample().joints[:, [OPENXR_JOINTS.index(name) for name in KEYPOINTS]]
    # Left-handed, y up, in millimetres; every second row of the file, backwards.
    frame = FileFrame(np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]]), 1e-3)
    recording = motion.changed(joints=joints, file_frame=frame, rows=100 - 2 * np.arange(40))
    correction = a_correction(recording)
    made = changes(recording, correction)
    assert made.rows.tolist() == [94, 92, 90, 88, 86, 84] and made.digits == 3
    points = frame.to_file(joints)[made.samples]
    for k, name in enumerate(KEYPOINTS):
        assert np.allclose(frame.to_world(made.moved(name, points[:, k])), correction.joints[made.samples, k])
    # The palm's origin is a point of the palm.
    palm = made.moved("palm", frame.to_file(motion.position[made.samples]))
    assert np.allclose(frame.to_world(palm), correction.posture.position[made.samples])
    # A vector that turns with a bone in the file is the one that turns with it in the world.
    vector = np.array([0.3, -0.2, 0.5])
    for name in ("wrist", "index_tip"):
        turned = rotation_matrix(made.turned(name, np.tile([1.0, 0.0, 0.0, 0.0], (6, 1)))) @ vector
        world = correction.rotation[made.samples, BONE_OF[name]] @ frame.to_world(vector)
        assert np.allclose(frame.to_world(turned), world)


@pytest.mark.parametrize("order", ["XYZ", "zyx", "ZXZ", "yxy"])
def test_euler_angles_are_the_same_rotation_near_the_given_ones(order: str) -> None:
    random = np.random.default_rng(1)
    near = random.uniform(-9.0, 9.0, (50, 3))
    turns = Rotation.from_euler(order, near + random.normal(0.0, 0.01, (50, 3))).as_matrix()
    found = euler_angles(turns, order, near)
    assert np.allclose(Rotation.from_euler(order, found).as_matrix(), turns)
    away = np.abs(np.sin(near[:, 1]) if len(set(order)) == 2 else np.cos(near[:, 1])) > 0.2
    assert away.sum() > 20 and np.abs(found - near)[away].max() < 0.3
