"""A result holds all that its run needs: the same ticks come out of it again, and what differs is found."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from sphere_scenes import bumpy_ball

from hhsim.errors import InputError
from hhsim.hand.model import HandModel
from hhsim.replay.repeat import COMPARED, DIFFERENT, WITHIN, run_again
from hhsim.replay.replay import replay_scene
from hhsim.result.reader import load_result
from hhsim.result.schema import TICK_COLUMNS, hand_columns
from hhsim.scene.scene import make_scene
from hhsim.scene.script import parse_script
from hhsim.solver.options import SolverOptions, Stiffness
from hhsim.trees.hierarchy import at_level
from tools.shapes.generators import sphere

SHORT = """
title = "short"
phase = [{ name = "approach", duration = 0.2 }, { name = "grasp", duration = 0.3 }, { name = "hold", duration = 0.1 }]
"""
ODD_OPTIONS = {
    "coupled": SolverOptions(stiffness=Stiffness(1234.5, 4.25, 0.4), margin=1.3e-3, fingers=("thumb", "index")),
    "progressive": SolverOptions(method="progressive", threads=2, budget=60_000),
    "paper": SolverOptions(method="paper", frustum_ends="flat"),
    "penalty": SolverOptions(method="penalty", stiffness=Stiffness(penalty=40_000.0)),
}


@pytest.fixture(scope="module")
def hand() -> HandModel:
    """No default in any field."""
    usual, turned = HandModel.default("right", hand_length=0.19), np.array([-1.0, 1.0, 1.0])
    factors = {"base": turned, "distal": turned, "dorsal": turned, "length": 1.01, "radius": 0.99} | {
        "flexion_min": 0.9, "flexion_max": 0.95, "abduction_min": 0.8, "abduction_max": 0.7
    }  # fmt: skip
    other: Any = {name: getattr(usual, name) * factor for name, factor in factors.items()}
    return replace(usual, side="left", palm_tree=at_level(usual.palm_tree, 1), **other)


@pytest.fixture(scope="module")
def runs(hand: HandModel, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("runs")
    scene = make_scene(sphere(0.076, 3), bumpy_ball(200), hand, parse_script(SHORT, name="short", where="short.toml"))
    for method, options in ODD_OPTIONS.items():
        replay_scene(scene, options, folder / f"{method}.h5")
    return {method: folder / f"{method}.h5" for method in ODD_OPTIONS}


@pytest.fixture
def copy(runs: dict[str, Path], tmp_path: Path) -> Path:
    path = tmp_path / "copy.h5"
    path.write_bytes(runs["coupled"].read_bytes())
    return path


@pytest.mark.parametrize("method", ODD_OPTIONS)
def test_every_method_runs_again_to_the_same_bits(runs: dict[str, Path], method: str) -> None:
    result = load_result(runs[method])
    assert result["contacts/candidates"].max() > 0
    again = run_again(result)
    assert again.identical
    assert again.ticks == again.ticks_stored == result.ticks == 600
    assert again.notes == ()
    given = {"time", "input_seq", *(f"haptic/{name}" for name in ("position", "orientation", "flexion", "abduction"))}
    timings = {column.name for column in TICK_COLUMNS if column.name.startswith("duration/")}
    assert {array.name for array in again.arrays} == {column.name for column in TICK_COLUMNS} - given - timings
    assert json.loads(json.dumps(again.to_json()))["identical"] is True


@pytest.mark.parametrize(
    ("name", "add", "word"),
    [
        ("graphic/position", 9e-13, WITHIN),
        ("graphic/position", 2e-12, DIFFERENT),
        ("force/phalanx", 9e-10, WITHIN),
        ("force/phalanx", 2e-9, DIFFERENT),
        ("lag", np.inf, DIFFERENT),
        ("penetration_depth", np.nan, DIFFERENT),
        ("contacts/touching", 1, DIFFERENT),
        ("status", 1, DIFFERENT),
    ],
)
def test_what_counts_as_rounding_is_bounded_and_integers_are_equal(
    copy: Path, name: str, add: float, word: str
) -> None:
    with h5py.File(copy, "r+") as file:
        dataset = file["hands/left/tick"][name]
        file["hands/left/tick/graphic/flexion"][20] += 1e-15
        dataset[530] = dataset[530] + np.asarray(add, dataset.dtype)
    again = run_again(load_result(copy))
    found = {array.name: array for array in again.arrays if not array.identical}
    assert found.keys() == {name, "graphic/flexion"}
    assert (again.word, found[name].word, found["graphic/flexion"].word) == (word, word, WITHIN)
    assert (again.same, found[name].first_tick) == (word == WITHIN, 530)
    assert found[name].first_beyond == (-1 if word == WITHIN else 530)
    assert found[name].units == next(column.units for column in COMPARED if column.name == name)
    assert again.notes[-1].endswith("of the file: the bits should be the same")
    assert again.sentence.startswith(word)
    if word == DIFFERENT:
        assert f"from tick 530 on, first {name}; the first bits differ in tick 20" in again.sentence


def test_counts_of_work_alone_make_no_run_another_and_are_told(copy: Path) -> None:
    with h5py.File(copy, "r+") as file:
        file["hands/left/tick/work/qp_iterations"][100:107] += 3
        file["hands/left/tick/work/units"][100:105] += 9
    again = run_again(load_result(copy))
    assert (again.word, again.same, again.identical) == (WITHIN, True, False)
    assert again.notes[0].endswith("of 600 ticks work/qp_iterations at 7, work/units at 5")
    with h5py.File(copy, "r+") as file:
        file["hands/left/tick/status"][3] += 1
    assert run_again(load_result(copy)).word == DIFFERENT


def test_other_bits_on_another_machine_are_explained(copy: Path) -> None:
    with h5py.File(copy, "r+") as file:
        file["hands/left/tick/force/total"][9] = 1.0
        file.attrs["hhsim_version"] = "0.0.7"
        file.attrs["machine"] = json.dumps({**json.loads(file.attrs["machine"]), "cpu": "Abacus"})
    first, second = run_again(load_result(copy)).notes
    assert first.startswith("hhsim: the file was made with 0.0.7, this is ")
    assert second.startswith("cpu: the file was made with Abacus, this is ")


def test_a_run_that_was_stopped_is_run_as_far_as_it_goes(copy: Path) -> None:
    with h5py.File(copy, "r+") as file:
        file.attrs["complete"] = 0
        file["tick/time"].resize(177, axis=0)
        for column in hand_columns():
            file["hands/left/tick"][column.name].resize(177, axis=0)
    again = run_again(load_result(copy))
    assert again.identical
    assert (again.ticks, again.complete) == (177, False)
    assert again.notes == ("the file is of a run that was stopped: its ticks so far were run again",)


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("bodies/{}/tree/radius", "the sphere tree of {} in the file is another"),
        ("bodies/{}/mesh/vertices", "the mesh of {} in the file is another"),
        ("hands/left/flexion_max", "the left hand in the file is another"),
        ("hands/left/palm_tree/center", "the left hand in the file is another"),
    ],
)
def test_another_tree_object_or_hand_is_refused(copy: Path, name: str, says: str) -> None:
    with h5py.File(copy, "r+") as file:
        (body,) = file["bodies"]
        dataset = file[name.format(body)]
        values = dataset[...]
        values.reshape(-1)[-1] *= 1.0 - 1e-15
        dataset[...] = values
    with pytest.raises(InputError, match=f"cannot be run again: {says.format(body)}"):
        run_again(load_result(copy))


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"spin": 3.0}, "its solver options cannot be read: .*spin"),
        ({"method": "magic"}, "unknown method 'magic'"),
        ({"stiffness": 3.0}, "its solver options cannot be read"),
    ],
)
def test_options_of_another_hhsim_are_told(copy: Path, change: dict[str, Any], says: str) -> None:
    with h5py.File(copy, "r+") as file:
        scene = json.loads(file.attrs["scene"])
        scene["solver"] |= change
        file.attrs["scene"] = json.dumps(scene)
    with pytest.raises(InputError, match=says):
        run_again(load_result(copy))
