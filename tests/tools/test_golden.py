"""Golden runs: what `tools.golden` kept is what is made, bit for bit."""

from pathlib import Path

import numpy as np
import pytest

from tools.golden import GOLDEN, ROUNDED, SCENES, keep, load, moved, run


@pytest.mark.parametrize("name", SCENES)
def test_a_golden_run_is_made_again(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(GOLDEN.parent.parent)
    run(name, tmp_path / "run.h5")
    row = moved(load(name), keep(tmp_path / "run.h5"))
    assert row is None or (ROUNDED in SCENES[name] and not row["faults"]), row


def test_there_is_a_run_of_each_scene_and_no_other() -> None:
    assert {path.stem for path in GOLDEN.glob("*.npz")} == set(SCENES)
    assert sum(path.stat().st_size for path in GOLDEN.iterdir()) < 6e6


@pytest.mark.parametrize(
    ("dataset", "change", "fault"),
    [
        ("hands/right/tick/graphic/joints", 2e-6, "pose at rest"),
        ("hands/right/tick/force/total", 0.2, "force at rest"),
        ("hands/right/tick/graphic/joints", 5e-7, ""),
    ],
)
def test_what_moves_is_told_and_judged(dataset: str, change: float, fault: str) -> None:
    kept = load("bunny-grasp")
    assert kept["still"].any()
    made = {**kept, dataset: kept[dataset] + change, "facts": np.array(str(kept["facts"]).replace('": "', '": "x', 1))}
    row = moved(kept, made)
    assert row is not None and row["faults"] == ([fault] if fault else [])
