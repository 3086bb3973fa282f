"""How a tick ended, in words."""

from hhsim.kernels.tick.state import (
    STATUS_ABDUCTION_HELD,
    STATUS_FULL,
    STATUS_HELD,
    STATUS_LAG,
    STATUS_START_INSIDE,
    STATUS_STUCK,
)

SETTLED = "settled"
WORDS = (
    (STATUS_FULL, "full"),
    (STATUS_STUCK, "stuck"),
    (STATUS_LAG, "lag"),
    (STATUS_HELD, "input held"),
    (STATUS_ABDUCTION_HELD, "abduction held"),
    (STATUS_START_INSIDE, "began inside"),
)
"""Of the status bits, the most urgent first."""


def status_words(status: int) -> str:
    """The most urgent of a tick's status bits in words; `SETTLED` where none is set."""
    return next((words for bit, words in WORDS if status & bit), SETTLED)
