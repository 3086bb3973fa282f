"""Hand files as text: what `hhsim.hand.model.HandModel.from_toml` reads."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

DIGITS = 6
"""Decimals of a length in [m]: a micrometre."""


def format_hand_file(
    hand_length: float, hand_breadth: float, fingers: Mapping[str, Mapping[str, ArrayLike]], remark: str = ""
) -> str:
    """Return the text of a hand file, with a remark in the first line; lengths in m.

    `fingers` has the non-default sizes of each finger by the keys of a hand file, in a right hand's palm frame.
    """
    lines = [f"# {' '.join(remark.split())}"] if remark else []
    lines += [f"hand_length = {_number(hand_length)}", f"hand_breadth = {_number(hand_breadth)}"]
    for finger, sizes in fingers.items():
        lines += ["", f"[{finger}]"]
        for key, value in sizes.items():
            array = np.asarray(value, dtype=np.float64)
            numbers = ", ".join(_number(x) for x in array.ravel())
            lines.append(f"{key} = [{numbers}]" if array.ndim else f"{key} = {numbers}")
    return "\n".join(lines) + "\n"


def _number(value: float) -> str:
    # No negative zero, and always a point: an integer is read as well, but looks like a count.
    return repr(round(float(value), DIGITS) + 0.0)
