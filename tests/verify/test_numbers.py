"""The referee and hands that are nowhere: every fault is a false claim, and none ends it with a traceback."""

from pathlib import Path

import numpy as np
import pytest
from file_faults import Fault, at
from planted_faults import planted
from short_grasp import short_result

from hhsim.result.reader import Result
from hhsim.verify.kinematics import rotations
from hhsim.verify.verify import verify

HOLD = 180
"""A tick of the hold."""


@pytest.fixture(scope="module")
def honest(tmp_path_factory: pytest.TempPathFactory) -> Result:
    return short_result(tmp_path_factory.mktemp("honest") / "short.h5")


@pytest.mark.parametrize(
    "plant",
    [
        at("no_orientation", "hands/right/tick/graphic/orientation", HOLD, lambda x: 0.0),
        at("no_number", "hands/right/tick/graphic/orientation", HOLD, lambda x: np.nan),
        at("no_angle", "hands/right/tick/graphic/flexion", (HOLD, 1, 1), lambda x: np.nan),
    ],
    ids=lambda plant: plant.__name__,
)
def test_a_hand_that_is_nowhere_is_a_false_claim(honest: Result, plant: Fault, tmp_path: Path) -> None:
    found = verify(planted(honest.path, tmp_path, plant), every=20)
    false = {claim.name: claim.tick for claim in found.claims if claim.failed}
    assert false.get("kinematics") == HOLD
    assert "second run" in false


def test_a_quaternion_whose_length_is_no_number_is_no_rotation() -> None:
    quaternions = np.array([[0.0] * 4, [1e200, 0, 0, 0], [np.inf, 0, 0, 0], [np.nan] * 4, [1e-300] * 4, [2.0, 0, 0, 0]])
    found, none = rotations(quaternions)
    assert none.tolist() == [True] * 5 + [False]
    assert np.array_equal((found * found.inv()).as_quat(), np.tile([0.0, 0.0, 0.0, 1.0], (6, 1)))
