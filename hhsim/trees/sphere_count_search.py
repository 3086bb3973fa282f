"""Search for the fewest spheres with which a cover is within an error."""

import math
from collections.abc import Callable

from hhsim.errors import InputError
from hhsim.trees.level_cover import LevelCover

NEAR = 0.95
"""The search ends when this share of the spheres, or more, was tried and is not enough."""
PROBES, PROBED = (0.93, 0.9), 1024
"""Further shares to try, up to so many spheres: small covers are cheap, and their errors vary more."""

_FIRST = 64
_GROWTH = 8.0
_USUAL_SLOPE = 2.0 / 3.0
_SLOPES = (0.4, 1.2)
_SPARE = 1.01
_HOPELESS = 2.0
_SURE_FROM = 512


def find_fewest(build: Callable[[int], LevelCover], max_error: float, most: int) -> LevelCover:
    """Find the cover with the fewest spheres, up to `most`, whose bound and gap are within an error [m].

    The number is guessed by an error that falls with a power of it, until it is enclosed: one cover is within the
    error, and one with at least `NEAR` of its spheres, or one less, is not; up to `PROBED` spheres those of `PROBES`
    are not either. An error does not fall with every single sphere, so a number in between or below may do by luck.

    Raises:
        InputError: `most` spheres are too few, or would be by far.
    """
    error: dict[int, float] = {}
    found: LevelCover | None = None
    high = most + 1
    wanted = min(_FIRST, most)
    while True:
        cover = build(wanted)
        error[wanted] = max(cover.bound, cover.gap)
        if error[wanted] <= max_error:
            high, found = wanted, cover
        low = max([count for count in error if count < high and error[count] > max_error], default=0)
        if found is not None and (high - low <= 1 or low >= NEAR * high):
            probes = [math.floor(share * high) for share in PROBES] if high <= PROBED else []
            probes = [probe for probe in probes if probe > 0 and probe not in error]
            if not probes:
                return found
            wanted = probes[0]
            continue
        guess = _guess(error, max_error)
        if found is None and (low >= most or (low >= min(_SURE_FROM, most) and guess > _HOPELESS * most)):
            tried = f"{low:,} are off by up to {1e3 * error[low]:.3g} mm, and about {guess:.2g} would be needed"
            raise InputError(f"no cover of up to {most:,} spheres is within {1e3 * max_error:g} mm: {tried}")
        if found is None:
            wanted = max(low + 1, min(math.ceil(min(_SPARE * guess, _GROWTH * low)), most))
        else:
            # Just below what is sure to be enough, once the guess is there: if that is not, the search ends.
            guess = min(_SPARE * guess, NEAR * high)
            if len(error) % 6 == 0:
                guess = math.sqrt(max(low, 1) * high)
            wanted = min(max(math.ceil(guess), low + 1), high - 1)


def _guess(error: dict[int, float], max_error: float) -> float:
    """Number of spheres that has an error, by the power law through the two tries nearest to it."""
    near = sorted(error, key=lambda count: (abs(math.log(max(error[count], 1e-300) / max_error)), count))[:2]
    slope = _USUAL_SLOPE
    if len(near) == 2 and error[near[0]] != error[near[1]]:
        change = math.log(max(error[near[0]], 1e-300) / max(error[near[1]], 1e-300))
        slope = min(max(change / math.log(near[1] / near[0]), _SLOPES[0]), _SLOPES[1])
    return float(near[0] * min((error[near[0]] / max_error) ** (1.0 / slope), 1e12))
