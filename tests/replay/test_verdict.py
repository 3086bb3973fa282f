"""The verdict on a run: its word, what it rests on, and what to do where nothing touched."""

import math
from typing import Any

import pytest

from hhsim.metrics.run.registry import run_metrics
from hhsim.replay.summary_table import stored_promises, summary_rows
from hhsim.replay.verdict import EMPTY, LATE, MISSED, NOT_JUDGED, OK, SHORT, UNTOUCHED, run_verdict
from hhsim.solver.method import METHODS, PROMISES

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
