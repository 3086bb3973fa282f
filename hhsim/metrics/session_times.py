"""What is measured of a live session's times: how late its loop woke, from sample to command, the solver's tick."""

from hhsim.metrics.run_metric import Figure
from hhsim.result.miss_cause import WORDS

_TIMES = {
    "wakeup": "wake-up after the deadline",
    "latency": "sample in to command out",
    "tick": "the solver's tick, wall",
}
_PERCENTILES = {"p50": "p50", "p99": "p99", "p999": "p99.9", "max": "max"}

MISSED_BY: tuple[Figure, ...] = tuple(
    Figure(f"missed_{cause.name.lower()}", f"missed: {words}") for cause, words in WORDS.items()
)
"""The missed ticks by who took their time; in the /summary of sessions since that is known."""

SESSION_TIMES: tuple[Figure, ...] = (
    Figure("missed", "missed ticks"),
    *(
        Figure(f"{name}_{part}", f"{label}, {words}", 1, "µs")
        for name, label in _TIMES.items()
        for part, words in _PERCENTILES.items()
    ),
)
"""In the order of the session's table; in its /summary by these names, SI units."""
