"""Percentiles in flat memory, against numpy's."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hhsim.system.log_histogram import LogHistogram


@given(st.integers(0, 2**32 - 1), st.integers(1, 4000), st.floats(0.0, 3.0))
@settings(max_examples=40)
def test_percentiles_are_those_of_numpy_to_a_thousandth(seed: int, count: int, spread: float) -> None:
    values = np.exp(np.random.default_rng(seed).normal(11.0, spread, count)).astype(np.int64) + 1
    histogram = LogHistogram()
    for block in np.array_split(values, 3):
        histogram.add(block)
    assert histogram.count == count
    assert histogram.largest == values.max()
    for percent in (1.0, 50.0, 99.0, 100.0):
        expected = np.percentile(values, percent, method="inverted_cdf")
        assert histogram.percentile(percent) == pytest.approx(expected, rel=1.001e-3)


def test_nothing_has_no_percentile_and_what_is_off_the_scale_is_kept_at_its_end() -> None:
    histogram = LogHistogram()
    histogram.add([])
    assert np.isnan(histogram.percentile(50.0)) and np.isnan(histogram.largest)
    histogram.add([0.0, 1e300])
    assert histogram.percentile(50.0) == pytest.approx(1.0, rel=1.001e-3)
    assert histogram.largest == 1e300
