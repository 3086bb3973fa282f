"""Mean and standard deviation of times over runs, of numbers that can be checked by hand."""

import math
from dataclasses import replace

import pytest
from short_grasp import short_grasp, short_scene

from hhsim.replay.replay import replay_scene
from hhsim.replay.summary import ReplaySummary, repeated_times
from hhsim.solver.options import SolverOptions


@pytest.fixture(scope="module")
def summary(tmp_path_factory: pytest.TempPathFactory) -> ReplaySummary:
    return replay_scene(short_scene(short_grasp()), SolverOptions(), tmp_path_factory.mktemp("results") / "run.h5")


def taking(summary: ReplaySummary, seconds: float) -> ReplaySummary:
    rows = (replace(row, value=seconds) if row.name == "tick_cpu_p50" else row for row in summary.rows)
    return replace(summary, rows=tuple(rows))


def test_mean_and_deviation_are_those_of_the_runs(summary: ReplaySummary) -> None:
    found = {time.row.name: time for time in repeated_times([taking(summary, t) for t in (1e-5, 2e-5, 6e-5)])}
    p50 = found["tick_cpu_p50"]
    assert p50.mean == pytest.approx(3e-5)
    assert p50.deviation == pytest.approx(math.sqrt((4 + 1 + 9) / 2) * 1e-5)
    assert p50.shown == "30.0 ± 26.5"
    assert found["tick_cpu_p99"].deviation == 0.0, "of the same numbers"
    assert all(name.startswith("tick_") for name in found), "nothing else differs"


@pytest.mark.parametrize(
    ("seconds", "shown"),
    [
        ((13.06e-6, 13.11e-6), "13.085 ± 0.035"),
        ((10e-6, 12e-6), "11.0 ± 1.4"),
        ((13e-6, 13e-6), "13.0 ± 0.0"),
        ((13e-6, 13.000001e-6), "13.000 ± 0.000"),
    ],
)
def test_a_small_deviation_has_digits(summary: ReplaySummary, seconds: tuple[float, ...], shown: str) -> None:
    found = {time.row.name: time for time in repeated_times([taking(summary, t) for t in seconds])}
    assert found["tick_cpu_p50"].shown == shown
