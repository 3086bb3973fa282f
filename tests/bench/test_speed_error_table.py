"""The frontier against every pair of points."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hhsim.bench.speed_error_table import frontier

coordinate = st.one_of(st.integers(0, 5).map(float), st.floats(allow_nan=True, allow_infinity=True))


@given(st.lists(st.tuples(coordinate, coordinate), max_size=30))
def test_it_holds_exactly_what_no_other_point_beats(points: list[tuple[float, float]]) -> None:
    found = frontier([x for x, _ in points], [y for _, y in points])
    values = [points[i] for i in found]
    assert values == sorted(values)
    assert len(set(values)) == len(values)
    whole = [p for p in points if not (np.isnan(p[0]) or np.isnan(p[1]))]
    unbeaten = {(x, y) for x, y in whole if not any(a <= x and b <= y and (a < x or b < y) for a, b in whole)}
    assert set(values) == unbeaten


def test_of_equal_points_the_first_counts() -> None:
    assert frontier([1.0, 1.0, 2.0], [3.0, 3.0, 3.0]).tolist() == [0]


def test_a_gain_keeps_hair_breadths_off() -> None:
    time, error = [1.0, 2.0, 3.0, 4.0], [1.0, 0.96, 0.91, 0.5]
    assert frontier(time, error).tolist() == [0, 1, 2, 3]
    assert frontier(time, error, 0.05).tolist() == [0, 2, 3]
    assert frontier([1.0, 2.0], [0.0, 0.0], 0.05).tolist() == [0]


@pytest.mark.parametrize("values", [[], [np.nan]])
def test_nothing_has_no_frontier(values: list[float]) -> None:
    assert frontier(values, values).size == 0
