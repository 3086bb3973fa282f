"""Two gloves in one session: a fault of either frees both hands in time; what goes on holds both again.

The gloves are processes of their own that log their commands; times are taken as in `test_drills`.
"""

import re
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from live_drill import STIFF, Drill, assert_told_free, grasping_scene, stiff
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


@pytest.mark.soak
def test_the_loop_is_killed(tmp_path: Path) -> None:
    with Drill(tmp_path, SIDES, recorded=False) as drill:
        drill.grasp()
        killed = drill.kill(LOOP)
        drill.let_it_end(killed)
        for glove in drill.gloves:
            assert_told_free(glove.commands, killed)
    assert re.match("the session ended early: the loop .*SIGKILL", drill.session.end().error)


def assert_a_silent_glove_frees_both_hands_and_both_are_held_again(drill: Drill) -> None:
    ring = RingReader(drill.hands[RIGHT].ticks)
    stalled = drill.fault(lambda: drill.gloves[LEFT].order("stall"))
    other = drill.hands[RIGHT].status
    drill.until(lambda: bool(other["safety"] & Safety.OTHER_HAND), "word of the other hand")
    # On a busy machine the right hand may have had a fault of its own before.
    drill.until(lambda: bool(drill.hands[LEFT].status["safety"] & Safety.STALE_INPUT), "word of the silent glove")
    drill.until(lambda: stalled.is_over(time.monotonic_ns()), "time in which fingers may be held")
    _, ticks = ring.read(16_000)
    assert_in_time(int(ticks["time_ns"][stiff(ticks)].max()) - stalled.since, stalled.allowed)
    drill.gloves[LEFT].order("go")
    drill.until_held()
    drill.until(lambda: "right hand: the other hand is well again" in drill.log, "word of it")
    assert any(text.startswith("right hand: a fault of the other hand: the fingers are free") for text in drill.log)


@pytest.mark.parametrize("free", sampled([True, False], lambda number, _: number == 0))
@pytest.mark.soak
def test_a_fault_of_one_glove_frees_both_and_the_session_ends_in_one_file_that_runs_again(
    tmp_path: Path, free: bool
) -> None:
    record = tmp_path / "session.h5"
    with Drill(tmp_path, SIDES, free=free) as drill:
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
