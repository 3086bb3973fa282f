"""Cells on Dask: the same files as in processes, what fails, and one line where Dask or its scheduler is missing."""

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from sweep_plans import PLAN, without_times, write_plan

from hhsim.errors import InputError
from hhsim.sweep import engines
from hhsim.sweep.engines import run_on_dask, run_with_client
from hhsim.sweep.input_files import source_digest
from hhsim.sweep.plan import load_plan
from hhsim.sweep.sweep import CellTask, SweepFolder, run_sweep

ignored = pytest.mark.filterwarnings("ignore")
"""What a cluster warns of when it ends is its own affair."""


def tasks(tmp_path: Path, folder: str, text: str = PLAN) -> list[CellTask]:
    plan = load_plan(write_plan(tmp_path, text))
    (tmp_path / folder).mkdir()
    more: dict[str, Any] = {"wants_core": False, "sources": source_digest(), "folder": str(tmp_path / folder)}
    return [CellTask(cell=cell, digest=digest, **more) for digest, cell in plan.cells.items()]


@ignored
def test_a_cluster_makes_the_same_files(tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed")
    here, there = tasks(tmp_path, "here"), tasks(tmp_path, "there")
    assert not any(task.run().reason for task in here)
    lost = replace(there[0], digest="lost", sources="another")
    with (
        distributed.LocalCluster(
            n_workers=1, threads_per_worker=2, processes=False, dashboard_address=None, protocol="inproc"
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        ends = {end.digest: end for end in run_with_client(client, [*there, lost])}
    assert "is another one" in ends["lost"].reason
    assert {end.reason for digest, end in ends.items() if digest != "lost"} == {""}
    names = sorted(path.name for path in (tmp_path / "here").iterdir())
    assert names == sorted(path.name for path in (tmp_path / "there").iterdir())
    for name in (name for name in names if name.endswith(".h5")):
        assert without_times(tmp_path / "here" / name) == without_times(tmp_path / "there" / name)


@ignored
@pytest.mark.soak
def test_a_cluster_of_two_processes_is_started_here(tmp_path: Path) -> None:
    pytest.importorskip("distributed")
    folder = SweepFolder(tmp_path / "out")
    plan = load_plan(write_plan(tmp_path))
    found = run_sweep(plan, folder, jobs=2, scheduler=engines.LOCAL)
    assert (found.run, found.failed) == (2, {})


def test_without_dask_one_line_says_how_to_get_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    plan = load_plan(write_plan(tmp_path))
    with pytest.raises(InputError, match=r"pip install 'hhsim\[sweep\]'; without it, --jobs N"):
        run_sweep(plan, SweepFolder(tmp_path / "out"), scheduler="tcp://127.0.0.1:1")
    assert not (tmp_path / "out").exists()


@ignored
def test_a_scheduler_that_is_not_there_is_told_in_a_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr(engines, "PATIENCE", 0.2)
    task: list[Any] = tasks(tmp_path, "out")[:1]
    for address in ("tcp://127.0.0.1:9", "nowhere at all"):
        with pytest.raises(InputError, match=f"no Dask scheduler at {address}"):
            list(run_on_dask(task, address, 1))
