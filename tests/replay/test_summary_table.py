"""Which lines a table has: all that say something, or those that matter."""

import pytest

from hhsim.metrics.run.registry import run_metrics
from hhsim.replay.summary_table import SummaryRow, default_limits, short_table, summary_rows, whole_table
from hhsim.solver.method import METHODS

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
