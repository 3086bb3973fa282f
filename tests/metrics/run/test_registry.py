"""The figures of a run: each needs what it says, and one more file adds one everywhere."""

import dataclasses
import math
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from markdown_pages import Page
from short_grasp import short_grasp, short_scene

import hhsim.metrics.run
from hhsim.gate.gate import gate_result
from hhsim.gate.metrics import run_figures
from hhsim.gate.suite import default_suite, parse_suite
from hhsim.metrics.run.registry import needed_columns, run_figure, run_metrics, tick_figures
from hhsim.metrics.run_metric import RunMetric
from hhsim.metrics.run_ticks import RunTicks, result_ticks
from hhsim.motion.trajectory import TickPhase
from hhsim.replay.replay import replay_scene
from hhsim.replay.summary import ReplaySummary
from hhsim.report.sections import all_figures, report_runs
from hhsim.result.reader import Result, load_result
from hhsim.result.schema import TICK_COLUMNS
from hhsim.solver.options import SolverOptions

ONE_MORE = """
from hhsim.metrics.run_metric import Judged, RunMetric

METRICS = (
    RunMetric(
        name="lag_mean",
        label="lag, mean",
        digits=4,
        unit="mm",
        needs=("lag", "work/linearisations"),
        compute=lambda run: run["lag"].mean() + 1e-3 * run["work/linearisations"].mean(),
        judged=Judged(rounding=1e-9, limit=1e-4),
    ),
)
"""
"""A figure that needs a dataset that no other one needs."""


@pytest.fixture(scope="module")
def one_more(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """A file more among the modules of the package."""
    folder = tmp_path_factory.mktemp("metrics")
    (folder / "lag_mean.py").write_text(ONE_MORE)
    hhsim.metrics.run.__path__.append(str(folder))
    run_metrics.cache_clear()
    yield
    hhsim.metrics.run.__path__.remove(str(folder))
    sys.modules.pop("hhsim.metrics.run.lag_mean")
    run_metrics.cache_clear()


@pytest.fixture(scope="module")
def replayed(one_more: None, tmp_path_factory: pytest.TempPathFactory) -> tuple[ReplaySummary, Result]:
    path = tmp_path_factory.mktemp("results") / "run.h5"
    summary = replay_scene(short_scene(short_grasp()), SolverOptions(), path, description={"level": 2})
    return summary, load_result(path)


def test_one_more_file_is_in_the_table_the_json_and_the_file(replayed: tuple[ReplaySummary, Result]) -> None:
    summary, result = replayed
    expected = float(result["lag"].mean() + 1e-3 * result["work/linearisations"].mean())
    assert expected > 1e-4
    row = summary.rows[-1]
    assert (row.name, row.label, row.unit, row.shown) == ("lag_mean", "lag, mean", "mm", f"{1e3 * expected:.4f}")
    assert summary.to_json()["lag_mean"] == result.summary["lag_mean"] == expected


def test_one_more_file_is_judged_by_the_gate(replayed: tuple[ReplaySummary, Result]) -> None:
    result = replayed[1]
    assert run_figures(result).errors["lag_mean"] == result.summary["lag_mean"]
    report = gate_result(result, default_suite(), result)
    (row,) = (row for row in report.rows if row.name == "lag_mean")
    assert (row.verdict, row.passed, row.limit) == ("same", False, 1e-4)
    scene = '[[scene]]\nname = "a"\nobject = "cube"\ntrajectory = "pinch"\n'
    suite = parse_suite(f"version = 1\n[limits]\nlag_mean = 1.0\n{scene}", Path(), "mine")
    assert not gate_result(result, suite, None).missed


def test_one_more_file_is_in_the_report_and_its_verdict(replayed: tuple[ReplaySummary, Result]) -> None:
    summary, result = replayed
    (run,) = report_runs([result])
    assert "lag_mean" in run.verdict.missed
    assert all_figures([run], []).cells[-1] == ["lag, mean", summary.rows[-1].shown, "mm"]
    (cut,) = report_runs([dataclasses.replace(result, complete=False)])
    assert cut.rows[-1].value == summary.rows[-1].value


def ticks_of(names: tuple[str, ...], ticks: int) -> RunTicks:
    shapes = {column.name: (ticks, *column.shape) for column in TICK_COLUMNS}
    kinds = {column.name: column.dtype for column in TICK_COLUMNS}
    columns = {name: np.ones(shapes[name], kinds[name]) for name in names}
    phases = (TickPhase("approach", 0, 9), TickPhase("hold", 10, ticks - 1)) if ticks else ()
    return RunTicks(columns, ticks, phases, 1000.0, 5, 100)


# Those of a free object are in tests/verify/test_free_object_checks.py.
OF_ANY = {name: metric for name, metric in run_metrics().items() if not metric.free_only}


@pytest.mark.parametrize("metric", OF_ANY.values(), ids=OF_ANY)
@pytest.mark.parametrize("ticks", [0, 200])
def test_a_figure_needs_what_it_says_and_no_tick_at_all(metric: RunMetric, ticks: int) -> None:
    if metric.compute is None:
        with pytest.raises(ValueError, match="does not follow from the ticks"):
            run_figure(metric.name, ticks_of((), 0))
        return
    value = run_figure(metric.name, ticks_of(metric.needs, ticks))
    # Without an object nothing is touched, and without a hand none is looked at.
    unknown = ("contact_error", "input_depth", "self_depth", "correction", "free_off", "posture_jump")
    assert math.isfinite(value) or ticks == 0 or metric.name.startswith(unknown)


def test_figures_of_a_file_are_those_of_its_run(replayed: tuple[ReplaySummary, Result]) -> None:
    summary, result = replayed
    figures = tick_figures(result_ticks(result))
    assert set(needed_columns()) <= {column.name for column in TICK_COLUMNS}
    for row in summary.rows:
        if not run_metrics()[row.name].own_run:
            np.testing.assert_equal(figures[row.name], row.value, err_msg=row.name)


def test_the_documentation_says_which_do_not_follow_from_the_file(repository: Path) -> None:
    page = Page.read(repository / "docs" / "metrics.md")
    sentence = next(line for line in page.text.split("\n\n") if "need further runs of the solver" in line)
    assert {name for name in run_metrics() if f"`{name}`" in sentence} == {
        name for name, metric in run_metrics().items() if metric.own_run
    }
