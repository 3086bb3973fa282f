"""The suite `stress`: its figures are those of the ticks, a planted fault is missed by no count, and kept."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import sampled
from sphere_scenes import bumpy_ball, record_clearance

from hhsim.bench.robustness.objects import ball_mesh
from hhsim.bench.robustness.random_targets import StressOptions
from hhsim.bench.robustness.safety import BLOCK, is_safe, recorded_penetration
from hhsim.bench.suite import Row
from hhsim.bench.suites import stress
from hhsim.bench.suites.stress import StressCase, run_case
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.kernels.tick.block import TickRecord
from hhsim.kernels.tick.state import STATUS_LAG, WORK_TOUCHING
from hhsim.motion.analytic_motion import hold_readings
from hhsim.motion.file import load_trajectory
from hhsim.solver.method import METHODS
from hhsim.solver.options import UNBOUNDED, SolverOptions
from hhsim.solver.solver import HandSolver

pytestmark = pytest.mark.slow

HAND = HandModel.default()
BALL = bumpy_ball(300)
TIMES = {"cpu_p50", "cpu_p99", "cpu_max"}
TICKS = BLOCK + 700
"""More than a block, so that what is carried from one to the next is carried."""


@pytest.fixture(autouse=True)
def failures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(stress, "FAILURES", tmp_path / "failures")
    return tmp_path / "failures"


def case(method: str = "coupled", ticks: int = TICKS, wild: bool = False, surface: str = "spheres") -> StressCase:
    ball = {"object": "ball", "tree": BALL, "mesh": ball_mesh(subdivisions=3)}
    solver = SolverOptions(method=method, surface=surface)
    return StressCase(**ball, solver=solver, stress=StressOptions(wild=wild), seed=4, ticks=ticks)


class Planted(HandSolver):
    """Faults at chosen ticks of a long run, and wherever a fresh solver meets the same input."""

    def run(self, *haptic: Any) -> TickRecord:
        record = super().run(*haptic)
        position, _, flexion, _ = haptic
        right = (record.work[:, WORK_TOUCHING] > 0) & (position[:, 0] > 0.02)
        inside = np.flatnonzero(right & (flexion[:, 1, 0] > 0.9))
        center = self.workspace.center()
        record.joints[inside, 1] += center - record.joints[inside, 1, 1:2]
        record.position[inside] = center
        record.total[right & (flexion[:, 4, 1] > 1.6), 1] = np.inf
        return record


@pytest.mark.parametrize("method", sampled(["coupled", "progressive"], lambda _, method: method == "coupled"))
def test_the_figures_are_those_of_the_ticks(method: str) -> None:
    figures = run_case(case(method))
    motion = case(method).targets().take(TICKS)
    record = case(method).begin()[0].run(*motion)
    clearance = record_clearance(HAND, BALL, record)
    assert clearance.min() > -1e-6
    assert figures["penetration"] == max(0.0, -clearance.min())
    assert figures["lagging"] == (record.status & STATUS_LAG > 0).sum() > 50
    assert figures["touching"] == (record.work[:, WORK_TOUCHING] > 0).sum() > 500
    assert figures["ticks"] == TICKS
    assert figures["safe"] and figures["failures"] == ""
    assert not is_safe({**figures, "unexplained": 1})


def replayed_failures(figures: Row, again: StressCase) -> dict[str, int]:
    """Ticks of each kept motion that fail when it runs again from its file, by the kind of failure."""
    found = {}
    for text in figures["failures"].split("; "):
        kind, path = text.partition(" at tick ")[0], Path(text.split()[text.split().index("replay") + 2])
        motion = HandConfiguration.of(load_trajectory(path).resampled(1000.0, "hold"))
        solver, safety = again.begin()
        record = solver.run(*motion)
        depth = recorded_penetration(HAND, solver.workspace.surface, record).depth
        found[kind] = int(safety.add(hold_readings(motion), record, depth)[kind].sum())
    return found


def test_planted_faults_are_counted_and_kept_to_be_replayed(monkeypatch: pytest.MonkeyPatch, failures: Path) -> None:
    wanted = case()
    sound = replace(wanted)
    monkeypatch.setattr(stress, "HandSolver", Planted)
    # A hand that snaps takes many ticks to where a fault is planted.
    wanted = replace(wanted, solver=replace(wanted.solver, snap_speed=UNBOUNDED))
    figures = run_case(wanted)
    record = wanted.begin()[0].run(*wanted.targets().take(TICKS))
    deep = -record_clearance(HAND, BALL, record)
    over = (deep > 1e-6).any(axis=1)
    assert figures["penetrating"] == over.sum() > 0
    assert figures["penetration"] == pytest.approx(deep.max(), rel=1e-12)
    assert figures["not_finite"] == np.isinf(record.total).any(axis=1).sum() > 0
    assert not figures["safe"]
    first = f"penetration at tick {over.argmax():,}: hhsim replay ball {failures}/ball-coupled-penetration-seed4"
    assert figures["failures"].startswith(first) and "--method coupled --samples hold" in figures["failures"]
    found = replayed_failures(figures, wanted)
    assert set(found) == {"penetration", "not finite"} and min(found.values()) > 0
    monkeypatch.setattr(stress, "HandSolver", HandSolver)
    assert set(replayed_failures(figures, sound).values()) == {0}


def test_the_command_writes_its_table_and_prints_it_with_rows_for_each_surface(run: Any, tmp_path: Path) -> None:
    words = ("bench", "stress", "cube", "--ticks", "120", "--seed", "3")
    answer = run(*words, "--surface", "spheres,mesh", "--out", "stress.json")
    # A first run tells of compilation.
    assert (answer.code, "error" in answer.err, "warning" in answer.err) == (0, False, False)
    table = json.loads((tmp_path / "stress.json").read_text())
    rows = [(row["method"], row["surface"]) for row in table["rows"]]
    assert rows == [*((method, "spheres") for method in METHODS), ("coupled", "mesh"), ("progressive", "mesh")]
    assert table["options"]["seed"] == 3
    lines = answer.out.splitlines()
    assert sum(line.startswith("cube ") for line in lines) == len(rows)
    assert {"coupled: no limit missed", "coupled on the mesh: no limit missed"} <= set(lines)
    assert lines[-1] == "the table is in stress.json and stress.csv"
    again = run(*words, "--method", "coupled", "--json", "--out", "again.json")
    document = json.loads(again.out)
    assert (again.code, document["missed"], document["table"]) == (0, [], "again.json")
    for row, before in zip(document["rows"], table["rows"]):
        assert {n: v for n, v in row.items() if n not in TIMES} == {n: v for n, v in before.items() if n not in TIMES}


def test_the_command_tells_a_missed_limit_and_how_to_see_it(
    run: Any, monkeypatch: pytest.MonkeyPatch, failures: Path
) -> None:
    monkeypatch.setattr(stress, "HandSolver", Planted)
    words = ("bench", "stress", "cube", "--method", "coupled", "--ticks", "3000", "--level", "2", "--margin", "1.5")
    answer = run(*words, "--seed", "1")
    assert answer.code == 1
    assert "missed: cube, coupled, spheres" in answer.out.splitlines()
    (line,) = (line for line in answer.out.splitlines() if "hhsim replay" in line)
    assert line.endswith("--method coupled --samples hold --level 2 --margin 1.5")
    assert line.count("hhsim replay") == len(list(failures.iterdir())) > 0
