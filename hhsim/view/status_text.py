"""Words for how a tick ended."""

from hhsim.kernels.tick import state

SETTLED = "settled"
WORDS = (
    (state.STATUS_CAPACITY_EXCEEDED, "full"),
    (state.STATUS_STUCK, "stuck"),
    (state.STATUS_LAG, "lag"),
    (state.STATUS_INPUT_INVALID, "input held"),
    (state.STATUS_ABDUCTION_HELD, "abduction held"),
    (state.STATUS_START_INSIDE, "began inside"),
)


def status_words(status: int) -> str:
    """Return the most urgent of a tick's status bits in words; `SETTLED` where none is set."""
    return next((words for bit, words in WORDS if status & bit), SETTLED)
