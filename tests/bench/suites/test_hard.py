"""The judge of the hard cases is judged: planted faults are found, and no case can end the bench."""

import json
import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Run

from hhsim.bench.robustness.case import HardCase, HardRun
from hhsim.bench.robustness.objects import BALL_RADIUS, HALF, right_hand, tree_of
from hhsim.bench.robustness.safety import pieces_of, stuck_with_way_out
from hhsim.bench.suite import Row
from hhsim.bench.suites import hard as suite
from hhsim.bench.suites.hard import Cell, Hard, run_case
from hhsim.errors import HhsimError
from hhsim.hand.configuration import HandConfiguration
from hhsim.kernels.tick.block import TickRecord
from hhsim.kernels.tick.state import STATUS_STUCK
from hhsim.motion.analytic_motion import hold_readings, sound_samples, still
from hhsim.solver.options import SolverOptions
from hhsim.solver.solver import HandSolver

BALL = tree_of(np.zeros((1, 3)), BALL_RADIUS)
PIECES = pieces_of("spheres", None, BALL)
PRESS = still((0.0, -0.03, 0.15), flexion=HALF).line(still((0.0, -0.03, 0.03), flexion=HALF), 100).hold(40)
LAST = PRESS.ticks - 1


def pressed(seed: int) -> list[HardRun]:
    return [HardRun("palm on a ball", PRESS, BALL)]


CASE = HardCase("press", "a palm pressed on a ball", pressed)


class Faulty(HandSolver):
    """A solver whose record is spoiled at one tick."""

    fault = "none"

    def run(self, *haptic: Any) -> TickRecord:
        record = super().run(*haptic)
        tick = 120
        if self.fault == "penetration":
            record.joints[tick, ..., 2] -= 2e-6
            record.position[tick, 2] -= 2e-6
        elif self.fault == "nan":
            record.total[tick, 1] = np.nan
        elif self.fault == "lost":
            record.joints[tick] = np.nan
        elif self.fault == "limit":
            record.flexion[tick, 2, 1] = self.workspace.model.flexion_max[2, 1] + 1e-6
        elif self.fault == "stuck":
            # Kept where it was forty ticks before, far above the ball.
            for values in (record.position, record.joints):
                values[60] = values[20]
            record.status[60] |= STATUS_STUCK
        elif self.fault == "exception":
            raise ZeroDivisionError("float division")
        elif self.fault == "refusal":
            raise HhsimError("too much of it")
        return record


def rows_with(monkeypatch: pytest.MonkeyPatch, fault: str, case: HardCase = CASE) -> list[Row]:
    monkeypatch.setattr(suite, "HandSolver", type("Spoiled", (Faulty,), {"fault": fault}))
    return run_case(Cell(case, SolverOptions(), 0))


@pytest.mark.parametrize(
    ("fault", "caught"),
    [
        ("none", []),
        ("penetration", ["penetration"]),
        ("nan", ["ticks that are not finite"]),
        ("limit", ["joint beyond its limit"]),
        ("stuck", ["stuck ticks that nothing explains"]),
        ("lost", ["penetration", "ticks that are not finite", "joint beyond its limit"]),
    ],
)
def test_a_planted_fault_is_caught(monkeypatch: pytest.MonkeyPatch, fault: str, caught: list[str]) -> None:
    rows = rows_with(monkeypatch, fault)
    failed = [row["figure"] for row in rows if not row["passed"]]
    assert failed[:2] == caught[:2]
    for row in rows:
        assert row["case_passed"] == (not caught) and row["ticks"] == PRESS.ticks
    assert math.isnan(rows[0]["value"]) == (fault == "lost")
    first, *_ = Hard.planned().lines(rows)
    if fault == "penetration":
        assert re.fullmatch(r"press, coupled: penetration [12]\.\d+ µm, bar ≤ 1 µm", first)
    # Only methods that promise to pass can miss.
    others = [{**row, "method": "paper"} for row in rows]
    assert Hard.planned().missed([*rows, *others]) == (["press (coupled)"] if caught else [])


def test_a_refusal_counts_only_where_a_case_allows_it_and_an_exception_never(monkeypatch: pytest.MonkeyPatch) -> None:
    assert not rows_with(monkeypatch, "refusal")[0]["case_passed"]
    allowing = replace(CASE, may_refuse=True)
    (refused,) = rows_with(monkeypatch, "refusal", allowing)
    assert (refused["case_passed"], refused["reason"]) == (True, "too much of it")
    (broken,) = rows_with(monkeypatch, "exception", allowing)
    assert (broken["case_passed"], broken["reason"]) == (False, "ZeroDivisionError: float division")
    assert "press, coupled: ZeroDivisionError: float division" in Hard.planned().lines([broken])

    def unbuilt(seed: int) -> list[HardRun]:
        raise ValueError("no such shape")

    (ended,) = run_case(Cell(HardCase("broken", "", unbuilt), SolverOptions(), 0))
    assert (ended["case_passed"], ended["reason"], ended["figure"]) == (False, "ValueError: no such shape", "")


def stuck_at(motion: HandConfiguration, record: TickRecord, tick: int) -> int:
    status = record.status.copy()
    status[tick] |= STATUS_STUCK
    return with_way_out(motion, record._replace(status=status))


def with_way_out(motion: HandConfiguration, record: TickRecord) -> int:
    return int(stuck_with_way_out(right_hand(), PIECES, SolverOptions(), hold_readings(motion), record).sum())


def test_a_stuck_tick_is_explained_where_the_hand_can_go_no_nearer() -> None:
    record = HandSolver(right_hand(), BALL.arrays(), SolverOptions()).run(*PRESS)
    assert not (record.status & STATUS_STUCK).any()
    # At rest on the ball the hand is at its best; on its way down through air, a tick later, it is where it should be.
    assert stuck_at(PRESS, record, LAST) == 0
    assert stuck_at(PRESS, record, 30) == 0
    # Asked to be 12 mm lower, in air, it could; and on the ball, asked to leave it.
    ahead = HandConfiguration(*(np.roll(values, -10, axis=0) for values in PRESS))
    assert stuck_at(ahead, record, 30) == 1
    away = PRESS._replace(position=PRESS.position.copy())
    away.position[LAST, 2] += 0.1
    assert stuck_at(away, record, LAST) == 1


def test_held_input_is_judged_by_the_last_sample_that_was_sound() -> None:
    record = HandSolver(right_hand(), BALL.arrays(), SolverOptions()).run(*PRESS)
    held = HandConfiguration(*(values.copy() for values in PRESS))
    held.position[31:35] = np.nan
    # Forty ticks of the motion lie between: the hand at tick 30 is where sample 30 asked it to be.
    frozen = record._replace(**{name: getattr(record, name).copy() for name in ("position", "joints", "orientation")})
    for tick in range(31, 35):
        frozen.position[tick], frozen.joints[tick] = record.position[30], record.joints[30]
    assert stuck_at(held, frozen, 33) == 0
    assert stuck_at(PRESS, frozen, 33) == 1
    np.testing.assert_array_equal(np.flatnonzero(~sound_samples(held)), [31, 32, 33, 34])


def test_more_stuck_ticks_than_are_looked_at_are_not_explained(monkeypatch: pytest.MonkeyPatch) -> None:
    record = HandSolver(right_hand(), BALL.arrays(), SolverOptions()).run(*PRESS)
    stuck = record._replace(status=record.status | STATUS_STUCK)
    assert with_way_out(PRESS.part(0, 30), TickRecord._make(values[:30] for values in stuck)) == 0
    monkeypatch.setattr("hhsim.bench.robustness.safety.MOST_CHECKS", 10)
    # The first tick is done twice, and looked at once.
    twice = PRESS.part(0, 1).hold(30).line(PRESS.part(29), 12)
    again = HandSolver(right_hand(), BALL.arrays(), SolverOptions()).run(*twice)
    again = again._replace(status=again.status | STATUS_STUCK)
    assert with_way_out(twice, again) == 12 - 9


def test_the_command_prints_a_table_and_says_what_the_hand_touched(run: Run, tmp_path: Path) -> None:
    cases = ["ridge", "flat-finger", "too-many-pairs"]
    answer = run("bench", "hard", *cases, "--surface", "mesh", "--out", "hard.json")
    assert answer.code == 0, answer.err
    lines = [" ".join(line.split()) for line in answer.out.splitlines()]
    for start in ("ridge coupled mesh pass 0.000 ", "too-many-pairs progressive spheres refuses, as it may"):
        assert any(line.startswith(start) for line in lines), start
    assert lines[-2:] == ["passed: coupled 3 of 3, progressive 3 of 3", "the table is in hard.json and hard.csv"]
    assert "on spheres, since their objects are nothing else: too-many-pairs" in answer.out
    table = json.loads((tmp_path / "hard.json").read_text())
    safe = ["coupled", "progressive"]
    surfaces = {"ridge": "mesh", "flat-finger": "mesh", "too-many-pairs": "spheres"}
    found = {(row["case"], row["method"]): row["surface"] for row in table["rows"] if row["case_passed"]}
    assert found == {(case, method): surface for case, surface in surfaces.items() for method in safe}
    made = {"methods": None, "surfaces": ["mesh"], "seed": 0, "ticks": 20_000}
    assert (table["suite"], table["options"]) == ("hard", {"cases": cases, **made})
