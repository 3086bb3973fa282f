"""Codes of what touches in /contact."""

import numpy as np

from hhsim.result.body import contact_names, pair_codes


def test_a_contact_of_the_first_body_is_named_by_hand_and_body() -> None:
    # The first phalanx of either hand, a palm, the table, and another body.
    touching = np.array([0, 16, 31, -1, -3])
    names = contact_names(("right", "left"), ("cup", "plate", "spoon"))
    codes = pair_codes(touching, 2)
    assert [(names[a], names[b]) for a, b in zip(codes["a"], codes["b"])] == [
        ("right/thumb/proximal", "cup"),
        ("left/thumb/proximal", "cup"),
        ("left/palm", "cup"),
        ("cup", "table"),
        ("cup", "plate"),
    ]
