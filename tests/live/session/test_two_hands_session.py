"""A session of two gloves in step with a clock that is told the time: both hands move one body, and keep apart."""

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from conftest import sampled
from live_rings import ended
from live_scripted import FakeAccounts, FakeClock, InStep
from numpy.typing import NDArray

from hhsim.errors import InputError
from hhsim.hand.model import SIDES, HandModel
from hhsim.live.device import DeviceError
from hhsim.live.drivers.played import SimGlove
from hhsim.live.drivers.poses import ReplayPose
from hhsim.live.gloves import Hand, PoseConfig, configure
from hhsim.live.session.memory import SessionMemory
from hhsim.live.session.recorder import Recorder
from hhsim.live.session.setup import LiveScene, LiveSetup, OutputLimits, SafetyLimits, grasping_hand, make_live_scene
from hhsim.mesh.catalogue import load_object
from hhsim.replay.repeat import run_again
from hhsim.result.reader import Result, load_result
from hhsim.result.safety import Safety
from hhsim.scene.body import CLEARANCE
from hhsim.scene.declared_bodies import DeclaredBodies
from hhsim.scene.motion_catalogue import load_script
from hhsim.scene.scene import tree_maker
from hhsim.solver.options import SolverOptions
from hhsim.verify.verify import verify

RATE = 250.0
GONE = range(80, 100)
"""Ticks in which the left glove of a test is gone."""


class DroppingGlove(SimGlove):
    """A simulated glove that may be gone."""

    is_gone: Callable[[], bool] = staticmethod(lambda: False)

    def read(self, samples_out: NDArray[np.void]) -> int:
        if self.is_gone():
            raise DeviceError("the glove is gone")
        return super().read(samples_out)

    def reconnect(self) -> bool:
        return not self.is_gone()


def scene_of_hand(side: Hand, *, free: bool) -> LiveScene:
    item = load_object("cube")
    bodies = DeclaredBodies.of_mesh(item.mesh).with_trees(tree_maker(1))
    motion, low = load_script("lift-both").of_two(), float(item.mesh.bounds[0, 2])
    about: dict[str, Any] = {"rate": RATE}
    if side == "left":
        about["other"] = grasping_hand(HandModel.default("right"), bodies.tree, motion)
    if free:
        about["freed"] = lambda scene: scene.freed(mass=0.1, friction=0.8, table=low - CLEARANCE)
    pose = PoseConfig("replay")
    return make_live_scene(bodies, HandModel.default(side), configure(hand=side), pose, motion, **about)


def record(path: Path, patch: pytest.MonkeyPatch, *, free: bool) -> tuple[Result, SessionMemory]:
    """Both hands do *lift-both*, by simulated gloves, of which the left one is gone for a while."""
    right, left = (scene_of_hand(side, free=free) for side in SIDES)
    both, clock = right.both(left), FakeClock()
    patch.setattr("hhsim.live.drivers.played.time", SimpleNamespace(monotonic_ns=clock.now))

    whole = LiveSetup(
        **both._asdict(),
        options=SolverOptions(surface="mesh"),
        output=OutputLimits(ramp=0.1),
        safety=SafetyLimits(watchdog=False),
        rate=RATE,
        duration=0.6,
        record=path,
    )
    memory = SessionMemory.create(bodies=whole.recorded_bodies, hands=2)
    gloves = [DroppingGlove(worn.device) for worn in whole.worn]
    begun = clock.now()
    gloves[1].is_gone = lambda: round(1e-9 * (clock.now() - begun) * RATE) in GONE
    poses = [ReplayPose(worn.pose) for worn in whole.worn]
    session = InStep(
        whole, memory, gloves[0], clock, pose=poses[0], accounts=FakeAccounts(), beside=(gloves[1], poses[1])
    )
    assert session.run() == "duration"
    ended(memory, os.getpid())
    Recorder(whole, memory).run()
    return load_result(path), memory


@pytest.mark.parametrize("free", sampled([True, False], lambda number, _: number == 0))
def test_a_glove_that_drops_out_frees_both_hands_until_it_is_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, free: bool
) -> None:
    result, memory = record(tmp_path / "gone.h5", monkeypatch, free=free)
    assert result.complete and run_again(result).identical and result["between/graphic"].min() >= 0.0
    right, left = (hand["live/tick/safety"] for hand in result.hands.values())
    lost = left & Safety.DEVICE_LOST > 0
    assert lost.sum() >= len(GONE) - 2 and not lost[: GONE[0] - 5].any() and not lost[GONE[-1] + 8 :].any()
    np.testing.assert_array_equal(right & Safety.OTHER_HAND > 0, lost | np.append(False, lost[:-1]))
    for hand in result.hands.values():
        assert verify(hand).passed and not hand["live/tick/command_stiffness"][lost].any()
    assert not memory.beside.status["device_lost"]


def test_setups_that_do_not_go_together_are_refused() -> None:
    right, left = (scene_of_hand(side, free=False) for side in SIDES)
    (hand,) = left.scene.hands
    moved = replace(hand, trajectory=replace(hand.trajectory, object_position=np.ones(3)))
    with pytest.raises(InputError, match="not the same object"):
        right.both(left._replace(scene=replace(left.scene, hands=(moved,))))
