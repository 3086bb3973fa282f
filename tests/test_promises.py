"""The page of promises names tests that exist, and says of which `make soak` alone runs them."""

import ast
import re

from conftest import REPOSITORY
from markdown_pages import Page

SOAK = "pytest.mark.soak"


def soaked(file: str) -> dict[str, bool]:
    """Whether all cases of a file's tests are in the soak, by their names."""
    tree = ast.parse((REPOSITORY / file).read_text(encoding="utf-8"))
    marks = [
        node.value
        for node in tree.body
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "pytestmark"
    ]
    whole = any(SOAK in ast.unparse(mark) for mark in marks)
    tests = [node for node in tree.body if isinstance(node, ast.FunctionDef)]
    return {test.name: whole or SOAK in map(ast.unparse, test.decorator_list) for test in tests}


def test_every_test_that_the_page_names_exists() -> None:
    named: dict[str, dict[str, bool]] = {}
    for promise, _, tests in (row for row in Page.read(REPOSITORY / "docs" / "lab" / "promises.md").rows()[1:]):
        found = re.findall(r"`(tests/[\w/]+\.py)::(test_\w+)`( \(soak\))?", tests)
        assert found or promise in ("promise", "---"), f"'{promise}' names no test"
        for file, name, soak in found:
            named.setdefault(file, {})[name] = bool(soak)
    for file, said in named.items():
        there = soaked(file)
        assert not said.keys() - there.keys(), f"{file} has no {sorted(said.keys() - there.keys())}"
        assert {name: there[name] for name in said} == said, file
