"""A driven object: the hand beside it is the one beside a fixed object, moved; and every reader honours it."""

import json
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Run
from driven_scenes import carried, swing
from sampled import sampled
from short_grasp import result_of, shortened
from sphere_scenes import bumpy_ball

from hhsim.hand.forward_kinematics import PlacedHand
from hhsim.hand.model import HandModel
from hhsim.kernels.hand.hand_shape import HandShape
from hhsim.metrics.metrics import penetration
from hhsim.metrics.run.registry import tick_figures
from hhsim.metrics.run_ticks import result_ticks
from hhsim.motion.file import save_trajectory
from hhsim.motion.trajectory import Trajectory
from hhsim.replay.run_inputs import run_inputs
from hhsim.result.reader import Result, load_result
from hhsim.result.schema import TICK_COLUMNS
from hhsim.scene.motion_catalogue import load_script
from hhsim.scene.scene import make_scene
from hhsim.scene.synthesis import synthesize
from tools.shapes.generators import sphere

HAND = HandModel.default("right")
MESH, TREE = sphere(0.076, 3), bumpy_ball(400)
MEASURED = [column for column in TICK_COLUMNS if not column.name.startswith("duration/")]
EQUAL = 1e-9


@cache
def motion() -> Trajectory:
    return synthesize(shortened(load_script("grasp"), 0.9), HAND, TREE)


def run(path: Path, moving: Trajectory, method: str = "coupled") -> Result:
    return result_of(make_scene(MESH, TREE, HAND, moving), path, method=method)


@pytest.fixture(scope="module", params=sampled(["coupled", "progressive"], lambda _, method: method == "coupled"))
def runs(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Result, Result]:
    """The same grasp beside a fixed object, and carried at up to 3 m/s and 20 rad/s."""
    folder, fixed = tmp_path_factory.mktemp("driven"), motion()
    moved = carried(fixed, swing(fixed.time))
    return run(folder / "fixed.h5", fixed, request.param), run(folder / "driven.h5", moved, request.param)


def test_the_result_is_that_of_the_fixed_object_moved(runs: tuple[Result, Result]) -> None:
    fixed, driven = runs
    moved = swing(np.asarray(fixed["time"]))
    ways: dict[str, Callable[[Any], Any]] = {
        "graphic/position": moved.points,
        "graphic/joints": moved.points,
        "graphic/orientation": moved.orientations,
        "haptic/position": moved.points,
        "haptic/orientation": moved.orientations,
        **{column.name: moved.vectors for column in MEASURED if column.name.startswith("force/")},
    }
    assert driven.frame and not fixed.frame
    assert np.asarray(fixed["contacts/touching"]).max() > 5
    for column in MEASURED:
        values = np.asarray(fixed[column.name])
        shape = values.shape
        if (way := ways.get(column.name)) is not None:
            values = way(values if shape[-1] == 4 else values.reshape(len(values), -1, 3))
        expected = values.reshape(shape)
        np.testing.assert_allclose(driven[column.name], expected, atol=EQUAL, rtol=0.0, err_msg=column.name)


def test_nothing_penetrates_where_the_input_is_deep(runs: tuple[Result, Result]) -> None:
    for result in runs:
        assert np.asarray(result["penetration_depth"]).max() == 0.0
        assert result.summary["input_depth_max"] > 5e-3
    # Not as the file says but as its world has it: the object's spheres moved, tick by tick.
    result = runs[1]
    static, moved = result.static, result.moved_since_first()
    for tick in range(0, result.ticks, 60):
        part = slice(tick, tick + 1)
        one = type(moved)(moved.turn[part], moved.shift[part])
        tree = replace(TREE, center=one.points(result.body.static["tree/center"][None])[0])
        depth = penetration(
            tree.arrays(),
            HandShape._make(static[f"hand/{name}"] for name in HandShape._fields),
            PlacedHand._make(result[f"graphic/{name}"][part] for name in PlacedHand._fields),
        ).depth
        # There and back a coordinate of a metre loses its last digits.
        assert depth.max() < 1e-12


def test_every_figure_is_that_of_the_fixed_object(runs: tuple[Result, Result]) -> None:
    fixed, driven = (tick_figures(result_ticks(result)) for result in runs)
    timed = {name for name in fixed if name.startswith("tick_")}
    for name in fixed.keys() - timed:
        np.testing.assert_allclose(driven[name], fixed[name], rtol=1e-7, atol=1e-9, err_msg=name)
        stored = runs[1].summary[name]
        np.testing.assert_allclose(stored, driven[name], rtol=1e-12, atol=1e-15, err_msg=name)
    assert runs[1]["penetration_depth"].max() == 0.0
    assert run_inputs(runs[1]).motion == pytest.approx(run_inputs(runs[0]).motion, abs=1e-9)


def test_the_command_line_drives_or_fixes_the_object_of_a_recording(run: Run, tmp_path: Path) -> None:
    grasp = synthesize(load_script("pinch"), HAND, TREE)
    fixed = grasp.placed([0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0])
    save_trajectory(carried(fixed, swing(fixed.time, 0.5, 2.0)), tmp_path / "carried.h5")
    options = ("--level", "2", "--json", "--quiet")
    for asked, driven in (("recorded", True), ("fixed", False)):
        answer = run("replay", "sphere", "carried.h5", "--object-pose", asked, "--out", f"{asked}.h5", *options)
        assert answer.code == 0, answer.err
        assert {"input_depth_max", "correction_joint_mean"} <= json.loads(answer.out).keys()
        assert bool(load_result(tmp_path / f"{asked}.h5").frame) is driven
    assert load_result(tmp_path / "fixed.h5").scene["object_pose"] == "fixed"
    refused = run("replay", "sphere", "carried.h5", "--place-object", "auto")
    assert refused.code == 2 and "--place-object auto needs --object-pose fixed" in refused.err
    refused = run("replay", "sphere", "pinch", "--object-pose", "fixed")
    assert refused.code == 2 and "--object-pose is for recordings" in refused.err
