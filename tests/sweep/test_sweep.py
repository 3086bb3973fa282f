"""A sweep: every cell is the replay that it stands for, what is done is not done again, what failed is."""

import csv
import json
import os
import re
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from conftest import Run
from linkage_samples import write_box
from sweep_plans import PLAN, without_times, write_plan

from hhsim.errors import OutputError
from hhsim.result.reader import load_result
from hhsim.sweep import engines
from hhsim.sweep.engines import CRASHED
from hhsim.sweep.input_files import CHANGED, source_digest
from hhsim.sweep.plan import load_plan
from hhsim.sweep.sweep import CellTask, SweepFolder, SweepSummary, cell_rows, run_sweep

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("read_here")]


@pytest.fixture
def in_this_process(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Run the cells here, one after the other; which ones."""
    ran: list[str] = []

    def here(tasks: Sequence[CellTask], jobs: int) -> Any:
        for task in tasks:
            ran.append(task.cell.label)
            yield task.run()

    monkeypatch.setattr(engines, "run_in_processes", here)
    return ran


def swept(path: Path, folder: Path, **options: Any) -> SweepSummary:
    return run_sweep(load_plan(path), SweepFolder(folder), **options)


def test_a_cell_is_what_hhsim_replay_makes(run: Run, tmp_path: Path, in_this_process: list[str]) -> None:
    path = write_plan(tmp_path, PLAN.replace("[options.usual]", "ticks = 180\n[options.usual]\nmargin = 0.002"))
    summary = swept(Path(path.name), tmp_path / "out")
    assert (summary.run, summary.failed, summary.ticks) == (2, {}, 360)
    cells = {row["cell"]["method"]: row for row in rows(tmp_path / "out")}
    for method in ("coupled", "penalty"):
        arguments = ("--method", method, "--level", "2", "--margin", "2", "--ticks", "180")
        answer = run("replay", "cylinder", "short.toml", *arguments, "--out", f"{method}.h5", "--quiet")
        assert answer.code == 0, answer.err
        result = tmp_path / "out" / "cells" / cells[method]["result"]
        assert without_times(result) == without_times(tmp_path / f"{method}.h5")
        assert cells[method]["summary"]["ticks"] == 180
        assert run("replay", f"{method}.h5").out.endswith("identical in every tick\n")
        assert cells[method]["own_core"] is hasattr(os, "sched_getaffinity")


def test_what_is_done_is_not_done_again(tmp_path: Path, in_this_process: list[str]) -> None:
    path, out = write_plan(tmp_path), tmp_path / "out"
    assert swept(path, out).run == 2
    again = swept(path, out)
    assert (again.run, again.done_before, len(in_this_process)) == (0, 2, 2)
    # What was half-written is swept up; a result that is gone is made again, and so is one whose row is gone.
    digests = sorted(row["digest"] for row in rows(out))
    (out / "cells" / f".{digests[0]}-ab.partial.h5").write_text("half")
    (out / "cells" / f"{digests[0]}.h5").unlink()
    (out / "cells" / f"{digests[1]}.json").unlink()
    assert swept(path, out).run == 2
    assert not list((out / "cells").glob(".*"))
    # Nor is a result whole of which a bit is another one.
    flipped = bytearray((out / "cells" / f"{digests[0]}.h5").read_bytes())
    flipped[len(flipped) // 2] ^= 1
    (out / "cells" / f"{digests[0]}.h5").write_bytes(flipped)
    assert swept(path, out).run == 1
    # Nor another cell's, whole, nor one whose row has a digit that it was not written with.
    shutil.copy(out / "cells" / f"{digests[1]}.h5", out / "cells" / f"{digests[0]}.h5")
    row = out / "cells" / f"{digests[1]}.json"
    flipped = bytearray(row.read_bytes())
    flipped[flipped.index(b"seconds") + len('seconds": ')] ^= 1
    row.write_bytes(flipped)
    assert swept(path, out).run == 2
    # Another plan in the same folder runs what is new in it, and its names count.
    wider = PLAN.replace("[options.usual]", "[options.coarse]").replace('"penalty"', '"penalty", "progressive"')
    third = swept(write_plan(tmp_path, wider), out, keep_results=False)
    assert (third.run, third.done_before) == (1, 2)
    assert {row["cell"]["options"] for row in rows(out)} == {"coarse"}
    assert [row["result"] for row in rows(out) if row["cell"]["method"] == "progressive"] == [None]
    # A row alone is enough until somebody wants the ticks.
    assert swept(tmp_path / "plan.toml", out, keep_results=False).run == 0
    assert swept(tmp_path / "plan.toml", out).run == 1


def test_a_cell_that_failed_is_tried_again(tmp_path: Path, in_this_process: list[str]) -> None:
    path = write_plan(tmp_path, PLAN.replace('"penalty"', '"outside_methods:Raises"'))
    out = tmp_path / "out"
    failing = {digest for digest, cell in load_plan(path).cells.items() if cell.method != "coupled"}
    for run, done_before in ((1, 0), (0, 1)):
        found = swept(path, out)
        assert (found.run, found.done_before) == (run, done_before)
        assert found.failed.keys() == failing and "ZeroDivisionError: of no use" in found.failed[failing.copy().pop()]
    assert in_this_process.count("cylinder, short, outside_methods:Raises, usual") == 2
    assert not list((out / "cells").glob(".*"))


@pytest.mark.parametrize("name", ["thing.obj", "short.toml", "hand.toml", "part.obj"])
@pytest.mark.quick("short.toml", "part.obj")
def test_a_file_that_is_replaced_is_kept_under_no_digest_but_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """The first cell runs before the file is replaced; with the old file back the other cells are run."""
    for file in ("thing.obj", "part.obj"):
        write_box(tmp_path / file, (0.05, 0.05, 0.06))
    (tmp_path / "hand.toml").write_text("hand_length = 0.19\n")
    (tmp_path / "bodies.toml").write_text('[[body]]\nname = "part"\nmesh = "part.obj"\nfixed = true\n')
    shape = "bodies.toml" if name == "part.obj" else "thing.obj"
    text = PLAN.replace("cylinder", shape).replace("level = 2", 'level = 2\nhand_file = "hand.toml"')
    text = text.replace("[opt", "ticks = 9\n[opt")
    path, out, before = write_plan(tmp_path, text), tmp_path / "out", (tmp_path / name).read_text()
    replaced = [True]

    def here(tasks: Sequence[CellTask], jobs: int) -> Any:
        for task in tasks:
            yield task.run()
            if replaced[0]:
                (tmp_path / name).write_text(before + "\n# another")

    monkeypatch.setattr(engines, "run_in_processes", here)
    first = swept(path, out)
    assert (first.run, list(first.failed.values())) == (1, [CHANGED])
    (kept,) = rows(out)
    replaced[0] = False
    (tmp_path / name).write_text(before)
    second = swept(path, out)
    assert (second.run, second.done_before, second.failed) == (1, 1, {})
    assert kept in rows(out) and len(rows(out)) == 2


def test_another_hhsim_or_a_folder_that_is_not_seen_fails_the_cell(tmp_path: Path) -> None:
    digest, cell = next(iter(load_plan(write_plan(tmp_path)).cells.items()))
    for folder, sources, said in (("", "another", "is another one"), ("no", source_digest(), "sees no folder")):
        task = CellTask(cell=cell, digest=digest, folder=str(tmp_path / folder), sources=sources)
        assert said in task.run().reason


def test_one_sweep_at_a_time_works_in_a_folder_and_no_other_files_are_there(tmp_path: Path) -> None:
    plan = load_plan(write_plan(tmp_path))
    one, other = SweepFolder(tmp_path / "out"), SweepFolder(tmp_path / "out")
    with one.taken(plan), pytest.raises(OutputError, match="another sweep works in"), other.taken(plan):
        pass
    with SweepFolder(tmp_path / "out").taken(plan):
        pass
    for path, message in ((tmp_path, "holds other files"), (tmp_path / "plan.toml", "is a file")):
        with pytest.raises(OutputError, match=message):
            SweepFolder(path)


@pytest.mark.soak
def test_times_of_cells_that_are_run_repeatedly_are_kept_and_more_runs_are_run(
    tmp_path: Path, in_this_process: list[str]
) -> None:
    out = tmp_path / "out"
    plan_of = {n: PLAN.replace("[options.usual]", f"repeat = {n}\n[options.usual]") for n in (1, 2, 3)}
    assert swept(write_plan(tmp_path, plan_of[2]), out).ticks == 2 * 2 * 200
    for row in rows(out):
        assert row["repeated"]["runs"] == 2
        assert load_result(out / "cells" / row["result"]).repeated == row["repeated"]
        assert row["repeated"]["times"]["tick_cpu_p50"]["std"] >= 0.0
    names = {path.name for path in (out / "cells").iterdir()}
    # Fewer are there already; more are run anew, in the same files.
    assert swept(write_plan(tmp_path, plan_of[1]), out).run == 0
    assert swept(write_plan(tmp_path, plan_of[3]), out).run == 2
    assert {row["repeated"]["runs"] for row in rows(out)} == {3}
    assert {path.name for path in (out / "cells").iterdir()} == names
    times = rows(out)[0]["repeated"]["times"]["tick_cpu_p50"]
    table = cell_rows(load_plan(tmp_path / "plan.toml"), SweepFolder(out), {})
    row = next(row for row in table if row["tick_cpu_p50"] == times["mean"])
    assert (row["tick_cpu_p50_std"], row["runs"]) == (times["std"], 3)


@pytest.mark.skipif(not hasattr(os, "sched_getaffinity"), reason="processes are watched on Linux")
def test_a_process_that_crashes_fails_one_cell_and_the_others_go_on(tmp_path: Path) -> None:
    path = write_plan(tmp_path, PLAN.replace('"penalty"', '"outside_methods:Crashes", "penalty"'))
    out = tmp_path / "out"
    found = swept(path, out, jobs=1)
    assert list(found.failed.values()) == [CRASHED]
    assert {row["cell"]["method"] for row in rows(out)} == {"coupled", "penalty"}
    assert not list((out / "cells").glob(".*"))


def rows(out: Path) -> list[dict[str, Any]]:
    return [json.loads(path.read_text()) for path in sorted((out / "cells").glob("*.json"))]


def test_a_sweep_from_dry_run_to_table(run: Run, tmp_path: Path, in_this_process: list[str]) -> None:
    more = "[options.deep]\nlevel = 3\nlinearisations = 9\n"
    planned = write_plan(tmp_path, PLAN.replace('"penalty"', '"outside_methods:Raises"') + more)
    answer = run("sweep", str(planned), "--dry-run")
    assert answer.code == 0, answer.err
    assert "4 cells: 0 done, 4 to run, 800 ticks" in answer.out
    assert not (tmp_path / "results").exists()
    answer = run("sweep", str(planned))
    assert answer.code == 1, answer.err
    assert "4 cells: 2 done now, 2 failed" in answer.out
    failed = "cylinder, short, outside_methods:Raises, deep"
    reason = "method 'outside_methods:Raises' fails: ZeroDivisionError: of no use (tick 2)"
    assert re.search(f"{failed} +level=3 linearisations=9 +{re.escape(reason)}", answer.out)
    assert re.search(r"cylinder +short +coupled +spheres +deep: level=3 linearisations=9 +within limits ", answer.out)
    assert "all figures of each cell are in results/small/table.csv" in answer.out and " ± " not in answer.out
    table = list(csv.DictReader((tmp_path / "results/small/table.csv").read_text().splitlines()))
    assert [row["verdict"] for row in table].count("failed") == 2
    assert {row["reason"] for row in table} == {reason, "", "contact_error_max"}
    document = json.loads(run("sweep", str(planned), "--json").out)
    assert (document["done_now"], document["done_before"], len(document["failed"])) == (0, 2, 2)
    done = [(row, told) for row, told in zip(document["rows"], table, strict=True) if row["verdict"] != "failed"]
    assert all(float(told["tick_cpu_p50 [s]"]) == row["tick_cpu_p50"] > 0.0 for row, told in done) and len(done) == 2
    quiet = run("sweep", str(planned), "--quiet")
    assert quiet.out == "" and len(document["failed"][0]["options"]) in (1, 2)
    assert quiet.err.splitlines()[0] == "hhsim: missed: 2 cells failed"
    assert f"hhsim: missed: {failed}: {reason}" in quiet.err.splitlines()[1:]
