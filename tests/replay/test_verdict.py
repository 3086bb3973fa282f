"""The verdict on a run: its word, what it rests on, and what to do where nothing touched."""

import math
from typing import Any

import pytest

from hhsim.metrics.run.registry import run_metrics
from hhsim.replay.summary_table import summary_rows
from hhsim.replay.verdict import EMPTY, LATE, MISSED, OK, SHORT, UNTOUCHED, run_verdict

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
    found = run_verdict(summary_rows(SOUND | figures, 1000.0), "coupled", 100, **more)
    assert found.word == word
    assert found.line.startswith(word)
    assert bool(found.missed) == (word == MISSED)


def test_no_tick_is_no_verdict() -> None:
    assert run_verdict((), "coupled", 0).word == EMPTY


def test_where_nothing_touches_it_says_what_to_try() -> None:
    near, far = (run_verdict(summary_rows(SOUND | FREE | {"candidates_max": n}, 1e3), "coupled", 9) for n in (4.0, 0.0))
    assert "The hand never touches the object" in near.line and "--place-object auto" in near.line
    assert "The hand never comes near the object" in far.line and "--size" in far.line


@pytest.mark.parametrize(("method", "missed"), [("coupled", 2), ("progressive", 1), ("paper", 0), ("penalty", 0)])
def test_a_method_is_held_to_what_it_promises(method: str, missed: int) -> None:
    figures = SOUND | {"tracking_excess": 76.5, "penetration_max": 1e-4}
    assert len(run_verdict(summary_rows(figures, 1000.0), method, 100).missed) == missed


def test_an_older_file_without_the_count_of_touches_is_judged_by_what_was_near() -> None:
    figures = {name: value for name, value in SOUND.items() if name not in ("touching_max", "force_contact_max")}
    assert run_verdict(summary_rows(figures, 1000.0), "coupled", 100).word == OK
    assert run_verdict(summary_rows(figures | {"candidates_max": 0.0}, 1e3), "coupled", 100).word == UNTOUCHED


@pytest.mark.parametrize(("stuck", "mostly"), [(0.0, False), (3.0, False), (50.0, False), (51.0, True), (100.0, True)])
def test_a_run_of_which_most_ticks_are_stuck_says_so(stuck: float, mostly: bool) -> None:
    found = run_verdict(summary_rows(SOUND | FREE | {"stuck_ticks": stuck}, 1000.0), "coupled", 100)
    assert found.mostly_stuck == mostly
    assert ("More than half of the ticks are stuck" in found.line) == mostly
    assert not mostly or found.word == MISSED
