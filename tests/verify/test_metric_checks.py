"""What the referee says of a stored figure that is not that of the ticks."""

import math

import pytest

from hhsim.verify.claim import told_apart


@pytest.mark.parametrize(
    ("stored", "own", "told"),
    [
        (1.0, 1.20323, ("1", "1.20323")),
        (0.0014028467, 0.0014028469, ("0.0014028467", "0.0014028469")),
        (1.0, math.nextafter(1.0, 2.0), ("1", "1.0000000000000002")),
        (math.nan, 0.5, ("nan", "0.5")),
    ],
)
def test_two_figures_that_differ_read_as_two(stored: float, own: float, told: tuple[str, str]) -> None:
    assert told_apart(stored, own) == told
