"""A scene puts object, tree, hand and motion into one world frame."""

import ast
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from short_grasp import short_grasp_text
from sphere_scenes import bumpy_ball

import hhsim
from hhsim.arrays import FloatArray
from hhsim.errors import UnknownNameError
from hhsim.hand.model import HandModel
from hhsim.motion.trajectory import Trajectory
from hhsim.replay.run_inputs import differences, run_inputs
from hhsim.result.schema import TICK_COLUMNS
from hhsim.scene.scene import make_scene
from tools.shapes.generators import cube, sphere

HAND = HandModel.default("right")
MESH = sphere(0.076, 2)
TREE = bumpy_ball(200)


def recording(position: FloatArray, orientation: FloatArray) -> Trajectory:
    """Five samples at 100 Hz beside an object at this pose."""
    return Trajectory(
        time=np.arange(5) / 100.0,
        position=np.linspace([0.0, 0.0, 0.3], [0.0, 0.0, 0.26], 5),
        orientation=np.tile([1.0, 0.0, 0.0, 0.0], (5, 1)),
        flexion=np.zeros((5, 5, 3)),
        abduction=np.zeros((5, 5)),
        object_position=position,
        object_orientation=orientation,
        name="five samples",
    )


def test_a_recording_says_where_the_object_is() -> None:
    turn = Rotation.from_rotvec([0.3, -0.5, 0.2])
    shift = np.array([0.1, -0.2, 0.05])
    scene = make_scene(MESH, TREE, HAND, recording(shift, turn.as_quat(scalar_first=True)))
    np.testing.assert_allclose(scene.solids[0].placed_mesh.vertices, turn.apply(MESH.vertices) + shift, atol=1e-12)
    np.testing.assert_array_equal(scene.solids[0].placed_mesh.faces, MESH.faces)
    np.testing.assert_allclose(scene.solids[0].placed_tree.center, turn.apply(TREE.center) + shift, atol=1e-12)
    np.testing.assert_array_equal(scene.solids[0].placed_tree.radius, TREE.radius)
    assert scene.hands[0].trajectory.name == "five samples"


Run = Callable[..., Any]


def test_the_names_of_the_package_are_those_of_its_table_and_its_types() -> None:
    assert hhsim.__file__ is not None
    source = ast.parse(Path(hhsim.__file__).read_text(encoding="utf-8"))
    (block,) = (node for node in source.body if isinstance(node, ast.If))
    typed = {
        alias.asname or alias.name: f"{node.module}.{alias.name}"
        for node in block.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    # The package that has the function is called for it.
    assert typed == hhsim._PLACES | {"repair": "hhsim.repair.in_memory.repair"}
    assert hhsim.__all__ == sorted(typed)
    assert set(dir(hhsim)) == {*hhsim.__all__, "__version__"}
    for name in hhsim.__all__:
        value = getattr(hhsim, name)
        found = value.__name__ if isinstance(value, ModuleType) else f"{value.__module__}.{value.__name__}"
        assert found == hhsim._PLACES[name] and callable(value)
        assert value.__doc__
    with pytest.raises(AttributeError, match="module 'hhsim' has no attribute 'replayed'"):
        _ = hhsim.replayed


def test_the_package_imports_nothing_until_it_is_asked() -> None:
    code = (
        "import sys, hhsim; dir(hhsim); print(*sorted(sys.modules)); "
        "from hhsim.system import environment; assert environment.__name__ == 'hhsim.system.environment'"
    )
    answer = subprocess.run([sys.executable, "-P", "-c", code], capture_output=True, text=True, check=True)
    loaded = set(answer.stdout.split())
    assert {name for name in loaded if name.startswith("hhsim")} == {"hhsim"}
    assert loaded.isdisjoint({"numpy", "numba", "h5py", "click"})


def test_a_scene_from_names_is_that_of_the_command_line(run: Run, tmp_path: Path) -> None:
    (tmp_path / "short.toml").write_text(short_grasp_text())
    words = ("--level", "2", "--seed", "3", "--rate", "500", "--method", "progressive", "--out", "told.h5", "--quiet")
    assert run("replay", "cube", "short.toml", *words).code == 0
    scene = hhsim.open_scene("cube", tmp_path / "short.toml", level=2, seed=3, rate=500.0)
    summary = hhsim.replay_scene(scene, hhsim.SolverOptions(method="progressive"), str(tmp_path / "own.h5"))
    by_command, own = hhsim.load_result(tmp_path / "told.h5"), hhsim.load_result(str(tmp_path / "own.h5"))
    assert summary.path == own.path and own.complete
    for column in TICK_COLUMNS:
        if not column.name.startswith("duration/"):
            assert np.array_equal(by_command[column.name], own[column.name], equal_nan=column.dtype == "<f8"), (
                column.name
            )
    assert own["contacts/touching"].max() > 0
    assert differences(run_inputs(by_command), run_inputs(own)) == []
    description = {name: by_command.scene[name] for name in own.scene if name not in ("object", "trajectory")}
    assert {name: own.scene[name] for name in description} == description
    assert (own.scene["object"], own.scene["trajectory"]) == ("cube", str(tmp_path / "short.toml"))
    answer = run("replay", "own.h5")
    assert answer.code == 0 and "identical in every tick" in answer.out


def test_a_scene_of_a_mesh_and_a_motion_that_are_loaded(tmp_path: Path) -> None:
    (tmp_path / "short.toml").write_text(short_grasp_text())
    mesh = cube()
    motion = hhsim.open_scene(mesh, tmp_path / "short.toml", level=1).hands[0].trajectory
    scene = hhsim.open_scene(mesh, motion, level=1, mode="hold", rate=250.0)
    assert (scene.ticks.rate, scene.ticks.tick_count) == (250.0, 50)
    assert (scene.description["object"], scene.description["trajectory"]) == (mesh.name, motion.name)
    assert scene.description["samples"] == "hold" and scene.solids[0].placed_tree.depth == 1
    assert scene.hands[0].model.side == "right"


def test_the_hand_is_named_by_its_side() -> None:
    left = hhsim.open_scene("cube", "pinch", level=2, hand="left")
    assert left.hands[0].model.side == "left" and "left hand" in repr(left)
    with pytest.raises(UnknownNameError, match="unknown hand 'lft': did you mean left"):
        hhsim.open_scene("cube", "pinch", level=2, hand="lft")  # type: ignore[arg-type]
