"""The example that repairs a LeRobot data set, run as a user would."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from repair_scenes import HAND, scene_case

from hhsim.recordings.joint_names import KEYPOINTS, WEBXR_JOINTS
from hhsim.repair.recorded_scene import model_joints


@pytest.mark.soak
def test_each_episode_of_a_data_set_is_repaired_and_the_rest_stays(repository: Path, tmp_path: Path) -> None:
    pyarrow = pytest.importorskip("pyarrow", reason="LeRobot's data sets are Parquet files")
    from pyarrow import parquet

    frames = scene_case("sphere", "grasp", 100, 3, 13).frames
    joints = np.zeros((10, 2, 25, 3))
    for name, places in zip(KEYPOINTS, model_joints(HAND, frames).swapaxes(0, 1), strict=True):
        # WebXR's world has y up.
        joints[:, 1, WEBXR_JOINTS.index(name)] = places[:, [1, 2, 0]]
    # The metacarpals of four fingers are no keypoints.
    missing = [k for k, name in enumerate(WEBXR_JOINTS) if name not in KEYPOINTS]
    joints[:, 1, missing] = joints[:, 1, [WEBXR_JOINTS.index(KEYPOINTS[0])]]
    columns = {
        "observation.hand_joints": joints.tolist() * 2,
        "action": np.arange(20.0).tolist(),
        "timestamp": (np.arange(10) / 30.0).tolist() * 2,
        "episode_index": np.repeat([0, 1], 10).tolist(),
    }
    path = tmp_path / "set" / "data" / "chunk-000" / "file-000.parquet"
    path.parent.mkdir(parents=True)
    parquet.write_table(pyarrow.table(columns), path)
    (tmp_path / "set" / "meta").mkdir()
    (tmp_path / "set" / "meta" / "info.json").write_text(json.dumps({"codebase_version": "v3.0", "fps": 30}))
    command = [sys.executable, str(repository / "examples" / "repair_lerobot.py"), "set", "sphere", "out", "right"]
    answer = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert answer.returncode == 0, answer.stderr
    assert [line.endswith(" 0.000 mm repaired") for line in answer.stdout.splitlines()] == [True, True]
    found = parquet.read_table(tmp_path / "out" / path.relative_to(tmp_path / "set"))
    moved = np.array(found["observation.hand_joints"].to_pylist()) - np.array(columns["observation.hand_joints"])
    assert np.abs(moved[:10]).max() > 1e-3 and np.array_equal(moved[:10], moved[10:]) and not moved[:, 0].any()
    for name in ("action", "timestamp", "episode_index"):
        assert found[name].to_pylist() == columns[name]
    assert [file.name for file in sorted((tmp_path / "out").rglob("*")) if file.is_file()] == [path.name, "info.json"]
