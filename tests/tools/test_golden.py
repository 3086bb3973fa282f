"""Golden runs: what `tools.golden` kept is what is made, bit for bit, and true."""

from pathlib import Path

import numpy as np
import pytest

from hhsim.result.reader import load_result
from hhsim.verify.verify import verify
from tools.golden import GOLDEN, ROUNDED, SCENES, keep, load, moved, run

pytestmark = pytest.mark.slow


@pytest.fixture(autouse=True)
def in_the_checkout(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(GOLDEN.parent.parent)


@pytest.mark.parametrize("name", SCENES)
def test_a_golden_run_is_made_again(name: str, tmp_path: Path) -> None:
    run(name, tmp_path / "run.h5")
    row = moved(load(name), keep(tmp_path / "run.h5"))
    assert row is None or (ROUNDED in SCENES[name] and not row["faults"]), row


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.quick(
    *("bunny-grasp-mesh", "cube-pinch-paper", "two-hands-teapot", "door-swing", "blocks-stack", "laptop-close")
)
def test_the_referee_finds_nothing_false(name: str, tmp_path: Path) -> None:
    run(name, tmp_path / "run.h5")
    found = verify(load_result(tmp_path / "run.h5"))
    assert found.passed, [(claim.name, claim.worst, claim.tick) for claim in found.claims if claim.failed]


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
