"""Reasons of free fingers in a live session."""

from collections.abc import Callable
from enum import IntFlag


class Safety(IntFlag):
    """Flags: reasons of free fingers (stiffness 0) in a tick; 0 for none."""

    STALE_INPUT = 1
    NOT_FINITE = 2
    SOLVER_FAILED = 4
    OVERRUN_STREAK = 8
    DEVICE_LOST = 16
    STOPPING = 32
    NO_WATCHDOG = 64
    DRY_RUN = 128
    NO_INPUT_YET = 256
    OTHER_HAND = 512


def free_counts(count: Callable[[Safety], int]) -> dict[str, int]:
    """Return the number of ticks kept free by the name of each reason; the other hand's if there was any."""
    counts = {why: count(why) for why in Safety}
    return {str(why.name): ticks for why, ticks in counts.items() if ticks or why != Safety.OTHER_HAND}


WORDS = {
    Safety.STALE_INPUT: "no fresh input",
    Safety.NOT_FINITE: "a sample that cannot be used",
    Safety.SOLVER_FAILED: "the solver failed",
    Safety.OVERRUN_STREAK: "too many late ticks in a row",
    Safety.DEVICE_LOST: "the glove is gone",
    Safety.STOPPING: "stopping",
    Safety.NO_WATCHDOG: "no watchdog that reaches the glove",
    Safety.DRY_RUN: "dry run: nothing is sent",
    Safety.NO_INPUT_YET: "no input yet",
    Safety.OTHER_HAND: "a fault of the other hand",
}

AFTER_STALL = {
    "release": "every finger is freed at once",
    "ease": "it falls to nothing within 0.1 s",
    "hold": "it stays as it was",
}
"""Choices for the stiffness after too many missed periods, the default first."""

HELD = "held where they touch"


def why_free(bits: int) -> str:
    """Reasons of free fingers in words, with commas between; "" for none."""
    known = [words for why, words in WORDS.items() if bits & why]
    unknown = bits & ~sum(int(why) for why in WORDS)
    return ", ".join([*known, *([f"reason {unknown}"] if unknown else [])])


def why_free_or_held(bits: int) -> str:
    """Reasons of free fingers in words; `HELD` for none."""
    return why_free(bits) or HELD
