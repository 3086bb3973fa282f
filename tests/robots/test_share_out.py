"""Numbers of spheres against errors of a closed form: none of equal sum has a smaller largest error."""

from collections.abc import Mapping
from itertools import product

import pytest

from hhsim.robots.share_out import best_shares, share_out

SIZES = {"trunk": 0.4, "arm": 0.1, "finger": 0.02}


def error_of(name: str, count: int) -> float:
    return float(SIZES[name] * count**-0.6)


@pytest.mark.parametrize("total", [3, 7, 24, 60])
def test_no_other_numbers_have_a_smaller_largest_error(total: int) -> None:
    tries: list[Mapping[str, int]] = []

    def measure(shares: Mapping[str, int]) -> dict[str, float]:
        tries.append(shares)
        return {name: error_of(name, count) for name, count in shares.items()}

    def rough(shares: Mapping[str, int]) -> dict[str, float]:
        return {name: error_of(name, count) * (1.3 if name == "arm" else 1.1) for name, count in shares.items()}

    shares = best_shares(share_out(list(SIZES), total, rough, measure), total)
    assert sum(shares.values()) <= total and min(shares.values()) >= 1
    largest = max(error_of(name, count) for name, count in shares.items())
    every = (counts for counts in product(range(1, total - 1), repeat=3) if sum(counts) == total)
    best = min(max(error_of(name, count) for name, count in zip(SIZES, counts)) for counts in every)
    assert largest <= best * 1.05
    assert len(tries) <= 3, "each is a build of all links"


def test_errors_that_rise_with_a_sphere_more_take_the_better_of_those_tried() -> None:
    wave = {1: 1.0, 2: 0.5, 3: 0.55, 4: 0.54}
    shares = best_shares({"one": wave, "other": {1: 0.1, 2: 0.2}}, 6)
    assert shares == {"one": 2, "other": 1}
