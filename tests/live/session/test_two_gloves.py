"""Two gloves in one session: a fault of either frees both hands in time; what goes on holds both again.

The gloves are processes of their own that log their commands; times are taken as in `test_drills`.
"""

import re
import socket
import time
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from live_drill import STIFF, FakeDexmo, Fault, Watched, grasping_scene, stiff, two_grasping_setup
from live_peers import free_ports
from machine_share import assert_in_time, keeps_time
from sampled import sampled

from hhsim.errors import InputError
from hhsim.hand.model import SIDES
from hhsim.live.processes import RingReader
from hhsim.live.session.supervisor import LOOP
from hhsim.replay.repeat import run_again
from hhsim.result.reader import load_result
from hhsim.result.safety import Safety
from hhsim.verify.verify import verify

pytestmark = [pytest.mark.slow, keeps_time]
RIGHT, LEFT = 0, 1


class TwoGlovesDrill(Watched):
    """A session of two gloves, each at a server of its own, whose fingers close on a cube and are stopped."""

    def __init__(self, folder: Path, stack: ExitStack, record: Path | None = None, *, free: bool = False) -> None:
        super().__init__()
        self.gloves = []
        for side, number in zip(SIDES, (1, 2)):
            glove = FakeDexmo(folder / f"{side}.log", "--gloves", f"{number}:{side}")
            glove.port = free_ports(socket.SOCK_STREAM)
            self.gloves.append(stack.enter_context(glove))
        setup = two_grasping_setup([glove.port for glove in self.gloves], record, free=free)
        stack.enter_context(self.begun(setup))
        self.carriers = [glove.pid for glove in self.gloves]
        self.hands = self.session.memory.hands

    def held(self) -> bool:
        return all(float(hand.status["command_stiffness"].max()) > STIFF for hand in self.hands)

    def grasp(self) -> None:
        """Wait until both hands are held, and let the user's hands stand still there."""
        for _ in range(2):
            for hand, glove in zip(self.hands, self.gloves):
                glove.order("move")
                self.until(lambda hand=hand: float(hand.status["command_stiffness"].max()) > STIFF, "held hand")
                glove.order("hold")
        self.until(self.held, "two held hands")

    def assert_both_free(self, fault: Fault) -> None:
        """Each glove held a finger right before the fault, and was soon told to hold none, and nothing else after."""
        for glove in self.gloves:
            commands = glove.commands
            times = commands["time_ns"][stiff(commands)]
            assert ((times < fault.before) & (times > fault.before - 1_000_000_000)).any(), "nothing was held"
            assert_in_time(int(times.max()) - fault.since, fault.allowed)
            freed = commands["time_ns"][~stiff(commands) & (commands["time_ns"] > times.max())]
            assert_in_time(int(freed.min()) - fault.since, fault.allowed)


@pytest.fixture
def drill(tmp_path: Path) -> Iterator[TwoGlovesDrill]:
    with ExitStack() as stack:
        yield TwoGlovesDrill(tmp_path, stack)


@pytest.mark.soak
def test_the_loop_is_killed(drill: TwoGlovesDrill) -> None:
    drill.grasp()
    killed = drill.kill(LOOP)
    drill.let_it_end(killed)
    drill.assert_both_free(killed)
    assert re.match("the session ended early: the loop .*SIGKILL", drill.session.end().error)
    for glove in drill.gloves:
        assert not stiff(glove.commands[-1:]).any()


def assert_a_silent_glove_frees_both_hands_and_both_are_held_again(drill: TwoGlovesDrill) -> None:
    ring = RingReader(drill.hands[RIGHT].ticks)
    stalled = drill.fault(lambda: drill.gloves[LEFT].order("stall"))
    other = drill.hands[RIGHT].status
    drill.until(lambda: bool(other["safety"] & Safety.OTHER_HAND), "word of the other hand")
    assert drill.hands[LEFT].status["safety"] & Safety.STALE_INPUT
    drill.until(lambda: stalled.is_over(time.monotonic_ns()), "time in which fingers may be held")
    _, ticks = ring.read(16_000)
    assert_in_time(int(ticks["time_ns"][stiff(ticks)].max()) - stalled.since, stalled.allowed)
    drill.gloves[LEFT].order("go")
    drill.until(drill.held, "two held hands again")
    drill.until(lambda: "right hand: the other hand is well again" in drill.log, "word of it")
    assert any(text.startswith("right hand: a fault of the other hand: the fingers are free") for text in drill.log)


@pytest.mark.parametrize("free", sampled([True, False], lambda number, _: number == 0))
@pytest.mark.soak
def test_a_fault_of_one_glove_frees_both_and_the_session_ends_in_one_file_that_runs_again(
    tmp_path: Path, free: bool
) -> None:
    record = tmp_path / "both.h5"
    with ExitStack() as stack:
        drill = TwoGlovesDrill(tmp_path, stack, record, free=free)
        drill.grasp()
        assert_a_silent_glove_frees_both_hands_and_both_are_held_again(drill)
        drill.session.request_stop("a key")
        outcomes = drill.session.end().hands
        assert drill.session.end().error == ""
        assert [outcome.reason for outcome in outcomes] == ["a key"] * 2
    for glove in drill.gloves:
        commands = glove.commands
        for client in set(commands["client"].tolist()):
            assert not stiff(commands[commands["client"] == client][-1:]).any()
    assert sorted(path.suffix for path in tmp_path.iterdir()) == [".h5", ".log", ".log"]
    assert [(outcome.record, outcome.side) for outcome in outcomes] == [(record, side) for side in SIDES]
    whole = load_result(record)
    assert whole.complete and whole.ticks == outcomes[0].recorded and run_again(whole).identical
    assert whole["between/graphic"].min() >= 0.0 and whole.body.is_free == free
    for side, result in whole.hands.items():
        assert result.scene["hand"]["side"] == side
        assert np.max(result["live/tick/command_stiffness"]) > STIFF
        assert not [claim for claim in verify(result).claims if claim.failed]


def test_setups_that_do_not_go_together_are_refused() -> None:
    scene = grasping_scene(1, "left")
    moved = replace(scene.scene.hands[0].trajectory, object_position=np.ones(3))
    hand = replace(scene.scene.hands[0], trajectory=moved)
    with pytest.raises(InputError, match="not the same object"):
        grasping_scene(1, "right").both(scene._replace(scene=replace(scene.scene, hands=(hand,))))
