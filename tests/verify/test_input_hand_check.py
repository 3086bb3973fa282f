"""The claims of the user's hand: true of an honest file, and false of each figure that is changed."""

from dataclasses import replace

import numpy as np
import pytest
from short_grasp import short_result

from hhsim.result.reader import Result
from hhsim.verify.claim import FAILS, HOLDS, NOT_JUDGED
from hhsim.verify.input_hand_check import CORRECTION, DEPTH, input_hand_claims
from hhsim.verify.tick_data import JudgedTicks


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Result:
    return short_result(tmp_path_factory.mktemp("replay") / "short.h5")


def verdicts(result: Result, **figures: float) -> dict[str, str]:
    changed = replace(result, summary={**result.summary, **figures})
    judge = JudgedTicks(changed, np.arange(0, result.ticks, 10))
    return {claim.name: claim.verdict for claim in input_hand_claims(judge)}


def test_an_honest_file_holds(result: Result) -> None:
    assert result.summary[DEPTH] > 5e-3
    assert verdicts(result) == {"input depth": HOLDS, "correction": HOLDS}


@pytest.mark.parametrize("off", [-1e-5, 1e-5, 1e-3, np.inf, np.nan])
def test_a_depth_that_is_another_is_found(result: Result, off: float) -> None:
    assert verdicts(result, **{DEPTH: float(result.summary[DEPTH]) + off})["input depth"] == FAILS


@pytest.mark.parametrize("name", CORRECTION)
def test_a_correction_that_is_another_is_found(result: Result, name: str) -> None:
    assert verdicts(result, **{name: float(result.summary[name]) + 1e-8}) == {"input depth": HOLDS, "correction": FAILS}


def test_an_older_file_claims_nothing_and_a_mesh_is_not_judged(result: Result) -> None:
    older = replace(result, summary={name: value for name, value in result.summary.items() if name != DEPTH})
    assert input_hand_claims(JudgedTicks(older, np.arange(0, result.ticks, 10))) == []
    scene = {**result.scene, "solver": {**result.scene["solver"], "surface": "mesh"}}
    assert verdicts(replace(result, scene=scene))["input depth"] == NOT_JUDGED
