"""Public recordings of a hand and the object that it moves: in the object before, outside of it after."""

import os
from pathlib import Path

import numpy as np
import pytest

from hhsim.recordings.registry import ReadOptions, read_recording
from hhsim.recordings.repair import repair
from hhsim.replay.replay import replay_scene
from hhsim.result.reader import load_result
from hhsim.scene.scene import open_scene
from hhsim.solver.options import SolverOptions

MOUSE = "265826671143948"
"""The object of the clip that moves: by 54 mm, in the right hand."""


def test_a_mouse_moved_by_a_hand_on_a_headset(tmp_path: Path) -> None:
    """A Quest 3 clip of HOT3D, where it lies; its licence does not let it ship."""
    trimesh = pytest.importorskip("trimesh")
    folder = Path(os.environ.get("HHSIM_HOT3D_SAMPLE", ""))
    path = folder / "Quest3" / "P0002_273c2819" / "umetrack_hand_pose_trajectory.jsonl"
    mesh = folder / "object_library" / f"{MOUSE}.glb"
    if not path.is_file() or not mesh.is_file():
        pytest.skip("no HOT3D sample: set HHSIM_HOT3D_SAMPLE to the folder data_sample")
    motion = repair(read_recording(path, ReadOptions(hand="right", object_track=MOUSE))).trajectory
    assert motion.object_motion is not None
    assert 0.05 < np.ptp(motion.object_motion.position, axis=0).max() < 0.06
    trimesh.load(mesh, force="mesh").export(tmp_path / "mouse.stl")
    replay_scene(open_scene(tmp_path / "mouse.stl", motion, level=3), SolverOptions(), tmp_path / "run.h5")
    result = load_result(tmp_path / "run.h5")
    assert result.driven
    assert result.summary["input_depth_max"] > 1e-3
    assert np.asarray(result["penetration_depth"]).max() == 0.0


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
