"""The page of promises names tests that exist."""

import ast
import re

from conftest import REPOSITORY
from markdown_pages import Page


def test_every_test_that_the_page_names_exists() -> None:
    named: dict[str, set[str]] = {}
    for promise, _, tests in (row for row in Page.read(REPOSITORY / "docs" / "lab" / "promises.md").rows()[1:]):
        found = re.findall(r"`(tests/[\w/]+\.py)::(test_\w+)`", tests)
        assert found or promise in ("promise", "---"), f"'{promise}' names no test"
        for file, name in found:
            named.setdefault(file, set()).add(name)
    for file, names in named.items():
        tree = ast.parse((REPOSITORY / file).read_text(encoding="utf-8"))
        missing = names - {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
        assert not missing, f"{file} has no {sorted(missing)}"
