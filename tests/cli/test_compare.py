"""`hhsim compare`, `export`, `view` and `report` as users meet them, and the commands that a report tells them."""

import base64
import shlex
import shutil
from pathlib import Path

import h5py
import pytest
from conftest import Run
from file_faults import changed
from report_reader import read_page
from short_grasp import short_grasp_text, short_result

from hhsim.report.sections import report_runs, result_tables
from hhsim.result.reader import load_result
from hhsim.result.writer import add_document


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("results")
    for method in ("coupled", "paper"):
        short_result(folder / f"{method}.h5", method=method)
    return folder


def word(text: str, label: str) -> str:
    (line,) = (line for line in text.splitlines() if line.startswith(label))
    return line.split("  ")[-1].strip()


def test_two_methods_side_by_side(run: Run, results: Path) -> None:
    answer = run("compare", str(results / "coupled.h5"), str(results / "paper.h5"))
    assert answer.code == 0, answer.err
    assert "The same object, hand and motion: figures can be compared." in answer.out
    assert "method: coupled and paper" in answer.out
    assert word(answer.out, "ticks with lag") == "same"
    document = run("compare", str(results / "coupled.h5"), str(results / "paper.h5"), "--json").document()
    assert document["comparable"] and "method: coupled and paper" in document["how"]
    one, other = (h5py.File(results / f"{name}.h5")["summary/right"].attrs for name in ("coupled", "paper"))
    figure = document["figures"]["force_contact_mean"]
    assert (figure["base"], figure["head"]) == (one["force_contact_mean"], other["force_contact_mean"])
    assert figure["ratio"] == pytest.approx(figure["head"] / figure["base"])


@pytest.mark.parametrize(
    ("deviations", "expected"),
    [((1e-5, 1e-5), "worse"), ((1e-4, 1e-4), "within noise"), ((None, 1e-4), "within noise"), ((None, None), "worse")],
)
def test_a_time_is_judged_by_what_repeated_runs_differ(
    run: Run, results: Path, tmp_path: Path, deviations: tuple[float | None, ...], expected: str
) -> None:
    for name, p50, deviation in zip(("a.h5", "b.h5"), (1e-3, 1.2e-3), deviations):
        shutil.copy(results / "coupled.h5", tmp_path / name)
        with changed(tmp_path / name) as file:
            file["summary/right"].attrs["tick_cpu_p50"] = p50
        if deviation is not None:
            times = {"tick_cpu_p50": {"mean": 1.1e-3, "std": deviation}}
            add_document(tmp_path / name, "repeated", {"runs": 3, "times": times})
    answer = run("compare", "a.h5", "b.h5")
    assert word(answer.out, "tick in contact, CPU, p50") == expected
    told = [line for line in answer.out.splitlines() if line.startswith("times of ")]
    assert len(told) == sum(deviation is not None for deviation in deviations)
    assert all("mean ± σ of 3 runs: tick in contact, CPU, p50 1,100.0 ± " in line for line in told)


def test_a_result_is_exported(run: Run, results: Path, tmp_path: Path) -> None:
    answer = run("export", str(results / "coupled.h5"), "ticks.csv", "--columns", "time,force/total")
    assert answer == (0, "200 ticks, 4 columns: ticks.csv\n", "")
    lines = (tmp_path / "ticks.csv").read_text().splitlines()
    assert len(lines) == 201
    assert lines[0] == "tick,time [s],force/total[0] [N],force/total[1] [N],force/total[2] [N]"


def test_a_result_is_looked_at_and_filmed(run: Run, results: Path, tmp_path: Path) -> None:
    result = str(results / "coupled.h5")
    answer = run("view", result, "--rerun", "again.rrd", "--every", "10", "--spheres")
    assert answer == (0, "20 of 200 ticks went to again.rrd\n", "")
    document = run("view", result, "--rerun", "again.rrd", "--json").document()
    assert document["seconds"] > 0.0
    expected = {"result": result, "ticks": 200, "shown_ticks": 200, "rerun": "again.rrd"}
    assert expected.items() <= document.items()
    answer = run("view", result, "--video", "short.gif", "--pixels", "160")
    assert answer == (0, "6 frames of 200 ticks, 0.2 s, in short.gif\n", "")
    assert (tmp_path / "short.gif").read_bytes().startswith(b"GIF89a")


def test_a_report_is_made_and_told(run: Run, results: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # How fine pictures are is not what is tested here, and takes most of the time.
    monkeypatch.setattr("hhsim.report.report.RENDER_DPI", 30)
    monkeypatch.setattr("hhsim.report.figure.DPI", 50)
    answer = run("report", str(results / "coupled.h5"))
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
