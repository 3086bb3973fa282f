"""Numbers of spheres of links that together have so many, such that the largest error is as small as it can be."""

import math
from collections.abc import Callable, Mapping, Sequence

ROUNDS = 2
USUAL_SLOPE = 2.0 / 3.0
"""Power of the number of spheres with which an error falls, where two numbers do not tell."""
SLOPES = (0.2, 2.0)

Errors = dict[str, dict[int, float]]
"""Error [m] by number of spheres, by link."""
Measure = Callable[[Mapping[str, int]], Mapping[str, float]]
"""Errors [m] of so many spheres of links, by their names."""


def share_out(names: Sequence[str], total: int, rough: Measure, measure: Measure) -> Errors:
    """Try numbers of spheres, each time with the errors of all before, and return those errors.

    Args:
        names: Links; each gets at least one sphere.
        total: Number of all spheres, at least as many as links.
        rough: Returns larger errors, but soon: they tell which numbers are tried first.
        measure: Builds so many spheres for each link that it is given, and returns their errors.
    """
    guess, errors = ({name: dict[int, float]() for name in names} for _ in range(2))
    even = {name: total // len(names) + (k < total % len(names)) for k, name in enumerate(names)}
    for shares in (dict.fromkeys(names, 1), even):
        _add(guess, shares, rough)
    _balance(guess, total, rough)
    _add(errors, _balanced(guess, total), measure)
    _balance(errors, total, measure)
    return errors


def best_shares(errors: Errors, total: int) -> dict[str, int]:
    """Return the numbers, of those that were tried, with the least largest error; at most `total` together.

    What is left over goes where the error is largest.
    """
    shares: dict[str, int] = {}
    for level in sorted({error for tried in errors.values() for error in tried.values()}):
        needed = {
            name: min((count for count, error in tried.items() if error <= level), default=0)
            for name, tried in errors.items()
        }
        if all(needed.values()) and sum(needed.values()) <= total:
            shares = needed
            break
    for name in sorted(errors, key=lambda name: (-errors[name][shares[name]], name)):
        most = shares[name] + total - sum(shares.values())
        better = [count for count in errors[name] if count <= most]
        shares[name] = min(better, key=lambda count: (errors[name][count], count))
    return shares


def _balance(errors: Errors, total: int, measure: Measure) -> None:
    for _ in range(ROUNDS):
        _add(errors, _balanced(errors, total), measure)


def _add(errors: Errors, shares: Mapping[str, int], measure: Measure) -> None:
    wanted = {name: count for name, count in shares.items() if count not in errors[name]}
    for name, error in measure(wanted).items() if wanted else ():
        errors[name][wanted[name]] = error


def _balanced(errors: Errors, total: int) -> dict[str, int]:
    """Return numbers, `total` together, whose errors are as equal as what was tried foretells."""
    low, high = 1e-9, max(error for tried in errors.values() for error in tried.values()) + 1e-9
    for _ in range(60):
        middle = math.sqrt(low * high)
        if sum(_needed(tried, middle, total) for tried in errors.values()) > total:
            low = middle
        else:
            high = middle
    shares = {name: _needed(tried, high, total) for name, tried in errors.items()}
    while (left := total - sum(shares.values())) > 0:
        worst = sorted(shares, key=lambda name: (-_foretold(errors[name], shares[name]), name))
        for name in worst[:left]:
            shares[name] += 1
    return shares


def _needed(tried: Mapping[int, float], error: float, most: int) -> int:
    """Return the fewest spheres that are foretold to have an error."""
    least, greatest = 1, most
    while least < greatest:
        middle = (least + greatest) // 2
        if _foretold(tried, middle) <= error:
            greatest = middle
        else:
            least = middle + 1
    return least


def _foretold(tried: Mapping[int, float], count: int) -> float:
    """Return the error of so many spheres, by the power law through the two numbers nearest to it."""
    if count in tried:
        return tried[count]
    near = sorted(tried, key=lambda known: (abs(math.log(known / count)), known))[:2]
    slope = USUAL_SLOPE
    if len(near) == 2 and tried[near[0]] > 0.0 and tried[near[1]] > 0.0:
        slope = math.log(tried[near[0]] / tried[near[1]]) / math.log(near[1] / near[0])
        slope = min(max(slope, SLOPES[0]), SLOPES[1])
    return float(tried[near[0]] * (near[0] / count) ** slope)
