"""The board: what is merged, what is marked, and the same numbers in every file."""

import csv
import io
import json
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from sealed_change import changed
from short_grasp import short_result

from hhsim.board.entry import FAILED, Board, Entry, collect, entry_of_result, merged, option_words
from hhsim.board.standings import standings
from hhsim.board.table_file import content_of, entry_table, standing_table
from hhsim.errors import InputError
from hhsim.metrics.run.registry import run_metrics
from hhsim.replay.verdict import OK, UNTOUCHED
from hhsim.result.reader import Result
from hhsim.table.table import Table

A, B = (json.dumps({"cpu": name, "cores": 2, "system": "Linux", "python": "3.12"}) for name in ("one", "other"))
USUAL = {"penetration_max": 0.0, "contact_error_max": 1e-4, "stuck_ticks": 0.0}
USUAL |= {"tick_cpu_p50": 1e-5, "tick_cpu_p99": 3e-5}


def entry(method: str = "coupled", machine: str = A, motion: str = "grasp", **figures: float) -> Entry:
    return Entry(
        object="cube",
        motion=motion,
        method=method,
        surface="spheres",
        options="",
        machine=machine,
        created="2026-01-01T00:00:00Z",
        own_core=True,
        verdict=OK,
        figures={**USUAL, **figures},
        source=f"{method}.h5",
    )


def marked(*entries: Entry) -> set[tuple[str, str]]:
    board = merged(entries)
    return {(one.method, board.machines[one.machine]) for one in standings(board) if one.first}


def shown(table: Table, heading: str) -> list[str]:
    """The cells of a column."""
    return [row[table.headings.index(heading)] for row in table.cells]


def text_of(board: Board, kind: str) -> str:
    """What a file of this kind holds."""
    return content_of(Path(f"board{kind}"), board, standings(board)).decode()


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Result:
    return short_result(tmp_path_factory.mktemp("board") / "short.h5", linearisations=3)


def test_of_a_run_that_is_done_again_the_last_one_counts() -> None:
    early, late = entry(stuck_ticks=1.0), replace(entry(stuck_ticks=2.0), created="2026-01-02T00:00:00Z")
    board = merged([late, early, entry(machine=B, stuck_ticks=3.0)])
    assert [one.figures["stuck_ticks"] for one in board.entries] == [2.0, 3.0]
    assert board.machines == {A: "A", B: "B"}
    assert board.notes[0].startswith("1 result left out: of the same object") and "coupled.h5" in board.notes[0]


def test_the_name_of_a_set_of_options_and_what_touched_nothing_are_told() -> None:
    bare = replace(entry(), option_set="coarse", options="level=2", verdict=UNTOUCHED)
    board = merged([bare, replace(entry(motion="pinch"), option_set="coarse", options="level=2"), entry()])
    assert shown(standing_table(board, standings(board)), "options") == ["coarse: level=2", "usual"]
    assert shown(entry_table(board), "options")[1] == "coarse: level=2"
    assert board.notes == ("nothing touched in 1 run, of which depth, contacts and forces say nothing",)
    rows = csv.DictReader(io.StringIO(text_of(board, ".csv")))
    assert [row["option_set"] for row in rows] == ["", "coarse", "coarse"]


def test_a_result_of_two_sets_of_options_counts_in_the_row_of_each() -> None:
    """The sphere's own level is 3, the cube's 4: each result is computed once, and has two names."""
    own = replace(entry(), option_set="usual = four")
    three = replace(entry(contact_error_max=3e-4), option_set="three", options="level=3")
    ball = replace(entry(), object="sphere", option_set="usual = three")
    four = replace(ball, option_set="four", options="level=4")
    rows = {one.options: one for one in standings(merged([own, three, ball, four]))}
    assert {name: one.scenes for name, one in rows.items()} == {"usual": 2, "four: level=4": 2, "three: level=3": 2}
    assert rows["three: level=3"].off_mesh == 3e-4
    # One name of two plans that mean different things by it is two rows.
    apart = standings(merged([replace(own, option_set="mine"), replace(three, option_set="mine")]))
    assert {one.options: one.scenes for one in apart} == {"mine": 1, "mine: level=3": 1}
    # Names of one result in two sweeps are both kept, and neither row beats the other.
    later = replace(own, option_set="own", created="2026-01-02T00:00:00Z")
    both = standings(merged([replace(own, option_set="usual"), later]))
    assert [(one.options, one.first) for one in both] == [("usual", True), ("own", True)]


def test_a_failure_counts_until_it_worked() -> None:
    failed = replace(entry("paper"), verdict=FAILED, figures={}, reason="no way")
    board = merged([entry(), failed, replace(failed, method="coupled")])
    assert [one.method for one in board.failed] == ["paper"]
    assert "no way" in text_of(board, ".csv")
    assert board.notes[-1].endswith("count in no figure: 1, first: cube, grasp, paper, spheres: no way")


def test_errors_compare_across_machines_and_what_differs_is_told() -> None:
    assert merged([entry(), entry(machine=B)]).notes == ()
    (note,) = merged([entry(), entry(machine=B, contact_error_max=1.1e-4)]).notes
    assert note.endswith("in 1 of 1 runs that several did, first: cube, grasp, coupled, spheres (contact_error_max)")


def test_the_frontier_is_of_one_machine_and_of_the_same_scenes() -> None:
    slow, near = entry("progressive", tick_cpu_p50=2e-5), entry("paper", tick_cpu_p50=2e-5, contact_error_max=5e-5)
    assert marked(entry(), slow, near) == {("coupled", "A"), ("paper", "A")}
    # As good but for a depth: the faster one does not beat it, and less than a micrometre is none.
    assert marked(entry(penetration_max=1e-5), slow) == {("coupled", "A"), ("progressive", "A")}
    assert marked(entry(penetration_max=1e-7), slow) == {("coupled", "A")}
    nearer = entry("progressive", tick_cpu_p50=2e-5, tracking_excess=1.0)
    assert len(marked(entry(tracking_excess=2.0), nearer)) == 2
    below = entry("progressive", tick_cpu_p50=2e-5, tracking_excess=-3.0)
    assert marked(entry(tracking_excess=2.0), below) == {("coupled", "A")}, "below the best is as wrong as above it"
    # Beaten on the other machine, times say nothing of this one.
    assert marked(entry(tick_cpu_p50=1e-6), replace(slow, machine=B)) == {("coupled", "A"), ("progressive", "B")}
    # Worst cases of other scenes do not compare.
    assert ("progressive", "A") in marked(entry(), replace(slow, motion="pinch"))
    # Times without a core of their own are on no frontier, nor is what has no times.
    assert marked(replace(entry(), own_core=False), slow) == {("progressive", "A")}
    timeless = replace(entry("submitted"), figures={"penetration_max": 0.0})
    assert marked(timeless, slow) == {("progressive", "A")}


def test_the_worst_scene_counts_and_missing_figures_are_missing() -> None:
    board = merged([entry(penetration_max=2e-6), entry(motion="pinch", penetration_max=9e-6, tick_cpu_p50=3e-5)])
    (one,) = standings(board)
    assert (one.scenes, one.depth, one.p50, one.off_mesh) == (2, 9e-6, 2e-5, 1e-4)
    bare = merged([replace(entry(), figures={}, own_core=False)])
    unknown = standing_table(bare, standings(bare))
    assert shown(unknown, "depth [µm]") == shown(unknown, "p50 [µs]") == ["—"]
    rough = merged([replace(entry(), own_core=False)])
    assert shown(standing_table(rough, standings(rough)), "p50 [µs]") == ["~10.0"]


def test_a_result_is_told_by_what_is_not_as_usual(result: Result) -> None:
    found = entry_of_result(result)
    assert (found.object, found.motion, found.method, found.surface) == ("cylinder", "short", "coupled", "spheres")
    assert found.options == "linearisations=3"
    assert not found.own_core
    assert found.figures["stuck_ticks"] == result.summary["stuck_ticks"]
    assert "seed" not in found.options and set(found.figures) <= set(run_metrics())
    scene = {**result.scene, "submission": {"name": "ours"}}
    assert entry_of_result(replace(result, scene=scene)).method == "ours"


def test_options_that_follow_from_others_are_not_told(result: Result) -> None:
    solver = result.scene["solver"]
    usual = {"object": "bunny", "level": 4, "rate": 1000.0, "solver": {**solver, "linearisations": 12}}
    assert option_words(usual) == ""
    scene = {"object": "bunny", "level": 3, "seed": 2, "ticks": 500, "tremor_mm_deg": [0.1, 0.2]}
    assert option_words(scene) == "level=3, seed=2, ticks=500, tremor_mm_deg=0.1/0.2"
    unknown = {**solver, "method": "nobody:Knows", "linearisations": 12, "stiffness": {"translation": 9.0}}
    assert option_words({"object": "mug.stl", "level": 4, "solver": unknown}) == "stiffness.translation=9"


def test_a_folder_of_results_is_read_and_what_is_none_is_told(result: Result, tmp_path: Path) -> None:
    (tmp_path / "one.h5").write_bytes(result.path.read_bytes())
    (tmp_path / "other.txt").write_text("no result")
    with changed(tmp_path / "one.h5") as file:
        file.attrs["complete"] = 0
    (tmp_path / "row.json").write_text("{}")
    board = collect([tmp_path, result.path, tmp_path / "row.json"])
    assert len(board.entries) == 1
    assert board.notes == (
        f"{tmp_path / 'one.h5'} is of a run that was stopped: left out",
        f"{tmp_path / 'row.json'} is left out: {tmp_path / 'row.json'}: no row of a sweep",
    )
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="no result in"):
        collect([tmp_path / "empty"])
    with pytest.raises(InputError, match="no such folder"):
        collect([tmp_path / "nowhere"])


def test_a_result_that_is_being_written_is_named_and_left_out(result: Result, tmp_path: Path) -> None:
    path = tmp_path / "run.h5"
    writes = "import h5py, sys; file = h5py.File(sys.argv[1], 'w'); file.flush(); print(flush=True); input()"
    command = [sys.executable, "-c", writes, str(path)]
    says = f"{path} is still being written by another process"
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as writer:
        assert writer.stdout is not None
        writer.stdout.readline()
        (note,) = collect([tmp_path, result.path]).notes
        assert says in note
        with pytest.raises(InputError, match=re.escape(says)):
            collect([tmp_path])


def test_every_file_has_the_same_runs() -> None:
    board = merged([entry(), entry("paper|er", machine=B, force_hold_mean=1.25)])
    rows = list(csv.DictReader(io.StringIO(text_of(board, ".csv"))))
    assert [row["method"] for row in rows] == ["coupled", "paper|er"]
    assert float(rows[0]["tick_cpu_p50 [s]"]) == 1e-5 and rows[0]["force_hold_mean [N]"] == ""
    assert rows[0]["times_comparable"] == "1" and rows[1]["machine"] == "B"
    text = text_of(board, ".md")
    assert "| paper\\|er |" in text and "- A: one, 2 cores, Linux, Python 3.12" in text
    page = text_of(board, ".html")
    assert "paper|er" in page and "script-src 'sha256-" in page


def timed(p50: float, std: float, **changes: object) -> Entry:
    times = {"tick_cpu_p50": std, "tick_cpu_p99": 2e-6}
    return replace(entry(tick_cpu_p50=p50), deviations=times, runs=5, **changes)  # type: ignore[arg-type]


def test_every_table_has_mean_and_deviation_of_cells_that_ran_repeatedly() -> None:
    board = merged([timed(1e-5, 3e-7), timed(3e-5, 4e-7, motion="pinch"), timed(8e-5, 9e-6, motion="slide")])
    (one,) = standings(board)
    assert (one.p50, one.p50_std, one.p99, one.p99_std) == (3e-5, 4e-7, 3e-5, 2e-6)
    (even,) = standings(merged(board.entries[:2]))
    assert even.p50 == pytest.approx(2e-5) and even.p50_std == pytest.approx(2.5e-7)
    assert shown(standing_table(board, [one]), "p50 [µs]") == ["30.00 ± 0.40"]
    assert shown(entry_table(board), "p50 [µs]")[0] == "10.00 ± 0.30"
    assert board.notes[-1].startswith("times of 3 of 3 results are means over 5 runs; ± is")
    rows = list(csv.DictReader(io.StringIO(text_of(board, ".csv"))))
    assert (float(rows[0]["tick_cpu_p50_std [s]"]), rows[0]["runs"]) == (3e-7, "5")
    for kind, time in ((".md", "30.00 ± 0.40"), (".html", "30.00 ± 0.40"), (".tex", r"30.00 $\pm$ 0.40")):
        assert time in text_of(board, kind)
    mixed = merged([timed(1e-5, 3e-7), entry(motion="pinch", tick_cpu_p50=3e-5)])
    assert "±" not in shown(standing_table(mixed, standings(mixed)), "p50 [µs]")[0]


def test_a_latex_table_is_balanced_and_everything_in_it_escaped() -> None:
    nasty = 'a_b & 50% of $x$ #1 {y} ~^<|>\\end{tabular} "q" --dash [z] *'
    board = merged([entry(nasty, machine=json.dumps({"cpu": "a\n\\b"})), entry(tracking_excess=-0.5)], ["50 %\nof it"])
    text = text_of(board, ".tex")
    lines = [line for line in text.splitlines() if not line.startswith("%")]
    assert "% note: 50 % of it" in text and r"% A: a \b" in text and "% ●: none that did" in text
    assert lines[0].startswith(r"\begin{tabular}{") and lines[-1] == r"\end{tabular}"
    columns = lines[0].removeprefix(r"\begin{tabular}{").removesuffix("}")
    rows = [line for line in lines if line.endswith(r"\\")]
    assert len(rows) == 3 and set(columns) == {"l", "r"}
    assert all(len(re.split(r"(?<!\\) & ", row)) == len(columns) for row in rows)
    assert "$-$0.50" in text
    assert (
        r"a\_b \& 50\% of \$x\$ \#1 \{y\} \textasciitilde{}\textasciicircum{}\textless{}\textbar{}\textgreater{}"
        r"\textbackslash{}end\{tabular\} ''q'' -{}-dash {[}z] {*}"
    ) in text
