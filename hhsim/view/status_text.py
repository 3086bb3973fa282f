"""How a tick ended, in words."""

from hhsim.kernels.tick.state import (
    STATUS_ABDUCTION_HELD,
    STATUS_CAPACITY_EXCEEDED,
    STATUS_INPUT_INVALID,
    STATUS_LAG,
    STATUS_START_INSIDE,
    STATUS_STUCK,
)

SETTLED = "settled"
WORDS = (
    (STATUS_CAPACITY_EXCEEDED, "full"),
    (STATUS_STUCK, "stuck"),
    (STATUS_LAG, "lag"),
    (STATUS_INPUT_INVALID, "input held"),
    (STATUS_ABDUCTION_HELD, "abduction held"),
    (STATUS_START_INSIDE, "began inside"),
)
"""Of the status bits, the most urgent first."""


def status_words(status: int) -> str:
    """The most urgent of a tick's status bits in words; `SETTLED` where none is set."""
    return next((words for bit, words in WORDS if status & bit), SETTLED)
