"""What results are called: what differs between them is said, and nothing else."""

from dataclasses import replace
from typing import Any

import pytest
from short_grasp import short_result

from hhsim.report.sections import letter, result_labels
from hhsim.result.reader import Result


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Result:
    return short_result(tmp_path_factory.mktemp("result") / "a-very-long-name-of-a-file-that-says-nothing.h5")


def otherwise(result: Result, solver: dict[str, Any] | None = None, **scene: Any) -> Result:
    """The same result with other options."""
    return replace(result, scene={**result.scene, **scene, "solver": {**result.scene["solver"], **(solver or {})}})


def test_one_result_is_its_method(plain: Result) -> None:
    assert result_labels([plain]) == ["coupled"]
    assert result_labels([otherwise(plain, {"method": ""})]) == ["method"]
    assert [letter(place) for place in (0, 25, 26, 701, 702)] == ["A", "Z", "AA", "ZZ", "AAA"]


def test_methods_are_told_without_what_follows_from_them(plain: Result) -> None:
    other = otherwise(plain, {"method": "paper", "force": "paper", "margin": 5e-4, "linearisations": 1})
    assert result_labels([plain, other]) == ["A: coupled", "B: paper"]


def test_object_and_motion_are_told_where_they_differ(plain: Result) -> None:
    cup, pinch = otherwise(plain, object_name="cup"), otherwise(plain, motion="pinch")
    assert result_labels([plain, cup]) == ["A: cylinder coupled", "B: cup coupled"]
    assert result_labels([plain, pinch]) == ["A: short coupled", "B: pinch coupled"]


def test_options_are_told_that_are_not_usual_and_not_of_all(plain: Result) -> None:
    soft = otherwise(plain, {"stiffness": {**plain.scene["solver"]["stiffness"], "translation": 200.0}})
    thin = otherwise(plain, {"margin": 2e-3}, seed=3)
    labels = ["A: coupled", "B: coupled, stiffness translation 200", "C: coupled, seed 3, margin 2 mm"]
    assert result_labels([plain, soft, thin]) == labels
    assert result_labels([thin, thin]) == ["A: coupled", "B: coupled"]
    slow = otherwise(plain, {"period": 1 / 72}, rate=72.0)
    assert result_labels([plain, slow])[1].startswith("B: coupled, rate 72")
