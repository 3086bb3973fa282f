"""LZ-string's base64, against its own words and against a packer written from its description."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from lz_pack import pack

from hhsim.errors import TrajectoryError
from hhsim.recordings.formats.leap import unpack

PACKED = {
    "hello": "BYUwNmD2QAA=",
    "": "QAA=",
    "a": "IZA=",
    "a" * 50: "IY18ZXeQ",
    '{"frames":[[1,2],[1,2]]}': "N4IgZgTghgtgpgZxALgNqoIwBoBMBdLTXPPAXyAA",
    "µ→Ω tap tap": "K2JMJJXAAEAuCGAO15A=",
}
"""Texts and what LZ-string 1.3.3 makes of them."""


@pytest.mark.parametrize(("text", "packed"), PACKED.items())
def test_what_the_library_packed_is_unpacked(text: str, packed: str) -> None:
    assert unpack(packed) == text
    assert unpack("\n".join(packed)) == text


@given(st.text(alphabet=st.characters(max_codepoint=0xFFFF, exclude_categories=["Cs"]), max_size=300))
def test_every_text_comes_back(text: str) -> None:
    assert unpack(pack(text)) == text


@pytest.mark.parametrize(
    ("packed", "words"),
    [("", "ends too early"), ("w", "first letter"), ("!!!!", "expected base64 letters"), ("BYUw", "ends too early")],
)
def test_what_is_no_packed_text_is_refused(packed: str, words: str) -> None:
    with pytest.raises(TrajectoryError, match=words):
        unpack(packed)
