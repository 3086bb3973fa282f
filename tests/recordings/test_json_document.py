"""Numbers of JSON by their place in the text."""

import json
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from hhsim.motion.text_edit import edited
from hhsim.recordings.json_document import PlacedJson

NUMBERS = st.one_of(st.integers(-(10**15), 10**15), st.floats(allow_nan=False, allow_infinity=False, width=32))
DOCUMENTS = st.recursive(
    st.one_of(NUMBERS, st.text(), st.sampled_from(['a "1.5" \\', "-2e3", "\\"]), st.booleans(), st.none()),
    lambda inner: st.one_of(st.lists(inner, max_size=4), st.dictionaries(st.text(max_size=3), inner, max_size=4)),
    max_leaves=20,
)


def numbers(node: Any) -> list[Any]:
    """The numbers of a document in their order."""
    if isinstance(node, dict | list):
        return [found for item in (node.values() if isinstance(node, dict) else node) for found in numbers(item)]
    return [] if isinstance(node, bool) or not isinstance(node, int | float) else [node]


@given(st.lists(DOCUMENTS, min_size=1, max_size=4), st.sampled_from([None, 1]), st.booleans(), st.booleans())
def test_numbers_are_found_where_they_stand(lines: list[Any], indent: int | None, ascii_only: bool, mark: bool) -> None:
    text = "\n".join(
        json.dumps(line, indent=indent if len(lines) == 1 else None, ensure_ascii=ascii_only) for line in lines
    )
    text = "\ufeff" * mark + text
    placed = PlacedJson(text)
    assert placed.document == (lines if len(lines) > 1 else lines[0])
    every = numbers(placed.document)
    assert edited(text, placed.edits(every, every, 3)) == text
    # Each number gets its own new value, to three decimals at least.
    edits = [edit for k, item in enumerate(every) for edit in placed.edits([item], [k + 0.125], 3)]
    assert len(edits) == len(every)
    again = PlacedJson(edited(text, edits)).document
    assert [float(value) for value in numbers(again)] == [k + 0.125 for k in range(len(every))]
