"""What looks like code in docstrings and comments is there; ruff holds their layout."""

import builtins
import re

import pytest

from tools.import_graph import REPOSITORY

REFERENCE = re.compile(r"(?<!`)`([A-Za-z_][\w.]*?)(?:\(\))?`(?!`)")
ELSEWHERE = {"ParquetTestSet", "HapticCommand", "XrHandJointEXT", "XrHandJointLocationEXT", "atan2", "TextLogLevel"}
"""Names of other software."""
COMPOSED = {"thumb_tip"}
"""Names that are put together when the code runs."""


@pytest.mark.soak
def test_every_name_in_a_docstring_or_comment_is_a_word_of_the_code() -> None:
    paths = [path for folder in ("hhsim", "cli", "tools") for path in (REPOSITORY / folder).rglob("*.py")]
    texts = {path.relative_to(REPOSITORY).as_posix(): path.read_text(encoding="utf-8") for path in paths}
    known = {*dir(builtins), *ELSEWHERE, *COMPOSED, *(word for path in texts for word in re.split(r"[/.]", path))}
    for text in texts.values():
        known.update(re.findall(r"\w+", REFERENCE.sub("", text)))
    named = [(path, reference) for path, text in texts.items() for reference in REFERENCE.findall(text)]
    assert len(named) > 1000
    assert [f"{path}: `{reference}`" for path, reference in named if not {*reference.split(".")} <= known] == []
