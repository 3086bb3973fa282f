"""Public recordings of a hand and the object that it moves: in the object before, outside of it after."""

from pathlib import Path

import numpy as np
import pytest

from hhsim.replay.replay import replay_scene
from hhsim.result.reader import load_result
from hhsim.scene.scene import open_scene
from hhsim.solver.options import SolverOptions


def test_every_shared_recording_that_has_an_objects_pose(shared_data: Path, tmp_path: Path) -> None:
    driven = [
        path for path in sorted((shared_data / "recordings").glob("*.npz")) if "object_pos" in np.load(path).files
    ]
    if not driven:
        pytest.skip("no recording there holds the pose of an object")
    for path in driven:
        replay_scene(open_scene("sphere", path), SolverOptions(), tmp_path / f"{path.stem}.h5")
        result = load_result(tmp_path / f"{path.stem}.h5")
        assert result.driven and np.asarray(result["penetration_depth"]).max() == 0.0
