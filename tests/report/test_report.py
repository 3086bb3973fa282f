"""A report: what it says is what the files hold, for whole and for broken ones, alone and side by side."""

import base64
import itertools
import re
import resource
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import file_faults
import h5py
import numpy as np
import pytest
from file_faults import of_scene
from report_reader import Page, read_page
from short_grasp import short_grasp, short_scene

from hhsim.errors import OutputError
from hhsim.mesh.catalogue import load_object
from hhsim.metrics.run.registry import run_metrics
from hhsim.render.viewpoint import View
from hhsim.replay.replay import replay_scene
from hhsim.replay.summary import ReplaySummary
from hhsim.replay.summary_table import summary_rows
from hhsim.replay.verdict import result_rows
from hhsim.report.figure import ReportFigure
from hhsim.report.report import CHARTS, check_report_path, make_report, write_report
from hhsim.report.sections import letter, result_labels
from hhsim.result.reader import Result, load_result
from hhsim.solver.options import SolverOptions
from hhsim.table.html import LONGEST_WORD, NO_TEXT

PIXEL = base64.b64decode(
    "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mNk+M9QDwADhgGAWjR9awAAAABJRU5ErkJggg=="
)
Change = Callable[[h5py.File], object]
LIMITED = (
    *("force_step", "tracking_excess", "force_variation_hold", "force_ripple_hold", "contact_error_max"),
    *("posture_jump_max", "force_contact_step_share"),
)
"""Figures of a short run that miss their limits."""


def run_method(folder: Path, method: str) -> tuple[Path, ReplaySummary]:
    scene = short_scene(short_grasp(hold=0.15, release=0.05))
    path = folder / f"{method}.h5"
    description = {"object": "cylinder", "trajectory": "short.toml", "level": 2, "hand_file": None}
    description["object_mesh"] = load_object("cylinder").mesh.sha256
    return path, replay_scene(scene, SolverOptions(method=method), path, description=description)


@pytest.fixture(scope="module")
def replayed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, ReplaySummary]:
    return run_method(tmp_path_factory.mktemp("results"), "coupled")


@pytest.fixture(scope="module")
def coupled(replayed: tuple[Path, ReplaySummary]) -> Path:
    return replayed[0]


@pytest.fixture(scope="module")
def progressive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return run_method(tmp_path_factory.mktemp("results"), "progressive")[0]


@pytest.fixture
def dots(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures of one pixel: what is tested is the page."""

    def dot(name: str) -> ReportFigure:
        return ReportFigure(name, f"the {name}", f"Caption of {name}.", f"alt of {name}", PIXEL, 1, 1)

    makers = {name: lambda _, name=name: dot(name) for name in CHARTS}
    monkeypatch.setattr("hhsim.report.report.CHARTS", makers)
    monkeypatch.setattr("hhsim.report.report.overview_picture", lambda result, view: dot("overview"))
    monkeypatch.setattr("hhsim.report.report.overview_view", lambda result: View(0.0, 0.0))


def changed(path: Path, folder: Path, change: Change, name: str = "") -> Path:
    """A copy of a result that was changed by hand."""
    copy = folder / (name or path.name)
    shutil.copy(path, copy)
    with file_faults.changed(copy) as file:
        change(file)
    return copy


def stating(**figures: float) -> Change:
    """Other figures in a result's summary."""
    return lambda file: file["summary/right"].attrs.update(figures)


def in_scene(**others: Any) -> Change:
    """Other words in the description of a result's scene."""
    return of_scene("other words", lambda scene: scene.update(others))


def page_of(*paths: Path) -> Page:
    return read_page(make_report(paths).html)


def test_the_table_is_the_one_that_replay_printed(replayed: tuple[Path, ReplaySummary], dots: None) -> None:
    path, summary = replayed
    found = page_of(path).rows("Figures,")
    assert found[0] == ["figure", "hhsim", "unit"]
    assert found[1:] == [[row.label, row.shown, row.unit] for row in summary.rows]
    assert len(found) > 20


def test_a_run_that_was_cut_short_has_its_table_from_its_ticks(coupled: Path, tmp_path: Path) -> None:
    summary = load_result(coupled).summary
    whole = {row.name: row for row in summary_rows({name: summary[name] for name in run_metrics() if name in summary})}
    short = load_result(changed(coupled, tmp_path, lambda file: emptied(file, load_result(coupled).ticks)))
    rows = {row.name: row for row in result_rows(short)}
    # These are of runs of their own.
    assert whole.keys() - rows.keys() == {name for name in whole if run_metrics()[name].own_run}
    for name in rows.keys() & whole.keys():
        np.testing.assert_allclose(rows[name].value, whole[name].value, rtol=1e-12, err_msg=name)
    assert rows["candidates_max"].value > 0


def test_the_page_is_in_order(coupled: Path, progressive: Path, dots: None) -> None:
    for paths in ((coupled,), (coupled, progressive)):
        report = make_report(paths)
        page = read_page(report.html)
        ids = [str(e.attributes["id"]) for e in page.elements if "id" in e.attributes]
        links = [str(a.attributes["href"]) for a in page.all("a")]
        assert len(ids) == len(set(ids)) and len(links) >= 7
        assert all(link.startswith("#") and link[1:] in ids for link in links)
        assert [e.attributes["aria-label"] for e in page.all("section")] == [a.text for a in page.all("a")]
        # A browser opens what a link leads into: the anchor lies inside of what is folded.
        for inside in (page.by_id(link[1:]) for link in links):
            assert inside.tag == "section" or inside.parents[-1] == "details"
        levels = [int(e.tag[1]) for e in page.elements if e.tag in ("h1", "h2", "h3", "h4")]
        assert levels[0] == levels.count(1) == 1
        assert all(later <= earlier + 1 for earlier, later in itertools.pairwise(levels))
        assert {"header", "main", "footer", "nav"} <= {e.tag for e in page.elements}
        assert len(page.all("caption")) == len(page.all("table"))
        images = page.all("img")
        assert all(image.attributes["alt"] for image in images)
        shown = [base64.b64decode(str(i.attributes["src"]).removeprefix("data:image/png;base64,")) for i in images]
        assert shown == list(report.pictures.values()) and len(shown) == len(CHARTS) + len(paths)
        assert not re.search(r"https?:|<script|url\(|src=\"(?!data:)", report.html)


def test_the_same_results_give_the_same_bytes(coupled: Path, progressive: Path, tmp_path: Path, dots: None) -> None:
    first = make_report((coupled, progressive))
    elsewhere = [Path(shutil.copy(path, tmp_path / path.name)) for path in (coupled, progressive)]
    second = make_report(elsewhere)
    assert first.html == second.html
    assert list(first.pictures) == list(second.pictures)
    assert {"a-overview", "b-overview"} <= first.pictures.keys()
    assert "there is no command" in first.html


def test_worst_ticks_are_told(coupled: Path, dots: None) -> None:
    result, (_, row, *_) = load_result(coupled), page_of(coupled).rows("Worst ticks")
    cpu = result["duration/total_cpu"]
    slowest = int(np.argmax(cpu))
    assert row[:4] == ["slowest tick, CPU time", f"{1e-3 * cpu[slowest]:,.3f}", "µs", f"{slowest:,}"]
    assert row[5] == result.phase_at(slowest)


def test_the_verdict_is_by_the_default_limits(coupled: Path, tmp_path: Path, dots: None) -> None:
    still = dict.fromkeys(LIMITED, 0.0)

    good = make_report((changed(coupled, tmp_path, stating(**still)),))
    assert good.runs[0].verdict.word == "within limits"
    assert "stays out of the object's spheres" in good.verdict_lines()[0]
    bad = make_report((changed(coupled, tmp_path, stating(**{**still, "penetration_max": 5e-3, "stuck_ticks": 3})),))
    assert bad.runs[0].verdict.missed == ("penetration_max", "stuck_ticks")
    assert "penetration, max 5,000.000 µm (limit 1); stuck ticks 3 (limit 0)" in bad.verdict_lines()[0]
    told = [e.text for e in read_page(bad.html).all("p") if "verdict" in str(e.attributes.get("class"))]
    assert "limits missed" in told[0]


def test_a_missed_limit_without_a_column_stands_below_the_verdict(coupled: Path, tmp_path: Path, dots: None) -> None:
    page = page_of(changed(coupled, tmp_path, stating(lag_ticks=93.0, lag_max=0.05, stuck_ticks=2.0)))
    heading, row = page.rows("Key figures")
    assert row[heading.index("verdict")].endswith("ticks with lag 93")
    assert row[heading.index("stuck ticks")] == "2"


def test_the_papers_figures_stand_beside_its_scenes(coupled: Path, tmp_path: Path, dots: None) -> None:
    known = changed(coupled, tmp_path, in_scene(object="bunny", trajectory="grasp"))
    assert page_of(known).rows("Figures,")[0][-1] == "paper"
    assert page_of(known, known).rows("Figures side by side")[0][-1] == "paper"


def test_periods_without_a_tick_are_told_at_the_top(coupled: Path, tmp_path: Path, dots: None) -> None:
    late = stating(**dict.fromkeys(LIMITED, 0.0), missed=1606)
    (run,) = make_report((changed(coupled, tmp_path, late),)).runs
    assert run.verdict.word == "ticks missed"
    assert "1,606 periods of the session had no tick at all" in " ".join(run.verdict.sentences)


def test_two_methods_on_one_scene_are_compared(coupled: Path, progressive: Path, dots: None) -> None:
    report = make_report((coupled, progressive))
    (comparison,) = report.comparisons
    assert comparison and comparison.comparable
    assert comparison.how == ("method: coupled and progressive",)
    rows = read_page(report.html).rows("Figures side by side")
    assert rows[0] == ["figure", "unit", "A: coupled", "B: progressive"]
    by_label = {row[0]: row for row in rows[1:]}
    assert by_label["penetration, max"][3].endswith(" same")
    assert by_label["force in the hold, mean"][3].endswith("×"), "more force is neither better nor worse"
    marks = [row[0] for row in read_page(report.html).rows("What was run; ≠")]
    assert "≠ method" in marks
    assert "object" in marks


@pytest.mark.soak
def test_a_page_of_eight_results_fits_the_smallest_screen(coupled: Path, tmp_path: Path, dots: None) -> None:
    name = "an-object-with-a-long-name"
    others = [
        changed(coupled, tmp_path, in_scene(object_name=f"{name}-{i}", motion=f"motion {i}"), f"{i}.h5")
        for i in range(7)
    ]
    page = page_of(coupled, *others)
    assert not [e for e in page.elements if "style" in e.attributes]
    # Pictures shrink with the page: `max-width` holds for each.
    assert {e.tag for e in page.elements if "width" in e.attributes} <= {"img", "source"}
    assert all("figure" in image.parents for image in page.all("img"))
    starts = [i for i, e in enumerate(page.elements) if e.tag == "table"]
    for start, end in itertools.pairwise([*starts, len(page.elements)]):
        table = page.elements[start]
        inside = [e for e in page.elements[start:end] if "table" in e.parents]
        headings = [e.text for e in inside if e.tag == "th" and e.attributes.get("scope") == "col"]
        if len(headings) > 3:
            assert table.attributes.get("class") in ("cards", "cards many"), headings
            assert all(e.attributes["data-heading"] for e in inside if e.tag == "td")
        for cell in (e for e in inside if e.tag in ("td", "th")):
            longest = max(map(len, cell.text.split()), default=0)
            assert longest <= LONGEST_WORD or cell.attributes.get("class") == "long", cell.text
    for block in (e for e in page.elements if e.tag == "pre"):
        assert block.attributes["tabindex"] == "0", "a keyboard scrolls it"


def emptied(file: h5py.File, ticks: int) -> None:
    file.attrs["complete"] = 0
    for name in list(file["summary/right"].attrs):
        del file["summary/right"].attrs[name]
    file_faults.shortened(file, ticks)


@pytest.mark.parametrize("ticks", [0, 1, 2, 60])
def test_a_run_of_hardly_a_tick_has_a_page(coupled: Path, tmp_path: Path, dots: None, ticks: int) -> None:
    report = make_report((changed(coupled, tmp_path, lambda file: emptied(file, ticks)),))
    page = read_page(report.html)
    assert report.runs[0].verdict.word == ("no ticks" if ticks == 0 else "cut short")
    facts = {row[0]: row[1] for row in page.rows("What was run")}
    assert facts["ticks"].startswith(f"{ticks} at 1,000 Hz")
    assert {row[0]: row[1] for row in page.rows("Machine, versions")}["complete"].startswith("no")


def test_what_is_not_finite_is_no_figure(coupled: Path, tmp_path: Path, dots: None) -> None:
    def broken(file: h5py.File) -> None:
        emptied(file, 300)
        for name in ("force/total", "force/phalanx", "penetration_depth", "force_variation_rate", "graphic/position"):
            file[f"hands/right/tick/{name}"][100:110] = np.nan
        file["hands/right/tick/force/total"][120] = np.inf

    report = make_report((changed(coupled, tmp_path, broken),))
    read_page(report.html)
    rows = {row.name: row for row in report.runs[0].rows}
    assert np.isfinite(rows["penetration_max"].value)
    assert "NaN" not in report.html.replace("not NaN", "")


def test_names_that_are_markup_are_shown_as_they_are(coupled: Path, tmp_path: Path, dots: None) -> None:
    nasty = '"><script>alert(1)</script>&\x00'

    named = in_scene(object=nasty, object_name=nasty, motion=nasty, object_repairs=[nasty])
    page = page_of(changed(coupled, tmp_path, named, "a'b&c.h5"))
    shown = NO_TEXT.sub("\N{REPLACEMENT CHARACTER}", nasty)
    assert not page.all("script")
    assert page.one("title").text.startswith(shown)
    assert {row[0]: row[1] for row in page.rows("What was run")}["object"] == shown
    assert any("""hhsim view 'a'"'"'b&c.h5'""" in code.text for code in page.all("code"))


def test_a_report_is_a_folder_or_a_page(coupled: Path, tmp_path: Path, dots: None) -> None:
    report = make_report((coupled,))
    files = write_report(report, tmp_path / "folder")
    assert files.page == tmp_path / "folder" / "report.html"
    assert sorted(path.name for path in (tmp_path / "folder").iterdir()) == sorted(
        ["report.html", *(f"{name}.png" for name in report.pictures)]
    )
    assert files.page.read_text(encoding="utf-8") == report.html
    again = write_report(report, tmp_path / "folder")
    assert again == files
    page = write_report(report, tmp_path / "page.html")
    assert page.pictures[0].name == "page-overview.png"
    assert page.pictures[0].read_bytes() == PIXEL


def test_what_hhsim_did_not_write_is_not_replaced(coupled: Path, tmp_path: Path, dots: None) -> None:
    for name in ("mine.html", "file", "overview.png"):
        (tmp_path / name).write_text("mine")
    for name, message in (
        ("mine.html", "no page of hhsim report"),
        ("file", "file is a file: name a folder"),
        ("nowhere/page.html", "there is no folder"),
    ):
        with pytest.raises(OutputError, match=message):
            check_report_path(tmp_path / name)
    with pytest.raises(OutputError, match=r"overview\.png exists, and no report"):
        write_report(make_report((coupled,)), tmp_path)
    assert (tmp_path / "overview.png").read_text() == "mine" and not (tmp_path / "report.html").exists()


@pytest.mark.usefixtures("dots")
def test_a_full_disk_leaves_nothing_of_a_report(coupled: Path, tmp_path: Path) -> None:
    """The pictures fit, the page does not."""
    report = make_report((coupled,))
    unlimited = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (len(report.html) // 2, unlimited[1]))
    try:
        for place in (tmp_path / "folder", tmp_path / "page.html"):
            with pytest.raises(OutputError, match=r"cannot write .*html"):
                write_report(report, place)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, unlimited)
    assert list(tmp_path.iterdir()) == []


def otherwise(result: Result, solver: dict[str, Any] | None = None, **scene: Any) -> Result:
    """The same result with other options."""
    return replace(result, scene={**result.scene, **scene, "solver": {**result.scene["solver"], **(solver or {})}})


@pytest.fixture(scope="module")
def plain(coupled: Path) -> Result:
    return load_result(coupled)


def test_one_result_is_its_method(plain: Result) -> None:
    assert result_labels([plain]) == ["coupled"]
    assert result_labels([otherwise(plain, {"method": ""})]) == ["method"]
    assert [letter(place) for place in (0, 25, 26, 701, 702)] == ["A", "Z", "AA", "ZZ", "AAA"]


def test_object_motion_method_and_options_are_told_where_they_differ_and_are_not_usual(plain: Result) -> None:
    paper = otherwise(plain, {"method": "paper", "force": "paper", "margin": 5e-4, "linearisations": 1})
    assert result_labels([plain, paper]) == ["A: coupled", "B: paper"]
    cup, pinch = otherwise(plain, object_name="cup"), otherwise(plain, motion="pinch")
    assert result_labels([plain, cup]) == ["A: cylinder coupled", "B: cup coupled"]
    assert result_labels([plain, pinch]) == ["A: short coupled", "B: pinch coupled"]
    soft = otherwise(plain, {"stiffness": {**plain.scene["solver"]["stiffness"], "translation": 200.0}})
    thin = otherwise(plain, {"margin": 2e-3}, seed=3)
    labels = ["A: coupled", "B: coupled, stiffness translation 200", "C: coupled, seed 3, margin 2 mm"]
    assert result_labels([plain, soft, thin]) == labels
    assert result_labels([thin, thin]) == ["A: coupled", "B: coupled"]
    slow = otherwise(plain, {"period": 1 / 72}, rate=72.0)
    assert result_labels([plain, slow])[1].startswith("B: coupled, rate 72")
