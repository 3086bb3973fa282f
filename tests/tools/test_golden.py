"""Golden runs: what `tools.golden` kept is what is made, bit for bit, and true."""

from pathlib import Path

import numpy as np
import pytest

from hhsim.result.reader import load_result
from hhsim.verify.verify import verify
from tools.golden import GOLDEN, ROUNDED, SCENES, keep, load, moved, run

pytestmark = pytest.mark.slow

ALIKE = (
    *("bunny-touch", "cup-handle-stiff", "teapot-slide-mesh", "two-hands-progressive", "grab-recorded"),
    *("free-hand-over", "peg-insert", "laptop-open-both", "door-swing", "rock-grasp-clarabel"),
)
"""Scenes of which others run the same code; `make soak` has them, and `python -m tools.golden`."""


@pytest.fixture(scope="module", params=SCENES)
def name(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(scope="module")
def made(name: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The result of a scene, which runs once for all that is asked of it."""
    out = tmp_path_factory.mktemp("golden") / "run.h5"
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(GOLDEN.parent.parent)
        run(name, out)
    return out


@pytest.mark.quick(*(name for name in SCENES if name not in ALIKE))
def test_a_golden_run_is_made_again(name: str, made: Path) -> None:
    row = moved(load(name), keep(made))
    assert row is None or (ROUNDED in SCENES[name] and not row["faults"]), row


@pytest.mark.quick("cube-pinch-paper")
def test_the_referee_finds_nothing_false(made: Path) -> None:
    found = verify(load_result(made))
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
