"""What the usual distance of a glove's samples says of the limit of their age."""

LOST = 1
"""Samples in a row that a link may lose without a word; the next one is then this many intervals late, and one more."""


def interval_hint(usual_ns: float, stale: float) -> str:
    """Which limit of age fits a glove's own rate.

    Args:
        usual_ns: Running median of its intervals [ns], 0 where it is not known.
        stale: The limit [s].

    Returns:
        For the log; "" where one lost sample is not too old for `stale`.
    """
    needed = (LOST + 1.5) * 1e-9 * usual_ns
    if stale >= (LOST + 1) * 1e-9 * usual_ns:
        return ""
    return (
        f"; samples come {1e9 / usual_ns:.0f} times a second, so that one that is lost frees the fingers: "
        f"--stale {1e3 * needed:.0f} would let it pass"
    )
