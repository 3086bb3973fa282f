"""Why the fingers are free, in words for people."""

from hhsim.live.live_records import Safety

WORDS = {
    Safety.STALE_INPUT: "no fresh input",
    Safety.NOT_FINITE: "input that is no number",
    Safety.SOLVER_FAILED: "the solver failed",
    Safety.OVERRUN_STREAK: "too many late ticks in a row",
    Safety.DEVICE_LOST: "the glove is gone",
    Safety.STOPPING: "stopping",
    Safety.NO_GUARDIAN: "no guardian",
    Safety.DRY_RUN: "dry run: nothing is sent",
    Safety.NO_INPUT_YET: "no input yet",
}

HELD = "held where they touch"


def why_free(bits: int) -> str:
    """What keeps the fingers free, reasons with commas between; "" where nothing does."""
    known = [words for why, words in WORDS.items() if bits & why]
    unknown = bits & ~sum(int(why) for why in WORDS)
    return ", ".join([*known, *([f"reason {unknown}"] if unknown else [])])


def why_free_or_held(bits: int) -> str:
    """As `why_free`, and `HELD` where nothing keeps the fingers free."""
    return why_free(bits) or HELD
