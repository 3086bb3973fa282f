"""Mean and standard deviation of times over runs, of numbers that can be checked by hand."""

import math
from types import SimpleNamespace
from typing import Any

import pytest

from hhsim.metrics.run.registry import run_metrics
from hhsim.replay.summary import RepeatedTime, repeated_document, stored_times
from hhsim.replay.summary_table import SummaryRow


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
