"""Known answers: what is quick to play holds, and a wrong one would not."""

import numpy as np
import pytest
from sampled import sampled

from hhsim.bench.manipulation_stage import Pinch, clearance, gripped
from hhsim.bench.suites.manipulation import CASES, Manipulation, answer
from hhsim.errors import InputError, UnknownNameError

SHORT = Manipulation.planned(rest=1.0, held=2.0)


@pytest.mark.parametrize("case", sampled(CASES, lambda _, case: case in ("slope", "tipping", "rest")))
def test_what_is_known_holds(case: str) -> None:
    answers = CASES[case](SHORT)
    assert answers and not SHORT.missed(answers)


@pytest.mark.parametrize(("measured", "holds"), [(1.005, 1), (0.98, 0), (float("nan"), 0)])
def test_an_answer_that_is_off_or_unknown_does_not_hold(measured: float, holds: int) -> None:
    row = answer("a", "b", "m", 1.0, measured, 0.01)
    assert row["holds"] == holds and row["off"] == pytest.approx(measured - 1.0, nan_ok=True)


def test_a_pinch_holds_and_its_fingers_never_enter() -> None:
    pinch = Pinch(squeeze=1.5 * Pinch().threshold, hold=1.0)
    played = gripped(pinch)
    assert clearance(played, pinch).min() >= 0.0
    normal = 0.5 * played.of_hand(played.normal_force)
    assert normal[-1] == pytest.approx(pinch.squeeze, rel=0.01)
    assert played.hand_wrench[-1, 2] == pytest.approx(0.981, rel=1e-3)
    assert np.abs(played.table_wrench[-1]).max() == 0.0


def test_a_missed_answer_is_named() -> None:
    rows = [answer("a", "b", "m", 1.0, measured) for measured in (1.0, 2.0)]
    assert SHORT.missed(rows) == ["a, b"]


@pytest.mark.parametrize(
    ("named", "error"),
    [({"cases": ("slop",)}, UnknownNameError), ({"rest": 0.0}, InputError), ({"held": np.nan}, InputError)],
)
def test_what_cannot_be_played_is_refused(named: dict[str, object], error: type[Exception]) -> None:
    with pytest.raises(error):
        Manipulation.planned(**named)
