"""Hand files: what is written is the hand that is read."""

from pathlib import Path

import numpy as np

from hhsim.hand.fingers import FINGERS
from hhsim.hand.hand_file import format_hand_file
from hhsim.hand.model import HandModel


def test_a_hand_is_read_as_it_was_written(tmp_path: Path) -> None:
    hand = HandModel.default(hand_length=0.175)
    keys = ("base", "distal", "dorsal", "length", "radius", "flexion_min", "abduction_max")
    fingers = {finger: {key: getattr(hand, key)[f] for key in keys} for f, finger in enumerate(FINGERS)}
    text = format_hand_file(hand.hand_length, hand.hand_breadth, fingers, "a remark\nof two lines")
    assert text.startswith("# a remark of two lines\nhand_length = 0.175\n") and text.isascii()
    path = tmp_path / "hand.toml"
    path.write_text(text)
    again = HandModel.from_toml(path)
    for key in keys:
        assert np.abs(getattr(again, key) - getattr(hand, key)).max() < 1e-6, key
    assert again.hand_breadth == round(hand.hand_breadth, 6)
