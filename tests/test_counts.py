"""Texts that hold a count: one of a thing is not its plural."""

import pytest

from hhsim.system.counted import counted


@pytest.mark.parametrize(
    ("count", "noun", "text"),
    [
        (0, "tick", "0 ticks"),
        (1, "picture", "1 picture"),
        (2, "more jump", "2 more jumps"),
        (1, "leaf", "1 leaf"),
        (3000, "leaf", "3,000 leaves"),
        (2, "vertex", "2 vertices"),
    ],
)
def test_one_of_a_thing_is_told_in_the_singular(count: int, noun: str, text: str) -> None:
    assert counted(count, noun) == text
