"""The paper's evaluation: a small run of it, its rows, its bars, and the command."""

import itertools
import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
from conftest import Run

from hhsim.bench.paper import figures as paper_figures
from hhsim.bench.paper.run import COUNTS, GLOVE, NOISES, PaperRuns, Scenario, held_ticks, make_stage, play, play_again
from hhsim.bench.paper.table import paper_row, paper_rows
from hhsim.bench.suite import Row, run_cells
from hhsim.bench.suites.paper import Paper
from hhsim.errors import HhsimError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.mesh.catalogue import load_object
from hhsim.motion.analytic_motion import still
from hhsim.replay import summary
from hhsim.solver.method import METHODS
from hhsim.solver.options import SolverOptions
from hhsim.trees.cache import cached_sphere_tree
from hhsim.trees.options import TreeOptions

pytestmark = pytest.mark.slow

HAND = HandModel.default()
OPTIONS = Paper.planned(methods=("coupled", "paper"), objects=("cube", "bunny"), level=3, instances=2, repetitions=2)


@pytest.fixture(scope="module")
def runs() -> PaperRuns:
    return PaperRuns(run_cells(OPTIONS))


def row(runs: PaperRuns, name: str, method: str = "coupled") -> Row:
    rows = paper_rows(runs, OPTIONS.methods, False)
    (found,) = [one for one in rows if (one["row"], one["method"]) == (name, method)]
    return found


@pytest.mark.soak
def test_every_row_is_measured_and_every_method_has_every_row(runs: PaperRuns) -> None:
    rows = paper_rows(runs, OPTIONS.methods, False)
    names = {method: [one["row"] for one in rows if one["method"] == method] for method in OPTIONS.methods}
    assert names["coupled"] == names["paper"]
    some = {"mean_cube", "sliding_depth", "complex_p99_bunny", "interaction_p99_bunny", "case_p99_WH"}
    some |= {"contacts_131", "contacts_250", "depth", "variation_glove_size", "touches"}
    assert some <= set(names["coupled"])
    for one in rows:
        small = one["row"].startswith("variation") and one["row"][-1] in "xyz"
        assert math.isfinite(one["ours"]) or small, one
        assert one["paper_text"] and one["label"] and one["unit"] in ("s", "m", "%", "1")
        assert "nan" not in one["note"] and "1 objects" not in one["note"]


def test_rows_are_what_the_runs_say(runs: PaperRuns) -> None:
    played = runs.of("coupled", "11", object_name="cube")
    times = np.concatenate([np.median(run.times, axis=0)[run.contact, 0] for run in played])
    mean = row(runs, "mean_cube")
    assert mean["ours"] == pytest.approx(times.mean(), rel=1e-5)
    assert mean["ratio"] == pytest.approx(0.32e-3 / times.mean(), rel=1e-5)
    assert mean["bar"] == pytest.approx(0.032e-3)
    deepest = [float(run.depth.max()) for run in runs.of("coupled", "11", "sliding", "13", "14", "15")]
    assert row(runs, "depth")["ours"] == max(deepest)
    variations = [run.variation["glove"][0, 0] for run in runs.of("coupled", "11", "13", "14")]
    assert row(runs, "variation_glove_size")["ours"] == pytest.approx(float(np.median(variations)))


def test_a_multiple_stands_beside_the_same_quantity_alone(runs: PaperRuns) -> None:
    rows = {one["row"]: one for one in paper_rows(runs, OPTIONS.methods, False) if one["method"] == "coupled"}
    # The paper's contacts are of another margin and several threads; its hand does not tremble.
    for name in ("contacts_131", "contacts_250", "variation_trembling_size"):
        assert math.isnan(rows[name]["ratio"]) and rows[name]["paper_text"]
    assert rows["variation_glove_size"]["paper"] == 0.18
    for run in runs.of("coupled", "15"):
        assert run.contacts == run.candidates[run.contact].mean()


def test_forces_of_all_methods_have_one_scale_and_a_picture_has_its_note(
    runs: PaperRuns, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: list[Any] = []
    monkeypatch.setattr(paper_figures, "TILE", 40)
    monkeypatch.setattr(paper_figures, "draw_scene", lambda *_: None)
    monkeypatch.setattr(paper_figures, "save_figure", lambda figure, *_, **__: drawn.append(figure))
    some = [run for run in runs if not run.case and run.scenario.motion == "ear-to-ear"]
    paper_figures.draw_all(tmp_path, PaperRuns(some), note="quick run")
    forces = [axes for axes in drawn[0].axes if axes.get_title(loc="left") in OPTIONS.methods]
    assert len(forces) == 2 and len({axes.get_ylim() for axes in forces}) == 1
    assert "quick run" in [text.get_text() for text in drawn[0].texts]
    # With four methods, too, no title, legend or note stands on another.
    more = [
        replace(run, options=replace(run.options, method=name)) for run in some for name in ("progressive", "penalty")
    ]
    paper_figures.draw_all(tmp_path, PaperRuns((*some, *more[:2])), note="quick run")
    figure = drawn[1]
    named = [text for axes in figure.axes for text in (axes._left_title, axes.title, *axes.texts)]
    boxes = [(text.get_text(), text.get_window_extent()) for text in (*named, *figure.texts) if text.get_text()]
    boxes.append(("legend", figure.legends[0].get_window_extent()))
    assert sum(name in METHODS for name, _ in boxes) >= 4
    for (one, box), (other, beside) in itertools.combinations(boxes, 2):
        assert not box.overlaps(beside), (one, other)


def test_coupled_stays_out_and_touches_what_the_scenes_name(runs: PaperRuns) -> None:
    assert row(runs, "depth")["ours"] <= 1e-6
    assert row(runs, "touches")["ours"] == 0.0
    assert sum(len(run.touches) for run in runs.of("coupled", "11")) == 1 + 2 + 6


def test_the_margin_brings_about_as_many_contacts_as_the_paper_states(runs: PaperRuns) -> None:
    for found in (run for run in runs if run.case):
        count = found.candidates[held_ticks(found.stage)].mean()
        assert count == pytest.approx(found.wanted, rel=0.1)


def test_a_repetition_that_differs_is_an_error(runs: PaperRuns) -> None:
    run = replace(runs[0], digest="other", times=[])
    with pytest.raises(HhsimError, match="a repetition gave another hand"):
        play_again(run)


def test_only_our_methods_have_bars_and_what_is_not_measured_keeps_none() -> None:
    def judged(ours: float, bar: float = 1e-6, paper: float = 1e-4, method: str = "coupled") -> Row:
        return paper_row("depth", method, ours, label="depth", paper=paper, bar=bar)

    one, nan = judged(5e-7), math.nan
    assert one["passed"] and one["ratio"] == pytest.approx(200.0)
    rows = [one, judged(2e-6), judged(nan), judged(2e-6, method="paper"), judged(2e-6, nan)]
    assert OPTIONS.missed(rows) == ["depth, coupled: 2.000 µm, bar 1.000 µm", "depth, coupled: —, bar 1.000 µm"]
    assert judged(0.0)["ratio"] == math.inf and math.isnan(judged(5e-7, paper=nan)["ratio"])


def test_instances_are_different_hands_and_the_same_again_for_the_same_seed() -> None:
    tree = cached_sphere_tree(load_object("cube").mesh, TreeOptions(level=3))
    scenario = Scenario("15", "cube", "pinch", "TF", 4)
    one, again, other = (make_stage(scenario, HAND, tree, 4, seed) for seed in (0, 0, 1))
    places = [motion.position[-1] for motion in one.motions]
    assert len(places) == 4
    assert min(np.linalg.norm(a - b) for i, a in enumerate(places) for b in places[:i]) > 1e-4
    for mine, same in zip(one.motions, again.motions):
        assert mine.position.tobytes() == same.position.tobytes()
        assert mine.flexion.tobytes() == same.flexion.tobytes()
    assert not np.array_equal(one.motions[0].position, other.motions[0].position)
    run = play(one, SolverOptions())
    assert len(run.touches) == 4 * 2 and run.missed == []
    assert run.depth.max() <= 1e-6 and not run.variation and run.curves is None


def test_a_glove_s_samples_are_held_and_flicker_by_a_count(monkeypatch: pytest.MonkeyPatch) -> None:
    given: list[HandConfiguration] = []

    spy = Mock(run=lambda *posed: given.append(HandConfiguration(*posed)))
    monkeypatch.setattr(summary, "HandSolver", lambda *_: spy)
    flexion = np.random.default_rng(3).uniform(0.0, 1.0, (5, 3))
    held = still(np.zeros(3), flexion=flexion, ticks=500)
    tree = cached_sphere_tree(load_object("cube").mesh, TreeOptions(level=1)).arrays()
    for noise, rate in NOISES.values():
        summary.trembling_hold(HAND, tree, SolverOptions(), held, held, 1000.0, 0, noise, rate)
    glove, trembling = given
    count = 2.0 * np.pi / COUNTS
    for poses in given:
        new = np.flatnonzero(np.any(np.diff(poses.flexion, axis=0) != 0.0, axis=(1, 2))) + 1
        assert set(new % 5) == {0} and len(new) > 50
        off = (poses.flexion - flexion) / count
        assert np.abs(off).max() <= 2.0 and np.abs(off).mean() < 0.5
        assert np.allclose(poses.flexion / count, np.round(poses.flexion / count), atol=1e-6)
    assert not glove.position.any() and np.array_equal(glove.orientation, held.orientation)
    assert np.linalg.norm(trembling.position, axis=1).max() == pytest.approx(1e-4, rel=0.05)
    assert GLOVE.tremor_position == 0.0


@pytest.mark.soak
def test_the_command_writes_tables_and_pictures_and_says_what_it_missed(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("hhsim.bench.paper.figures.TILE", 60)
    monkeypatch.setattr("hhsim.render.viewpoint.AZIMUTHS", (0, 90))
    scene = ("--quick", "--object", "hexagonal-prism", "--method", "coupled")
    arguments = (*scene, "--instances", "1", "--repetitions", "1")
    answer = run("bench", "paper", *arguments, "--out", "paper.json", "--plot", "figures", "--json")
    document = json.loads(answer.out)
    assert answer.code == (1 if document["missed"] else 0)
    table = json.loads((tmp_path / "paper.json").read_text())
    assert [one["row"] for one in table["rows"]] == [one["row"] for one in document["rows"]]
    begins = {".png": b"\x89PNG", ".pdf": b"%PDF", ".svg": b"<?xml"}
    assert {Path(path).name for path in document["pictures"]} == {
        f"{name}{kind}" for name in ("fig11", "fig12-hexagonal-prism") for kind in begins
    }
    for path in map(Path, document["pictures"]):
        assert path.read_bytes().startswith(begins[path.suffix])
    # Text of a PDF is TrueType letters, a curve of an SVG is a path, and neither has a date.
    pdf, svg = (tmp_path / "figures" / f"fig12-hexagonal-prism{kind}" for kind in (".pdf", ".svg"))
    assert b"/CIDFontType2" in pdf.read_bytes() and b"CreationDate" not in pdf.read_bytes()
    assert "<dc:date>" not in svg.read_text() and svg.read_text().count('<path d="M') > 10
    again = run("bench", "paper", *arguments, "--out", "paper.json")
    assert "mean tick, hexagonal-prism" in again.out and "0.48 ms" in again.out
    assert ("missed: " in again.out) == (again.code == 1)
    assert ("index force and named touches have no bar here" in again.out) == (again.code == 0)
