"""What is found when a glove's samples are looked at, in words; `hhsim.kernels.live.plausibility` looks."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.live.notes import JUMP_FOLLOWED, JUMPED, JUMPED_BACK, MOVES_AGAIN, STUCK
from hhsim.kernels.live.plausibility import MOST_ANGLE, TRUST, WATCH, begin_watch
from hhsim.live.device import GloveInfo
from hhsim.result.schema import INFORMATION, WARNING
from hhsim.solver.workspace import zeroed
from hhsim.system.counted import counted

MOST_READING = 1.5
"""Of a channel that is 0 to 1."""
NAMES = ("thumb", "index finger", "middle finger", "ring finger", "little finger")


class GloveWatch:
    """What is known of one glove's samples.

    Args:
        info: Of the glove.

    Attributes:
        state: Of `WATCH`, shape (1,).
        at: Its one record.
        free: 1 for fingers on which nothing may push, shape (5,).
    """

    def __init__(self, info: GloveInfo) -> None:
        """Nothing is seen yet."""
        self.state = zeroed(WATCH)
        self.at: Any = self.state[0]
        self.at.always_free[list(info.kept_free)] = 1
        self.at.noiseless = info.noiseless
        begin_watch(self.at)
        self.free: NDArray[np.int64] = self.state["free"][0]


def doubts(info: GloveInfo) -> list[str]:
    """What is doubtful of a glove before its first sample, a line each."""
    useless = (f"{NAMES[finger]}: its bend says too little to push on; it is kept free" for finger in info.kept_free)
    return [*info.doubtful, *useless]


def found_in_sample(code: int, place: int, count: int, value: float) -> tuple[int, str]:
    """Level and text of a note of `use_sample`."""
    finger = NAMES[place]
    if code == JUMPED:
        more = f"; {counted(count, 'more jump')} since the last one told" if count else ""
        jumped = f"{finger} jumped by {math.degrees(value):.0f}° in one sample"
        return WARNING, f"{jumped}: not believed until it stays, and kept free{more}"
    if code == STUCK:
        others = f"{NAMES[count // 8]} and {NAMES[count % 8]}"
        still = f"{finger} has not changed by one bit in {value:.1f} s in which {others} moved"
        return WARNING, f"{still}: is its sensor stuck? It is kept free"
    texts = {
        JUMPED_BACK: "came back from its jump",
        JUMP_FOLLOWED: "stays where it jumped to, and is followed",
        MOVES_AGAIN: "moves again",
    }
    return INFORMATION, f"{finger} {texts[code]}: kept free until it was plausible for {TRUST:g} s"


def reading_of_no_hand(sample: Any, info: GloveInfo, known: NDArray[np.bool_]) -> str:
    """Name and value of the channel that is no number, else of the one farthest beyond any hand, as the glove sent it.

    Args:
        sample: With its `channels`.
        info: Of the glove.
        known: Channels that the last usable sample had, shape (n,): what a glove never sends is no fault.

    Returns:
        For the log; "" where no channel is such.
    """
    values = np.abs(sample["channels"][: len(info.channels)])
    most = {"": MOST_READING, "rad": MOST_ANGLE}.get(info.unit, np.inf)
    unit = f" {info.unit}" if info.unit else ""
    bad = np.flatnonzero(~np.isfinite(values[: known.size]) & known[: values.size])
    if bad.size:
        return f"{info.channels[bad[0]]} is {sample['channels'][bad[0]]}"
    # NaN compares false: a channel that a glove does not have is NaN too.
    if not (values > most).any():
        return ""
    channel = int(np.nanargmax(values))
    degrees = ": are the angles in degrees?" if info.unit == "rad" and values[channel] <= 360.0 else ""
    return (
        f"{info.channels[channel]} is {sample['channels'][channel]:.4g}{unit}, "
        f"and {most:.3g}{unit} the most of a hand{degrees}"
    )
