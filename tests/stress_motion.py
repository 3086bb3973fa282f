"""The motion of a stress test, so short that it fits into memory."""

from typing import Any

from hhsim.bench.robustness.random_targets import RandomTargets, StressOptions
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel


def random_targets(
    hand: HandModel, ticks: int, seed: int, options: StressOptions | None = None, **around: Any
) -> HandConfiguration:
    """The first `ticks` ticks of `RandomTargets`, around a centre and from a height where they are given."""
    return RandomTargets(hand, seed, options, **around).take(ticks)
