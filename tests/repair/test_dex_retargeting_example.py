"""The example that feeds dex-retargeting: the arrays that it gives, and, where that is installed, a robot's angles."""

import importlib
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from repair_scenes import HAND, scene_case

import hhsim
from hhsim.hand.quaternion import rotation_matrix
from hhsim.repair.recorded_scene import model_joints

EXAMPLE = "feed_dex_retargeting.py"
JOINTS = model_joints(HAND, scene_case("sphere", "grasp", 100, 3, 13).frames)
# A tip on three sliders: its vector from the base is that of the person's index finger.
ROBOT = "".join(
    f'<link name="{child}"/><joint name="{axis}" type="prismatic"><parent link="{parent}"/><child link="{child}"/>'
    f'<axis xyz="{xyz}"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
    for axis, parent, child, xyz in (
        *(("x", "base", "first", "1 0 0"), ("y", "first", "second", "0 1 0")),
        ("z", "second", "tip", "0 0 1"),
    )
)
CONFIG = """\
retargeting:
  type: vector
  urdf_path: robot.urdf
  target_origin_link_names: [base]
  target_task_link_names: [tip]
  target_link_human_indices: [[0], [8]]
  normal_delta: 0.0
  low_pass_alpha: 1.0
"""


@pytest.fixture
def example(repository: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.syspath_prepend(str(repository / "examples"))
    return importlib.import_module(Path(EXAMPLE).stem)


@pytest.mark.parametrize(("hand", "mirror"), [("right", 1.0), ("left", -1.0)])
def test_a_hand_is_given_in_its_own_axes_wherever_it_is(example: Any, hand: str, mirror: float) -> None:
    joints = JOINTS * [mirror, 1.0, 1.0]
    seen = example.in_wrist_frame(joints, hand)
    np.testing.assert_allclose(seen[:, 0], 0.0)
    np.testing.assert_allclose(seen[:, 9, :2], 0.0, atol=1e-12)
    np.testing.assert_allclose(seen[:, 5, 0], 0.0, atol=1e-12)
    # The thumb's side, and where the fingers bend to.
    assert (mirror * seen[:, 5, 1] > 0.01).all() and (seen[:, 9, 2] > 0.05).all() and (seen[-1, 8::4, 0] > 0.01).all()
    across = [np.linalg.norm(of[:, :, None] - of[:, None], axis=3) for of in (joints, seen)]
    np.testing.assert_allclose(*across, atol=1e-12)
    turn = rotation_matrix(np.array([[0.5, -0.1, 0.7, 0.5]]))[0]
    np.testing.assert_allclose(example.in_wrist_frame(joints @ turn.T + [0.3, 0.2, 0.1], hand), seen, atol=1e-12)
    vectors = example.references(joints, hand, "VECTOR", np.array([[0, 5], [8, 9]]))
    np.testing.assert_array_equal(vectors, seen[:, [8, 9]] - seen[:, [0, 5]])
    np.testing.assert_array_equal(example.references(joints, hand, "POSITION", np.array([0, 8])), joints[:, [0, 8]])


def test_a_robots_finger_is_where_the_repaired_one_is(repository: Path, example: Any, tmp_path: Path) -> None:
    pytest.importorskip("dex_retargeting", reason="dex_retargeting is not installed: its answer was not looked at")
    np.savez(tmp_path / "grasp.npz", keypoints=JOINTS, fps=30.0, hand="right")
    (tmp_path / "robot.urdf").write_text(f'<robot name="tip"><link name="base"/>{ROBOT}</robot>')
    (tmp_path / "robot.yml").write_text(CONFIG)
    words = ("grasp.npz", "sphere", "robot.yml", str(tmp_path), "angles.npz")
    command = [sys.executable, str(repository / "examples" / EXAMPLE), *words]
    answer = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert answer.returncode == 0, answer.stderr
    assert answer.stdout.endswith(" 0.000 mm repaired, 3 robot joints\n")
    found, motion = np.load(tmp_path / "angles.npz"), hhsim.repair(tmp_path / "grasp.npz", "sphere")
    assert motion.changed.any() and sorted(found["joint_names"]) == list("xyz")
    order = [found["joint_names"].tolist().index(axis) for axis in "xyz"]
    tips = example.in_wrist_frame(motion.joints, "right")[:, 8]
    np.testing.assert_allclose(found["qpos"][:, order], tips, atol=1e-5)
