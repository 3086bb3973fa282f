"""The search for the fewest spheres, on errors by formula: it ends where it says, after few tries."""

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from hhsim.trees.builder import NEAR, PROBED, PROBES, find_fewest
from hhsim.trees.sphere_tree import LevelCover


class Builder:
    """Makes covers of one sphere that stands for many, off by scale · n ** −slope and some noise."""

    def __init__(self, scale: float, slope: float, noise: float = 0.0, gap: float = 0.0) -> None:
        self.scale, self.slope, self.noise, self.gap = scale, slope, noise, gap
        self.tried: list[int] = []

    def error(self, count: int) -> float:
        noise = self.noise * float(np.random.default_rng(count).normal())
        return float(self.scale * count**-self.slope * np.exp(noise))

    def __call__(self, count: int) -> LevelCover:
        self.tried.append(count)
        radius = np.zeros(count)
        radius[0] = self.error(count)
        return LevelCover(np.zeros((count, 3)), radius, np.zeros(count), self.gap * radius[0], np.zeros(1, np.int32))


@given(
    st.floats(0.3, 30.0), st.floats(0.45, 1.1), st.sampled_from([0.0, 0.01, 0.03]), st.floats(0.0, 1.0), st.integers(0)
)
def test_the_end_is_enclosed(scale: float, slope: float, noise: float, gap: float, seed: int) -> None:
    build = Builder(scale, slope, noise, gap)
    most = 20_000
    wanted = build.error(1 + seed % 10_000)
    found = len(find_fewest(build, wanted, most).radius)
    assert build.error(found) <= wanted
    below = [count for count in build.tried if count < found and build.error(count) > wanted]
    assert found == 1 or max(below) >= min(NEAR * found, found - 1)
    if found <= PROBED:
        probes = [math.floor(share * found) for share in PROBES]
        assert all(probe == 0 or build.error(probe) > wanted for probe in probes)
    assert len(build.tried) == len(set(build.tried)) <= 30
    # A better builder begins below what was found, and ends where one sphere less, or some hundredths, are too few.
    better = Builder(0.85 * scale, slope, noise, gap)
    if found > 1:
        fewer = len(find_fewest(better, wanted, 64, build(found)).radius)
        assert fewer <= found and (fewer == found or better.error(fewer) <= wanted)
        below = [count for count in better.tried if count < fewer and better.error(count) > wanted]
        assert fewer == 1 or max(below) >= min(NEAR * fewer, fewer - 1, 64)
        assert len(better.tried) <= 12 and max(better.tried) <= 64
