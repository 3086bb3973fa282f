"""Times of a live session: wake-up, latency and the solver's tick."""

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
"""Missed ticks by cause; in the /summary of sessions that know them."""

SESSION_TIMES: tuple[Figure, ...] = (
    Figure("missed", "missed ticks"),
    *(
        Figure(f"{name}_{part}", f"{label}, {words}", 1, "µs")
        for name, label in _TIMES.items()
        for part, words in _PERCENTILES.items()
    ),
)
"""Figures in the order of the session's table and, in SI units, of its /summary."""
