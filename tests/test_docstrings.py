"""Docstrings have one style: Google's, whose layout ruff holds; here, what it does not look at."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from tools.import_graph import REPOSITORY, library

FILES = [path for folder in ("hhsim", "cli", "tools") for path in sorted((REPOSITORY / folder).rglob("*.py"))]

SECTIONS = ("Args:", "Attributes:", "Raises:", "Returns:", "Yields:")
ENTRY = re.compile(r"\*{0,2}\w+(?:\.\w+)*(?:, \*{0,2}\w+)*: (.*)")
LOWER = re.compile(r"(a(?= \w{2,})|[a-z]{2,})(?:[-’'][a-z]+)*(?=[ ,;:.]|$)(?! = )(?!\.\w)")
OWN_NAMES = {
    "hhsim",
    "numba",
    "numpy",
    "scipy",
    "trimesh",
    "matplotlib",
    "rerun",
    "coal",
    "qpsolvers",
    "clarabel",
    "click",
    "true",
    "false",
}
"""Words that have no capital where a sentence begins with them."""


def texts(path: Path) -> Iterator[tuple[int, str]]:
    """Every docstring, those of attributes included, with its line."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        for statement in node.body if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) else ():
            value = statement.value if isinstance(statement, ast.Expr) else None
            if isinstance(value, ast.Constant) and isinstance(value.value, str):
                yield statement.lineno, value.value


def begins_small(text: str) -> bool:
    """Whether a sentence begins with a word without a capital; a name, a formula or a unit may."""
    word = LOWER.match(text)
    return word is not None and word.group(1) not in OWN_NAMES


def entries(text: str) -> Iterator[str]:
    """What the entries of all sections say."""
    for block in re.split(r"\n\s*\n", text):
        lines = block.split("\n")
        if lines[0].strip() not in SECTIONS or len(lines) == 1:
            continue
        indent = re.match(" *", lines[1])
        assert indent is not None
        if lines[0].strip() in ("Returns:", "Yields:"):
            yield lines[1].strip()
        else:
            own = (line[indent.end() :] for line in lines[1:] if not line[indent.end() :].startswith(" "))
            yield from (entry.group(1) for entry in map(ENTRY.fullmatch, own) if entry)


def found(path: Path) -> list[str]:
    wrong = []
    for line, text in texts(path):
        first = text.split("\n\n")[0].rstrip()
        if begins_small(text):
            wrong.append(f"{path.relative_to(REPOSITORY)}:{line}: '{text[:40]}' begins without a capital")
        if first and first[-1] not in ".!?:…|":
            wrong.append(f"{path.relative_to(REPOSITORY)}:{line}: '{first[-40:]}' ends without a full stop")
        wrong += [
            f"{path.relative_to(REPOSITORY)}:{line}: '{entry[:40]}'" for entry in entries(text) if begins_small(entry)
        ]
    return wrong


def test_sentences_and_entries_begin_with_a_capital_and_end() -> None:
    assert [line for path in FILES for line in found(path)] == []


def test_dotted_names_exist() -> None:
    known = dict.fromkeys(library())
    missing = []
    for path in FILES:
        for name in re.findall(r"`(hhsim(?:\.\w+)+)`", path.read_text(encoding="utf-8")):
            module = name
            while module not in known:
                module = module.rpartition(".")[0]
            inside = name.removeprefix(module).strip(".").partition(".")[0]
            if inside and not re.search(rf"\b{inside}\b", library()[module].read_text(encoding="utf-8")):
                missing.append(f"{path.relative_to(REPOSITORY)}: {name}")
    assert missing == []


@pytest.mark.parametrize(
    ("text", "small"),
    [
        ("the hand.", True),
        ("k_t [N/m]", False),
        ("`solve`", False),
        ("hhsim's version", False),
    ],
)
def test_a_small_beginning(text: str, small: bool) -> None:
    assert begins_small(text) == small
