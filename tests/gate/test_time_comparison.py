"""The gate's statistic, against exact arithmetic; no clock is read."""

import math
from fractions import Fraction
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hhsim.errors import InputError
from hhsim.gate import run as gate_run
from hhsim.gate.suite import GateScene
from hhsim.gate.verdict import judge_time

times = st.lists(st.integers(1, 10**6).map(float), min_size=3, max_size=9)


@given(times, times)
def test_the_verdict_is_that_of_exact_arithmetic(base: list[float], head: list[float]) -> None:
    def median(values: list[float]) -> Fraction:
        ordered, half = sorted(Fraction(value) for value in values), len(values) // 2
        return ordered[half] if len(values) % 2 else (ordered[half - 1] + ordered[half]) / 2

    found = judge_time("tiny", head, base, 0.25)
    ratio = median(head) / median(base)
    assert found.head / found.base == pytest.approx(float(ratio))
    assert found.limit == 1.25 * found.base and found.reason.startswith(f"{100 * (float(ratio) - 1):+.1f} %")
    if ratio not in (Fraction(5, 4), Fraction(4, 5)):
        expected = "worse" if ratio > Fraction(5, 4) else "better" if ratio < Fraction(4, 5) else "within noise"
        assert found.verdict == expected


def test_the_wider_side_is_told() -> None:
    found = judge_time("tiny", [1.0, 1.0, 1.1], [2.0, 2.0, 2.0], 0.25)
    assert found.reason == "-50.0 %, processes of a side within 10 %"


@pytest.mark.parametrize("wrong", [[1.0, 1.0, 0.0], [1.0, 1.0, math.nan]])
def test_times_that_say_nothing_are_refused(wrong: list[float]) -> None:
    with pytest.raises(InputError, match="base"):
        judge_time("tiny", [1.0, 1.0, 1.0], wrong, 0.05)


def test_a_steady_drift_favours_neither_side(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = iter(range(8))
    monkeypatch.setattr(gate_run, "measured", lambda *_: next(clock))
    sides = [gate_run.Side(name, Path(), "", "") for name in ("head", "base")]
    scene = GateScene(name="tiny", object="cube", trajectory="pinch")
    head, base = gate_run.process_times(scene, Path(), *sides, 4, lambda _: None)
    assert sum(head) == sum(base) == 14
