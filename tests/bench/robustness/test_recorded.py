"""The suite `recorded`: what its rows say of a run is what its ticks show, and what cannot be run is told."""

import json
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from recording_samples import smooth_recording
from sphere_scenes import brute_clearance

from hhsim.bench.robustness.recorded import (
    COLUMNS,
    BenchObject,
    RecordedFigures,
    RecordedOptions,
    bench_recorded,
    recording_files,
    totals,
)
from hhsim.bench.robustness.safety import longest_run
from hhsim.bench.table import load_table
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.kernels.tick.block import TickRecord
from hhsim.kernels.tick.state import STATUS_STUCK, WORK_TOUCHING
from hhsim.mesh.catalogue import load_object
from hhsim.motion.file import save_trajectory
from hhsim.motion.trajectory import Trajectory
from hhsim.recordings.cleaning import clean_recording
from hhsim.scene.recorded_grasp_pose import place_at_grasp
from hhsim.scene.scene import make_scene
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.options import SolverOptions
from hhsim.table.table import Table
from hhsim.trees.cache import cached_sphere_tree
from hhsim.trees.options import TreeOptions

Run = Callable[..., Any]
HAND = HandModel.default()
COUPLED, PROGRESSIVE = SolverOptions(), SolverOptions(method="progressive")
LARGEST = 1e-6
HERE = RecordedOptions(place="recorded")


@cache
def bench_object(name: str = "cup") -> BenchObject:
    mesh = load_object(name).mesh
    return BenchObject(name, mesh, cached_sphere_tree(mesh, TreeOptions(level=3)))


@cache
def grasp(samples: int = 60) -> Trajectory:
    """A smooth hand that closes in the middle."""
    motion = clean_recording(smooth_recording(samples, rate=50.0)).trajectory
    closure = np.interp(np.arange(samples), [0, samples // 3, samples // 2, samples - 1], [0.0, 0.0, 1.1, 1.0])
    flexion = np.clip(0.1 + closure[:, None, None] * np.array([0.7, 1.0, 0.6]) + 0.0 * motion.flexion, -0.2, 1.5)
    return replace(motion, flexion=flexion, position=0.3 * motion.position, name="grasp", flags=None)


@cache
def placed() -> Trajectory:
    """The grasp, the cup in it."""
    return place_at_grasp(grasp(), HAND, bench_object().tree).motion


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two recordings, one of them slower and as CSV, and what is none."""
    inside = tmp_path / "recordings"
    inside.mkdir()
    save_trajectory(placed(), inside / "a.h5")
    save_trajectory(replace(grasp(40), name="b"), inside / "b.csv")
    (inside / "README.md").write_text("about them")
    return inside


def deepest(record: TickRecord, at: BenchObject, motion: Trajectory, ticks: NDArray[np.int64]) -> float:
    """Least distance of the shown hand to all leaves over some ticks [m], leaf by leaf."""
    from hhsim.hand.quaternion import rotation_matrix

    center = at.tree.leaf_center @ rotation_matrix(motion.object_orientation).T + motion.object_position
    palm = HAND.palm_tree
    sizes = at.tree.leaf_radius, HAND.radius, palm.leaf_center, palm.leaf_radius
    shown = record.joints[ticks], record.position[ticks], record.orientation[ticks]
    return float(brute_clearance(center, *sizes, *shown).min())


@pytest.mark.soak
def test_a_row_says_what_the_ticks_show(folder: Path) -> None:
    at = bench_object()
    for solver in (COUPLED, PROGRESSIVE):
        (row,) = bench_recorded([folder / "a.h5"], [at], [solver], HERE)
        motion = placed()
        ticks = make_scene(at.mesh, at.tree, HAND, motion).hands[0].ticks
        tree = make_scene(at.mesh, at.tree, HAND, motion).solids[0].placed_tree.arrays()
        record = HandSolver(HAND, tree, solver).run(ticks.position, ticks.orientation, ticks.flexion, ticks.abduction)
        touching = np.flatnonzero(record.work[:, WORK_TOUCHING] > 0)[:: max(1, ticks.tick_count // 40)]
        assert row.ticks == ticks.tick_count and row.samples == 60
        assert deepest(record, at, motion, touching) >= -LARGEST and row.penetration <= LARGEST
        assert row.touching > 50
        size = np.linalg.norm(record.total, axis=1)
        before, change = size[:-1], np.abs(np.diff(size))
        defined = before >= 0.01
        assert row.variation_tick == pytest.approx(100.0 * (change[defined] / before[defined]).mean())
        new = size[np.flatnonzero(np.diff(ticks.input_seq, prepend=-1))]
        kept = new[:-1] >= 0.01
        expected = 100.0 * (np.abs(np.diff(new))[kept] / new[:-1][kept]).mean()
        assert row.variation_sample == pytest.approx(expected)
        assert row.stuck == int((record.status & STATUS_STUCK > 0).sum()) and row.lag == record.lag.max()
        assert row.safe and row.missed and row.floats, "the spheres of level 3 are 3 mm off the cup's thin wall"
        assert 0.0 < row.cpu_p50 <= row.cpu_p99 <= row.cpu_max


@pytest.mark.soak
def test_rate_hold_and_a_window_around_the_grasp(folder: Path) -> None:
    at, file = bench_object(), folder / "a.h5"
    whole, held, slow, window = (
        next(bench_recorded([file], [at], [COUPLED], options))
        for options in (HERE, replace(HERE, mode="hold"), replace(HERE, rate=250.0), RecordedOptions(ticks=100))
    )
    assert held.fastest > 5.0 * whole.fastest, "a held sample comes at a jump"
    assert abs(4 * slow.ticks - whole.ticks) <= 4 and slow.rate == 250.0
    assert slow.fastest == pytest.approx(4.0 * whole.fastest, rel=0.2)
    assert window.ticks == 100 and window.touching > 10, "the window is where the hand grasps"
    assert all(row.penetration <= LARGEST for row in (whole, held, slow, window))


def test_what_cannot_be_run_is_a_row_with_the_reason(folder: Path) -> None:
    (folder / "c.h5").write_bytes(b"no HDF5 at all")
    rows = list(bench_recorded(recording_files([folder]), [bench_object()], [COUPLED], replace(HERE, ticks=50)))
    assert [row.recording for row in rows] == ["a", "b", "c"]
    assert rows[2].missed and "c.h5: not an HDF5 file" in rows[2].reason and not rows[0].reason
    (whole,) = totals(rows)
    assert whole.recording == "all 2" and whole.ticks == 100
    assert whole.touching == rows[0].touching + rows[1].touching
    assert whole.fastest == max(rows[0].fastest, rows[1].fastest)
    assert Table(COLUMNS, [rows[2]]).records[0].keys() == {column.name for column in COLUMNS}


def test_a_method_that_penetrates_or_stands_still_for_nothing_misses_its_bar() -> None:
    good = RecordedFigures(recording="a", object="cup", method="coupled", penetration=1e-6)
    assert good.safe and not good.missed
    for fault in ({"penetration": 1.1e-6}, {"not_finite": 1}, {"unexplained": 1}):
        bad = replace(good, **fault)
        assert not bad.safe and bad.missed and not replace(bad, method="paper").missed
    assert replace(good, penetration=float("nan")).missed
    floating = replace(good, contact_error_max=1.1e-3)
    assert floating.safe and floating.missed and not replace(good, contact_error_max=0.9e-3).missed
    assert replace(good, stuck=3).safe, "a hand that nothing could move is stuck and safe"
    assert [longest_run(np.array(run, bool)) for run in ([], [0, 0], [1], [1, 1, 0, 1, 1, 1])] == [0, 0, 1, 3]


def test_a_hand_that_stands_still_beside_a_way_is_found(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = HandSolver.run

    def lazy(self: HandSolver, *motion: Any) -> TickRecord:
        record = run(self, *motion)
        if len(record.status) < 60:
            return record
        for values in HandConfiguration.of(record):
            values[20:23] = values[19]
        record.joints[20:23] = record.joints[19]
        record.status[20:23] |= STATUS_STUCK
        return record

    monkeypatch.setattr(HandSolver, "run", lazy)
    (row,) = bench_recorded([folder / "a.h5"], [bench_object()], [COUPLED], replace(HERE, ticks=60))
    assert (row.stuck, row.longest_stuck, row.unexplained) == (3, 3, 3) and row.missed


def test_on_the_mesh_the_hand_touches_the_mesh_itself(folder: Path) -> None:
    solvers = [SolverOptions(surface=surface) for surface in ("spheres", "mesh")]
    rows = list(bench_recorded([folder / "a.h5"], [bench_object()], solvers, replace(HERE, rate=250.0)))
    spheres, mesh = rows
    assert (spheres.surface, mesh.surface) == ("spheres", "mesh")
    assert mesh.safe and not mesh.missed and mesh.penetration == 0.0
    assert mesh.touching > 50
    assert mesh.contact_error_max < 2e-6 < 1e-3 < spheres.contact_error_max
    assert [(row.surface, row.ticks) for row in totals(rows)] == [(row.surface, row.ticks) for row in rows]


@pytest.mark.soak
def test_the_command(run: Run, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hhsim.scene.demonstration.TURNS", 4)
    where = ("bench", "recorded", "recordings", "--object", "cup", "--ticks", "60", "--out", "t.h5")
    answer = run(*where)
    assert answer.code == 0, answer.err
    assert "recorded hands, 1000 ticks a second" in answer.out and "no limit missed" in answer.out
    assert answer.out.count("progressive") == 3, "a row a recording and the total"
    table = load_table(tmp_path / "t.h5")
    assert table.suite == "recorded" and len(table.rows) == 4 and (tmp_path / "t.csv").exists()
    assert all(row["penetration"] <= LARGEST for row in table.rows)
    (folder / "c.npz").write_bytes(b"nothing")
    answer = run(*where, "--json", "--method", "coupled", "--place-object", "recorded")
    document = json.loads(answer.out)
    assert answer.code == 1 and document["missed"] and len(document["rows"]) == 3 and len(document["totals"]) == 1


def test_an_interrupt_keeps_the_runs_that_are_done(
    folder: Path, run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: Any) -> Any:
        yield RecordedFigures(recording="a", object="cup", method="coupled", penetration=0.0)
        raise KeyboardInterrupt

    monkeypatch.setattr("hhsim.bench.robustness.recorded.bench_recorded", interrupted)
    answer = run("bench", "recorded", str(folder), "--object", "cup", "--out", "table.h5")
    assert (answer.code, answer.out) == (130, "")
    assert "interrupted; what ran so far, 1 in all, is in table.h5" in answer.err
    assert load_table(tmp_path / "table.h5").rows[0]["recording"] == "a"
    assert (tmp_path / "table.csv").is_file()
