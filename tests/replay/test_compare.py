"""Two results side by side: what differs in input and options, and which figures are better or worse."""

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import pytest
from file_faults import of_scene
from sealed_change import changed
from short_grasp import short_result

from hhsim.metrics.run.registry import run_metrics
from hhsim.replay.compare import Comparison, compare, compared
from hhsim.replay.summary_table import SummaryRow
from hhsim.result.reader import Result, load_result
from hhsim.table.verdict import BETTER, NOT_COMPARABLE, SAME, WITHIN, WORSE

ALIKE = Comparison((), (), (), same_machine=True)


def word(name: str, base: float, head: float, comparison: Comparison = ALIKE) -> str:
    figure = run_metrics()[name]
    return compared(SummaryRow(figure, base), SummaryRow(figure, head), comparison).word


@pytest.mark.parametrize(
    ("name", "base", "head", "expected"),
    [
        ("force_variation_tremor", 1.0, 0.7, WITHIN),
        ("force_variation_tremor", 1.0, 2.9, WITHIN),
        ("force_variation_tremor", 1.0, 0.3, BETTER),
        ("force_variation_tremor_std", 1.0, 3.1, WORSE),
        ("tick_cpu_p50", 1e-5, 0.92e-5, WITHIN),
        ("tick_cpu_p50", 1e-5, 0.85e-5, BETTER),
        ("tick_cpu_p99", 1e-5, 1.4e-5, WITHIN),
        ("tick_cpu_max", 1e-5, 1e-6, ""),
        ("work_mean", 100.0, 98.0, BETTER),
        ("force_hold_mean", 1.0, 2.0, ""),
        ("penetration_max", 0.0, 0.0, SAME),
        # An energy below the optimum is as wrong as one above.
        ("tracking_excess", 0.5, -20.0, WORSE),
        ("tracking_excess", -20.0, 0.5, BETTER),
        ("tracking_excess", -5.0, -20.0, WORSE),
        ("tracking_excess", 5.0, -5.0, SAME),
    ],
)
def test_a_difference_within_noise_is_neither_better_nor_worse(
    name: str, base: float, head: float, expected: str
) -> None:
    assert word(name, base, head) == expected


def test_times_of_two_machines_and_figures_of_two_scenes_are_not_compared() -> None:
    elsewhere = replace(ALIKE, same_machine=False)
    assert word("tick_cpu_p50", 1e-5, 3e-5, elsewhere) == NOT_COMPARABLE
    assert word("work_mean", 100.0, 98.0, elsewhere) == BETTER
    assert word("work_mean", 100.0, 98.0, replace(ALIKE, scene=("trajectory",))) == ""


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Result:
    return short_result(tmp_path_factory.mktemp("results") / "short.h5")


def test_what_differs_is_told_by_names_and_in_units(result: Result, tmp_path: Path) -> None:
    def beside(change: Callable[[h5py.File], object]) -> Comparison:
        shutil.copy(result.path, tmp_path / "other.h5")
        with changed(tmp_path / "other.h5") as file:
            change(file)
        return compare(result, load_result(tmp_path / "other.h5"))

    def scene(**others: Any) -> Callable[[h5py.File], object]:
        return of_scene("other words", lambda words: words.update(others))

    def moved(file: h5py.File) -> None:
        file["hands/right/tick/haptic/position"][17, 0] += 1e-5

    def elsewhere(file: h5py.File) -> None:
        file.attrs["machine"] = json.dumps({**json.loads(file.attrs["machine"]), "cpu": "another one"})

    assert beside(moved).sentence() == "Not comparable: not the same scene (trajectory)."
    door = beside(scene(object_name="door", object_mesh="0" * 64, unit="mm"))
    assert door.scene == ("object: cylinder and door", "unit: none and mm")
    assert beside(scene(motion="push")).scene == ("motion: short and push",)
    assert beside(scene(solver={**result.scene["solver"], "margin": 5e-4})).how == ("margin: 1 mm and 0.5 mm",)
    foreign = beside(elsewhere)
    assert foreign.comparable and foreign.same_bits and not foreign.same_machine
    assert any(text.startswith("cpu: ") for text in foreign.around)
