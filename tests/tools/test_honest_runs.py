"""Honest runs: one is drawn from its number alone, the referee calls nothing of it false, and the worst one is kept."""

import json
from pathlib import Path

import pytest

from hhsim.verify.claim import FAILS
from tools.honest_runs import KINDS, ROWS, Drawn, judged_run, main, margins

MEETING = 42, 204
"""Runs in which hands that meet at a free object ended ticks up to 23 µm before they had arrived."""
FREE = {"free", "several"}
"""Kinds of runs that have a free body; of two hands some have."""
NO_ROOM = "script stack: the object has no room for both hands"
"""What some drawn lines are refused for."""


@pytest.mark.parametrize("run", [*range(40), *MEETING])
@pytest.mark.quick("0")
def test_nothing_of_an_honest_run_is_called_false(tmp_path: Path, run: int) -> None:
    row = judged_run(tmp_path, 0, run)
    assert row["kind"] == list(KINDS)[run % len(KINDS)]
    if row.get("error") == NO_ROOM:
        return
    assert "error" not in row and row["ticks"] >= 300
    assert [claim for claim in row["claims"] if claim["verdict"] == FAILS] == []
    names = {claim["name"] for claim in row["claims"]}
    assert names >= {"kinematics", "complementarity", "mesh"}
    assert row["kind"] == "two-hands" or ("friction cones" in names) == (row["kind"] in FREE)


def test_a_run_is_drawn_from_its_number_alone(tmp_path: Path) -> None:
    lines = []
    for folder in (tmp_path / "one", tmp_path / "two"):
        folder.mkdir()
        for number, kind in enumerate(KINDS):
            line = " ".join(KINDS[kind](Drawn(folder, 3, number)))
            lines.append(line.replace(str(folder), ""))
    assert lines[: len(KINDS)] == lines[len(KINDS) :] and len(set(lines)) == len(KINDS)


def test_the_worst_of_the_runs_is_kept_and_a_false_claim_ends_with_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def row(run: int, worst: float, verdict: str) -> dict[str, object]:
        claim = {"name": "slip", "verdict": verdict, "worst": worst, "tolerance": 2.0, "unit": "m", "tick": run}
        return {"run": run, "kind": "free", "ticks": 5, "claims": [claim]}

    rows = [row(0, 1.0, "holds"), row(1, 0.5, "holds"), {"run": 2, "kind": "free", "claims": [], "error": "no place"}]
    assert "| slip | 2 | 0 | 2 m | 1 | 0.5 | 0, 0 |" in margins(rows).markdown()
    log = tmp_path / ROWS
    log.write_text("".join(json.dumps(one) + "\n" for one in rows))
    assert main([str(tmp_path), "--runs", "3"]) == 0
    assert "2 runs, 10 ticks" in (printed := capsys.readouterr().out) and "run 2: no place" in printed
    log.write_text(json.dumps(row(0, 3.0, FAILS)) + "\n")
    assert main([str(tmp_path), "--runs", "1"]) == 1
