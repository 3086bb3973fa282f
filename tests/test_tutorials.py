"""The tutorials: each runs cell by cell as a reader would run it, and shows what its cells gave."""

import json
from pathlib import Path

import pytest
from conftest import REPOSITORY

from tools.notebooks import run, run_cell

pytestmark = pytest.mark.slow

NOTEBOOKS = sorted((REPOSITORY / "docs" / "tutorials").glob("*.ipynb"))
EACH = pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)


@EACH
@pytest.mark.soak
def test_every_cell_runs(notebook: Path, tmp_path: Path) -> None:
    stored = json.loads(notebook.read_text(encoding="utf-8"))
    made = run(notebook, tmp_path)
    for before, after in zip(stored["cells"], made["cells"], strict=True):
        if before["cell_type"] == "code":
            kinds = [
                [(output["output_type"], *output.get("data", {})) for output in cell["outputs"]]
                for cell in (before, after)
            ]
            assert kinds[0] == kinds[1], "python -m tools.notebooks writes what the cells show now"


@EACH
def test_its_outputs_are_shown(notebook: Path) -> None:
    cells = [cell for cell in json.loads(notebook.read_text(encoding="utf-8"))["cells"] if cell["cell_type"] == "code"]
    assert sum(bool(cell["outputs"]) for cell in cells) >= len(cells) // 2
    for cell in cells:
        assert (
            not any("image/png" in output.get("data", {}) for output in cell["outputs"])
            or len(cell["metadata"]["alt"]) > 30
        )
        assert "/tmp" not in json.dumps(cell["outputs"]) and str(REPOSITORY) not in json.dumps(cell["outputs"])


def test_a_cell_that_fails_is_told() -> None:
    def cell(source: str, **metadata: int) -> dict[str, object]:
        return {"source": [source], "metadata": metadata}

    assert run_cell(cell("a = 2\na + 1"), {})[0]["data"] == {"text/plain": "3"}
    assert run_cell(cell("print('said');"), {})[0]["text"] == ["said\n"]
    assert run_cell(cell("!exit 1", exit_code=1), {})[0]["text"] == []
    with pytest.raises(RuntimeError, match="exit code 3"):
        run_cell(cell("!exit 3"), {})
    with pytest.raises(ZeroDivisionError):
        run_cell(cell("1 / 0"), {})
