"""The referee's claims of a hand that keeps out of itself: an honest run holds, planted faults are found."""

from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from file_faults import Fault
from planted_faults import failing, planted, verdict
from short_grasp import result_of, short_grasp, short_scene, with_motion

from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.motion.analytic_motion import still
from hhsim.motion.trajectory import Trajectory
from hhsim.result.reader import Result
from hhsim.verify.claim import HOLDS
from hhsim.verify.verify import verify

pytestmark = pytest.mark.slow

LAST = 119
AWAY = np.array([0.0, 0.5, 0.0])
"""Place of the hand, far from its object [m]."""


def pinch() -> Trajectory:
    """Thumb and index finger close through each other in the air."""
    flexion = np.zeros((5, 3))
    flexion[0], flexion[1] = (0.1, 0.9, 0.9), (1.2, 1.2, 0.6)
    motion = still(AWAY).line(still(AWAY, flexion=flexion, abduction=[0.5, 0.0, 0.0, 0.0, 0.0]), LAST - 20).hold(20)
    return Trajectory(np.arange(motion.ticks) / 1000.0, *motion, name="pinched air", hand="right")


@pytest.fixture(scope="module")
def honest(tmp_path_factory: pytest.TempPathFactory) -> Result:
    path = tmp_path_factory.mktemp("honest") / "pinch.h5"
    in_the_air = with_motion(short_scene(short_grasp()), pinch())
    return result_of(in_the_air, path, {"hand_file": None}, self_contact=True, surface="mesh")


def test_an_honest_run_holds_in_every_claim(honest: Result) -> None:
    found = verify(honest)
    assert failing(found) == set()
    assert verdict(found, "own parts") == verdict(found, "second run") == HOLDS
    # The hand bears on itself, and that is what balances its coupling.
    assert np.linalg.norm(honest["force/phalanx"][-1], axis=2).max() > 0.1
    assert honest.summary["self_depth_haptic"] > 5e-3
    assert honest.summary["self_depth_graphic"] == 0.0


def bent_finger(file: h5py.File) -> None:
    """The index finger of the shown hand bent on into the thumb by 1 mrad, joints and all."""
    flexion = file["hands/right/tick/graphic/flexion"][LAST]
    flexion[1, 0] += 1e-3
    file["hands/right/tick/graphic/flexion"][LAST] = flexion
    shown = HandConfiguration(*(file[f"hands/right/tick/graphic/{name}"][LAST] for name in HandConfiguration._fields))
    file["hands/right/tick/graphic/joints"][LAST] = HandModel.default().joints(*shown)


def pulling_thumb(file: h5py.File) -> None:
    """The thumb is drawn to the finger that it bears on."""
    file["hands/right/tick/force/phalanx"][LAST, 0] *= -1.0


def shallow_user(file: h5py.File) -> None:
    file["summary/right"].attrs["self_depth_haptic"] *= 0.999


FAULTS: dict[Fault, str] = {bent_finger: "own parts", pulling_thumb: "force balance", shallow_user: "second run"}


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.__name__)
def test_a_planted_fault_is_found(honest: Result, tmp_path: Path, fault: Fault) -> None:
    assert FAULTS[fault] in failing(verify(planted(honest.path, tmp_path, fault)))


def test_the_claim_is_of_runs_that_make_it(honest: Result, tmp_path: Path) -> None:
    in_the_air = with_motion(short_scene(short_grasp()), replace(pinch(), name="through"))
    through = result_of(in_the_air, tmp_path / "through.h5", {"hand_file": None}, surface="mesh")
    assert through.summary["self_depth_graphic"] == through.summary["self_depth_haptic"] > 5e-3
    assert "own parts" not in {claim.name for claim in verify(through).claims}
