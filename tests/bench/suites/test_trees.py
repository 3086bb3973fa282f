"""`hhsim bench trees`: the shapes, the bars, the table and the command, small."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from conftest import Run

from hhsim.bench.suite import run_cells
from hhsim.bench.suites import trees
from hhsim.bench.suites.trees import Trees
from hhsim.table.file import load_table

SMALL = ("bench", "trees", "--object", "cube", "--spheres", "8")
FEW = Trees.planned(objects=("cube",), spheres=(8, 60))
TIMED = Trees.planned(time_limits=True)


@pytest.fixture(scope="module", autouse=True)
def few_points() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(trees, "POINTS", 3_000)
        yield


@pytest.fixture(scope="module")
def rows(few_points: None) -> list[dict[str, Any]]:
    return [row for rows in list(run_cells(FEW)) for row in rows]


@pytest.mark.soak
def test_rows_say_what_was_built(rows: list[dict[str, Any]]) -> None:
    built = [row for row in rows if not row["is_reference"]]
    assert [(row["method"], row["asked"], row["level"]) for row in built] == [("certified", 8, 1), ("certified", 60, 2)]
    for row in built:
        assert row["spheres"] <= row["asked"] and row["is_proved"]
        assert row["gap_max"] == 0.0
        assert 0.0 < row["protrusion_mean"] < row["protrusion_max"] <= row["bound"] * (1.0 + 1e-9)
        assert row["cpu"] >= row["cpu_leaves"] > 0.0
    references = [row for row in rows if row["is_reference"]]
    assert [row["spheres"] for row in references] == [507, 3163]
    assert references[0]["protrusion_max"] == 2.92e-3


def test_what_is_a_miss() -> None:
    good: dict[str, Any] = {
        "object": "cube",
        "method": "certified",
        "is_reference": False,
        "asked": 512,
        "is_proved": True,
        "protrusion_max": 1.9e-3,
        "protrusion_limit": 1.9e-3,
        "gap_max": 1e-9,
        "cpu": 2.0,
        "cpu_limit": 2.0,
    }
    assert TIMED.missed([good]) == []
    for change, words in (
        ({"protrusion_max": 1.91e-3}, "protrudes 1.910 mm, limit 1.900 mm"),
        ({"protrusion_max": float("nan")}, "protrudes nan mm"),
        ({"gap_max": 2e-9}, "a gap of 2.0 nm"),
        ({"is_proved": False}, "no proof"),
    ):
        (sentence,) = FEW.missed([good | change])
        assert words in sentence and sentence.startswith("cube, 512 spheres: ")
        assert FEW.missed([good | change | {"is_reference": True}]) == []
    slow = good | {"cpu": 2.1}
    assert FEW.missed([slow]) == []
    assert TIMED.missed([slow]) == ["cube, 512 spheres: 2.1 s of CPU time, limit 2.0 s"]


@pytest.mark.soak
def test_the_command_writes_two_files(run: Run, tmp_path: Path) -> None:
    answer = run(*SMALL, "--out", "a.json", "--size", "50")
    assert answer.code == 0, answer.err
    assert "certified" in answer.out and "(toolkit 2004, medial)" in answer.out
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.csv", "a.json"]
    table = load_table(tmp_path / "a.json")
    assert table.suite == "trees" and table.options["size"] == 50.0
    assert [row["method"] for row in table.rows[:2]] == ["certified", "(toolkit 2004, medial)"]
    toolkit = next(row for row in table.rows if row["is_reference"])
    assert toolkit["protrusion_max"] == pytest.approx(0.5 * 2.92e-3)
    assert "protrusion_max [m]" in (tmp_path / "a.csv").read_text().splitlines()[0]


@pytest.mark.soak
def test_the_command_as_json_and_a_missed_bar(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from hhsim.trees.published_results import Bar

    monkeypatch.setattr(trees, "BARS", {("cube", 8): Bar(1e-6, 1e-9)})
    answer = run(*SMALL, "--json", "--time-limits", "--out", "b.json")
    assert answer.code == 1
    document = json.loads(answer.out)
    assert len(document["missed"]) == 2
    assert "cube, 8 spheres: protrudes" in document["missed"][0] and "s of CPU time" in document["missed"][1]


def test_build_tree_draws(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hhsim.render.spheres_figure.PIXELS", 100)
    answer = run("build-tree", "cube", "--level", "1", "--out", "c.h5", "--plot", "c.png", "--json")
    assert answer.code == 0, answer.err
    assert json.loads(answer.out)["plot"] == "c.png"
    assert (tmp_path / "c.png").stat().st_size > 10_000
    refused = run("build-tree", "cube", "--level", "1", "--out", "d.h5", "--plot", "e.h5")
    assert refused.code == 2 and "no picture by its ending" in refused.err
    assert not (tmp_path / "d.h5").exists()
