"""`hhsim report` as users meet it, and the commands that its page tells them."""

import base64
import json
import shlex
from pathlib import Path

import pytest
from conftest import Run
from drawings_alone import leave_report_undrawn
from report_reader import read_page
from short_grasp import short_grasp_text, short_result

from hhsim.report.sections import report_runs, result_tables
from hhsim.result.reader import load_result


@pytest.fixture(autouse=True)
def coarse_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """How fine they are is not what is tested here, and takes most of the time."""
    monkeypatch.setattr("hhsim.report.report.RENDER_DPI", 30)
    monkeypatch.setattr("hhsim.report.figure.DPI", 50)


def test_a_report_is_made_and_told(run: Run, tmp_path: Path) -> None:
    short_result(tmp_path / "coupled.h5")
    answer = run("report", "coupled.h5")
    assert answer.code == 0, answer.err
    (folder,) = (tmp_path / "results").iterdir()
    assert folder.name.endswith("-coupled-report")
    pictures = sorted(path.name for path in folder.glob("*.png"))
    assert f"the report is in results/{folder.name}/report.html, with {len(pictures)} pictures beside it" in answer.out
    assert "hand.png" in pictures
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in folder.glob("*.png"))
    page = read_page((folder / "report.html").read_text(encoding="utf-8"))
    assert [base64.b64decode(str(image.attributes["src"]).partition(",")[2]) for image in page.all("img")] == [
        (folder / f"{figure.attributes['id']}.png".replace("figure-", "")).read_bytes() for figure in page.all("figure")
    ]


@pytest.mark.soak
def test_several_results_are_told_to_machines(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # What is drawn is tested elsewhere, and takes time.
    leave_report_undrawn(monkeypatch)
    for method in ("coupled", "paper"):
        short_result(tmp_path / f"{method}.h5", method=method)
    answer = run("report", "coupled.h5", "paper.h5", "--out", "both.html", "--json")
    document = json.loads(answer.out)
    assert document["report"] == "both.html"
    assert [row["label"] for row in document["results"]] == ["A: coupled", "B: paper"]
    assert document["comparisons"][0]["comparable"] is True
    assert any(text.startswith("method:") for text in document["comparisons"][0]["how"])
    assert document["results"][0]["figures"]["penetration_max"] == 0.0
    assert all((tmp_path / path).is_file() for path in document["pictures"])
    quiet = run("report", "paper.h5", "--out", "again", "--quiet")
    assert (quiet.code, quiet.out, quiet.err) == (0, "", "")
    assert (tmp_path / "again" / "report.html").is_file()


def test_the_command_that_made_a_result_is_told_as_it_was_typed(run: Run, tmp_path: Path) -> None:
    (tmp_path / "short.toml").write_text(short_grasp_text())
    typed = "hhsim replay cube short.toml --method progressive --level 2 --tremor '0.1, 0.2' --out x.h5 --quiet"
    answer = run(*shlex.split(typed)[1:])
    assert answer.code == 0, answer.err
    result = load_result(tmp_path / "x.h5")
    assert list(result.command) == shlex.split(typed)
    told = result_tables(report_runs([result]), [])
    assert told["typed"] == [typed]
    assert told["again"] == ["hhsim view x.h5", "hhsim verify x.h5", "hhsim replay x.h5"]
