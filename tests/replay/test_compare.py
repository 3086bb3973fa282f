"""What is said of runs: two side by side, the verdict and its grounds, the table's lines, times over repeats."""

import json
import math
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import h5py
import pytest
from file_faults import changed, of_scene
from short_grasp import short_result

from hhsim.metrics.run.registry import run_metrics
from hhsim.replay.compare import Comparison, compare, compared
from hhsim.replay.summary import RepeatedTime, repeated_document, stored_times
from hhsim.replay.summary_table import (
    SummaryRow,
    default_limits,
    short_table,
    stored_promises,
    summary_rows,
    whole_table,
)
from hhsim.replay.verdict import EMPTY, LATE, MISSED, NOT_JUDGED, OK, SHORT, UNTOUCHED, run_verdict
from hhsim.result.reader import Result, load_result
from hhsim.solver.method import METHODS, PROMISES
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


SOUND = {
    **dict.fromkeys(run_metrics(), 0.0),
    "candidates_max": 20.0,
    "touching_max": 3.0,
    "force_contact_max": 2.0,
    "tick_cpu_p50": 1e-5,
    "tick_cpu_p99": 3e-5,
}
FREE = {"touching_max": 0.0, "force_contact_max": math.nan}


@pytest.mark.parametrize(
    ("figures", "more", "word"),
    [
        ({}, {}, OK),
        ({"penetration_max": 2e-6}, {}, MISSED),
        ({"penetration_max": 2e-6}, {"complete": False}, MISSED),
        ({"stuck_ticks": 1.0}, {}, MISSED),
        ({"force_step": math.nan, "tracking_excess": math.nan}, {}, OK),
        ({}, {"complete": False}, SHORT),
        ({}, {"late": 3}, LATE),
        (FREE, {}, UNTOUCHED),
        (FREE | {"candidates_max": 0.0}, {}, UNTOUCHED),
        (FREE | {"candidates_max": 0.0}, {"late": 3}, UNTOUCHED),
    ],
)
def test_the_word(figures: dict[str, float], more: dict[str, Any], word: str) -> None:
    found = run_verdict(summary_rows(SOUND | figures), PROMISES, 100, **more)
    assert found.word == word
    assert found.line.startswith(word)
    assert bool(found.missed) == (word == MISSED)


def test_no_tick_is_no_verdict() -> None:
    assert run_verdict((), PROMISES, 0).word == EMPTY


def test_where_nothing_touches_it_says_what_to_try() -> None:
    near, far = (run_verdict(summary_rows(SOUND | FREE | {"candidates_max": n}), PROMISES, 9) for n in (4.0, 0.0))
    assert "The hand never touches the object" in near.line and "--place-object auto" in near.line
    assert "The hand never comes near the object" in far.line and "--size" in far.line


@pytest.mark.parametrize(("method", "missed"), [("coupled", 2), ("progressive", 1), ("paper", 0), ("penalty", 0)])
def test_a_method_is_held_to_what_it_promises(method: str, missed: int) -> None:
    figures = SOUND | {"tracking_excess": 76.5, "penetration_max": 1e-4}
    assert len(run_verdict(summary_rows(figures), METHODS[method].promises, 100).missed) == missed


@pytest.mark.parametrize(("depth", "word"), [(0.9e-6, OK), (1.1e-6, NOT_JUDGED), (8e-4, NOT_JUDGED)])
def test_a_depth_that_nobody_promised_is_not_within_limits(depth: float, word: str) -> None:
    found = run_verdict(summary_rows(SOUND | {"penetration_max": depth}), (), 100)
    assert found.word == word and found.line.startswith(word)
    assert not found.missed


def test_what_a_method_promises_is_in_its_file() -> None:
    outside = {"solver": {"method": "somebody:Method"}}
    assert stored_promises(outside) == frozenset(PROMISES), "what is not known is held to everything"
    assert stored_promises(outside | {"promises": []}) == frozenset()
    assert stored_promises(outside | {"promises": ["never_penetrates"]}) == {"never_penetrates"}
    assert stored_promises({"solver": {"method": "paper"}, "promises": list(PROMISES)}) == frozenset()


@pytest.mark.parametrize(("stuck", "mostly"), [(0.0, False), (3.0, False), (50.0, False), (51.0, True), (100.0, True)])
def test_a_run_of_which_most_ticks_are_stuck_says_so(stuck: float, mostly: bool) -> None:
    found = run_verdict(summary_rows(SOUND | FREE | {"stuck_ticks": stuck}), PROMISES, 100)
    assert found.mostly_stuck == mostly
    assert ("More than half of the ticks are stuck" in found.line) == mostly
    assert not mostly or found.word == MISSED


SELDOM = ("self_depth_haptic", "self_depth_graphic", "no_place_ticks", "snap_ticks")
FIXED = [name for name, metric in run_metrics().items() if not metric.free_only and name not in SELDOM]
EVERY = dict.fromkeys(FIXED, 1.0) | {"lag_ticks": 0.0, "lag_max": 0.0, "force_variation_hold": 0.0}


def names(rows: tuple[SummaryRow, ...]) -> list[str]:
    return [row.name for row in rows]


def test_the_short_table_has_the_lines_that_matter() -> None:
    assert names(short_table(summary_rows(EVERY))) == [
        *("input_depth_max", "penetration_max", "contact_error_max", "posture_jump_max"),
        *("force_contact_mean", "force_contact_step", "force_variation_tremor", "correction_joint_mean"),
        *("tick_cpu_p50", "tick_cpu_p99", "stuck_ticks", "lag_ticks"),
    ]


def test_what_is_over_its_limit_is_in_the_short_table() -> None:
    assert "force_ripple_hold" in names(short_table(summary_rows(EVERY), ["force_ripple_hold"]))


def test_the_largest_lag_stands_where_there_is_lag_or_a_stuck_hand_has_way_left() -> None:
    without, with_lag = (summary_rows(EVERY | {"lag_max": most}) for most in (0.0, 0.03))
    stuck = summary_rows(EVERY | {"lag_ticks": 0.0, "stuck_ticks": 2.0, "lag_max": 0.1})
    for table in (short_table, whole_table):
        assert "lag_max" not in names(table(without))
        assert "lag_max" in names(table(with_lag))
        assert "lag_max" in names(table(stuck))
    assert names(whole_table(with_lag)) == names(with_lag)


def test_the_papers_figures_stand_beside_its_scenes_alone_and_beside_the_same_quantities() -> None:
    # Its variation is of the index finger's force, its times are means and limits.
    beside = {row.name for row in summary_rows(EVERY, of_paper=True) if row.paper}
    assert beside == {"penetration_max", "tick_cpu_max"}
    assert not any(row.paper for row in summary_rows(EVERY))


@pytest.mark.parametrize("method", METHODS)
def test_a_limit_is_shown_in_the_unit_of_its_figure_or_not_promised(method: str) -> None:
    free = dict.fromkeys(run_metrics(), 1.0)
    shown = {row.name: row.limit(METHODS[method].promises) for row in summary_rows(free)}
    assert shown["tracking_palm"] == "20" and shown["force_contact_mean"] == ""
    assert shown["penetration_max"] == ("1" if METHODS[method].never_penetrates else "not promised")
    assert {name for name, text in shown.items() if text not in ("", "not promised")} == {
        *default_limits(METHODS[method].promises)
    }


def taking(*seconds: float) -> dict[str, RepeatedTime]:
    """Figures of runs whose median tick takes so long, and all else the same."""
    figures = run_metrics()
    same = [SummaryRow(figures[name], 1e-4) for name in ("tick_cpu_p99", "penetration_max")]
    runs: list[Any] = [SimpleNamespace(rows=(SummaryRow(figures["tick_cpu_p50"], s), *same)) for s in seconds]
    return {time.row.name: time for time in stored_times(repeated_document(runs), runs[-1].rows)}


def test_mean_and_deviation_are_those_of_the_runs() -> None:
    found = taking(1e-5, 2e-5, 6e-5)
    assert found.keys() == {"tick_cpu_p50", "tick_cpu_p99"}, "nothing else differs"
    p50 = found["tick_cpu_p50"]
    assert p50.mean == pytest.approx(3e-5)
    assert p50.deviation == pytest.approx(math.sqrt((4 + 1 + 9) / 2) * 1e-5)
    assert p50.shown == "30.0 ± 26.5"
    assert found["tick_cpu_p99"].deviation == 0.0, "of the same numbers"


@pytest.mark.parametrize(
    ("seconds", "shown"),
    [
        ((13.06e-6, 13.11e-6), "13.085 ± 0.035"),
        ((10e-6, 12e-6), "11.0 ± 1.4"),
        ((13e-6, 13e-6), "13.0 ± 0.0"),
        ((13e-6, 13.000001e-6), "13.000 ± 0.000"),
    ],
)
def test_a_small_deviation_has_digits(seconds: tuple[float, ...], shown: str) -> None:
    assert taking(*seconds)["tick_cpu_p50"].shown == shown
