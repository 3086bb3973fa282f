"""`hhsim live glove` as its users meet it."""

import contextlib
import json
import signal
import subprocess
import termios
from pathlib import Path

import numpy as np
import pytest
from conftest import Run
from live_peers import PATIENCE, until
from machine_share import Late, keeps_time
from own_command import HHSIM, Terminal

from hhsim.errors import InputError, TrajectoryError
from hhsim.gate.gate import gate_result
from hhsim.hand.model import HandModel
from hhsim.live.session.setup import palm_place
from hhsim.mesh.catalogue import load_object
from hhsim.metrics.session_faults import broken_off, ended_before_its_time
from hhsim.replay.stored_scene import stored_hand
from hhsim.result.reader import load_hand, load_result
from hhsim.trees.cache import cached_sphere_tree
from hhsim.trees.options import TreeOptions
from tools.shapes.generators import cube

pytestmark = pytest.mark.slow


@keeps_time
@pytest.mark.soak
def test_a_session_whose_glove_could_not_be_told_to_free_the_fingers_ends_with_1(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    deaf = "from hhsim.live.drivers.played import SimGlove\nSimGlove.release = lambda self, timeout=0.05: False\n"
    (tmp_path / "site").mkdir()
    (tmp_path / "site" / "sitecustomize.py").write_text(deaf)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path / "site"))
    answer = run("live", "glove", "cube", "--level", "2", "--duration", "0.1", "--no-record", "--no-realtime", "--json")
    fault, told = "the glove could not be told to free the fingers", json.loads(answer.out)["fault_at_end"]
    if "no sign of life" in told:
        raise Late(told)
    assert (answer.code, told) == (1, fault)
    assert f"hhsim: fault: {fault}" in answer.err


@pytest.mark.soak
def test_two_simulated_gloves_are_one_document_and_one_file(run: Run, tmp_path: Path) -> None:
    answer = run(
        *("live", "glove", "cube", "--device", "left=sim[trajectory=pinch],right=sim", "--duration", "0.4"),
        *("--rate", "500", "--record", "both.h5", "--no-realtime", "--json"),
    )
    assert answer.code == 0, answer.err
    document = json.loads(answer.out)
    assert (document["session"], document["error"], list(document["hands"])) == ("both.h5", None, ["right", "left"])
    assert [path.name for path in tmp_path.iterdir()] == ["both.h5"]
    whole = load_result(tmp_path / "both.h5")
    assert len(whole["time"]) == len(whole["between/graphic"]) == whole.ticks
    for side, motion in (("right", "grasp"), ("left", "pinch")):
        hand, result = document["hands"][side], load_hand(tmp_path / "both.h5", side)
        assert (hand["reason"], hand["session"], hand["pose"]) == ("duration", "both.h5", f"replay of {motion}")
        # A busy machine makes the last wait longer.
        assert hand["loop_ticks"] + hand["missed"] >= 200
        # Samples that came after the last tick were not its any more.
        looked_at = int(result["input_seq"][-1]) + 1
        assert hand["samples_used"] + hand["samples_superseded"] == looked_at <= hand["counters"]["samples"]
        assert hand["real_time"]["fifo"] == 0
        assert result.complete and result.ticks == hand["recorded_ticks"] > 0
        assert (result.scene["hand"]["side"], result.scene["trajectory"]) == (side, motion)
        assert broken_off(result) == "" and ended_before_its_time(result) == ""


@pytest.mark.parametrize(
    ("number", "ended", "told"),
    [
        (signal.SIGKILL, "the command was killed", "the command was killed after"),
        pytest.param(signal.SIGTERM, "SIGTERM", "ended by SIGTERM after", marks=pytest.mark.soak),
        pytest.param(signal.SIGINT, "stopped", "", marks=pytest.mark.soak),
    ],
)
@pytest.mark.soak
def test_a_recording_says_who_ended_its_session(tmp_path: Path, number: signal.Signals, ended: str, told: str) -> None:
    record = tmp_path / "session.h5"
    session = ("live", "glove", "cube", "--device", "sim", "--duration", "600", "--rate", "250", "--no-realtime")
    command, none = [*HHSIM, *session, "--out", str(record)], subprocess.DEVNULL
    with subprocess.Popen(command, stdin=none, stdout=none, stderr=none) as live:
        try:
            until(record.exists)
            # Nothing, a header perhaps in two parts, and ticks.
            sizes: set[int] = set()
            until(lambda: sizes_seen(record, sizes) > 3)
            live.send_signal(number)
            live.wait(60.0)
            # Its other processes outlive a command that is killed.
            until(lambda: completed(record))
        finally:
            live.kill()
    result = load_result(record)
    assert result.live is not None and result.live["ended"] == ended
    assert broken_off(result).startswith(told) and bool(told) == bool(broken_off(result))
    assert " of 600 s" in ended_before_its_time(result)
    assert ("ended_early" in {row.name for row in gate_result(result).missed}) == bool(told)


def sizes_seen(path: Path, sizes: set[int]) -> int:
    """Add the file's size to those seen, and return how many there are."""
    sizes.add(path.stat().st_size)
    return len(sizes)


def completed(path: Path) -> bool:
    try:
        return load_result(path).complete
    except InputError:
        return False


@pytest.mark.soak
def test_keys_move_the_palm_and_end_the_session(tmp_path: Path) -> None:
    arguments = ["live", "glove", "cube", "--device", "sim", "--pose", "keyboard", "--rate", "250"]
    (tmp_path / "me.toml").write_text("hand_length = 0.17\n[index]\nlength = [0.040, 0.024, 0.012]\n")
    arguments += ["--out", "session.h5", "--hand-file", "me.toml", "--hand", "left"]
    with contextlib.closing(Terminal(*HHSIM, *arguments, cwd=tmp_path)) as terminal:
        terminal.until("ticks missed")
        terminal.type(b"wwr")
        hand, item = HandModel.from_toml(tmp_path / "me.toml", "left"), load_object("cube")
        home, _ = palm_place(hand, cached_sphere_tree(item.mesh, TreeOptions(level=item.level)), 0.06)
        x, y, z = 1e3 * (home + [0.0, 0.004, 0.002])
        terminal.until(f"{x:.1f}, {y:.1f}, {z:.1f} mm")
        terminal.type(b"q")
        shown = terminal.until("runs it again")
        assert terminal.process.wait(PATIENCE) == 0
        assert termios.tcgetattr(terminal.line) == terminal.before
    assert "force [N]" in shown and "a key" in shown
    result = load_result(tmp_path / "session.h5")
    hand, haptic = stored_hand(result), result["haptic/position"]
    assert (hand.side, hand.hand_length, hand.length[1].tolist()) == ("left", 0.17, [0.040, 0.024, 0.012])
    np.testing.assert_allclose(haptic[0], home, atol=1e-12)
    np.testing.assert_allclose(haptic[-1], home + [0.0, 0.004, 0.002], atol=1e-12)


def test_a_palm_at_an_object_that_no_hand_can_grasp_is_above_it(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*arguments: object, other: object) -> None:
        raise TrajectoryError("thumb, index cannot reach the object, from any side")

    monkeypatch.setattr("hhsim.live.session.setup.planned", refuse)
    tree = cached_sphere_tree(cube(0.5), TreeOptions(level=1))
    position, orientation = palm_place(HandModel.default("right"), tree, 0.02)
    top = float((tree.leaf_center[:, 2] + tree.leaf_radius).max())
    assert position[2] == pytest.approx(top + 0.07)
    assert orientation.tolist() == [1.0, 0.0, 0.0, 0.0]
