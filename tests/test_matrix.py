"""Each cell of the matrix does what docs/matrix.md says."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from command_server import CommandServer
from matrix import KINDS, READERS, SCENES, WORKS, Cells, Scene
from sampled import sampled

CELLS = [(scene, reader) for scene in SCENES for reader in READERS]
QUICK = Scene("one", "joint, driven", "mesh"), ("replay", "run again", "compare", "export")
"""What `make test` runs."""
WORDS = {"joint, driven": "joint driven", "joint, free": "joint free", "several": "several bodies"}


@pytest.fixture(scope="module")
def cells(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cells]:
    with CommandServer(tmp_path_factory.mktemp("matrix"), 600.0) as server:
        yield Cells(server)


def page(repository: Path) -> tuple[dict[str, dict[str, str]], dict[str, str]]:
    """Return the cells of the page by row and column, and the reasons of its refusals by letter."""
    text = (repository / "docs" / "matrix.md").read_text(encoding="utf-8")
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines() if line.startswith("|")]
    head, _, *body = rows
    reasons = dict(re.findall(r"^- (\w): `([^`]*)`", text, re.MULTILINE))
    return {row[0]: dict(zip(head[1:], row[1:], strict=True)) for row in body}, reasons


def row_of(scene: Scene) -> str:
    return f"{scene.hands} hand{'s' if scene.hands == 'two' else ''}, {WORDS.get(scene.kind, scene.kind)}"


def test_the_page_has_every_cell(repository: Path) -> None:
    table, reasons = page(repository)
    assert list(table) == list(dict.fromkeys(map(row_of, SCENES))) and len(table) == 2 * len(KINDS)
    assert all(list(row) == list(READERS) for row in table.values())
    assert {cell for row in table.values() for cell in row.values()} == {"✓", *reasons}


@pytest.mark.parametrize(
    ("scene", "reader"),
    sampled(CELLS, lambda _, cell: cell[0] == QUICK[0] and cell[1] in QUICK[1]),
    ids=lambda value: "-".join(value) if isinstance(value, Scene) else value,
)
def test_a_cell_does_what_the_page_says(cells: Cells, repository: Path, scene: Scene, reader: str) -> None:
    table, reasons = page(repository)
    said, found = table[row_of(scene)][reader], cells.outcome(scene, reader)
    assert found == WORKS if said == "✓" else reasons[said] in found
