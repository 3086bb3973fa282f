"""The limit of a sample's age is set beside the glove's own rate, and not beside that of the loop."""

import numpy as np
import pytest

from hhsim.live.loop.sample_interval import SampleInterval


def glove(rate: float, seconds: float = 10.0) -> SampleInterval:
    interval = SampleInterval()
    jitter = np.random.default_rng(0).normal(0.0, 0.1 / rate, round(rate * seconds))
    for i, late in enumerate(jitter):
        interval.add(round(1e9 * (i / rate + late)))
    return interval


@pytest.mark.parametrize("rate", [30.0, 60.0, 90.0, 200.0])
def test_the_usual_interval_is_that_of_the_glove(rate: float) -> None:
    assert glove(rate).usual_ns == pytest.approx(1e9 / rate, rel=0.15)


def test_a_pause_is_one_interval_and_what_comes_at_once_is_none() -> None:
    interval = glove(90.0)
    before = interval.usual_ns
    interval.add(20_000_000_000)
    interval.add(20_000_000_000)
    assert interval.usual_ns == pytest.approx(before, rel=0.06)


def test_a_limit_that_one_lost_sample_exceeds_is_named_with_one_that_fits() -> None:
    assert glove(90.0).hint(0.025) == glove(200.0).hint(0.025) == SampleInterval().hint(0.025) == ""
    interval = SampleInterval()
    for i in range(5):
        interval.add(i * 16_666_667)
    assert interval.hint(0.025) == (
        "; samples come 60 times a second, so that one that is lost frees the fingers: --stale 42 would let it pass"
    )
    assert interval.hint(0.042) == ""
