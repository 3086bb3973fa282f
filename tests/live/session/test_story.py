"""The limit of a sample's age is set beside the glove's own rate, and not beside that of the loop."""

from itertools import pairwise

import numpy as np

from hhsim.kernels.live.tick import usual_interval
from hhsim.live.session.story import interval_hint


def usual(times: list[int]) -> float:
    found = 0.0
    for before, after in pairwise(times):
        found = float(usual_interval(found, after - before))
    return found


def glove(rate: float, *more: int) -> float:
    """The usual interval of a glove that was seen for 10 s, and whose samples then came at `more` [ns]."""
    jitter = np.random.default_rng(0).normal(0.0, 0.1 / rate, round(rate * 10.0))
    return usual([*(round(1e9 * (i / rate + late)) for i, late in enumerate(jitter)), *more])


def test_a_limit_that_one_lost_sample_exceeds_is_named_with_one_that_fits() -> None:
    assert interval_hint(glove(90.0), 0.025) == interval_hint(glove(200.0), 0.025) == interval_hint(0.0, 0.025) == ""
    slow = usual([i * 16_666_667 for i in range(5)])
    assert interval_hint(slow, 0.025) == (
        "; samples come 60 times a second, so that one that is lost frees the fingers: --stale 42 would let it pass"
    )
    assert interval_hint(slow, 0.042) == ""
