"""hhsim live glove: sessions as users run them, the keys that they type, and what is told at the end."""

import contextlib
import importlib
import json
import os
import signal
import subprocess
import sys
import termios
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import Run
from live_peers import PATIENCE, until
from machine_share import Late, keeps_time
from own_command import HHSIM, Terminal
from short_grasp import short_grasp, short_result

from hhsim.errors import InputError, TrajectoryError
from hhsim.gate.gate import gate_result
from hhsim.hand.model import HandModel
from hhsim.live.device import DeviceCounters
from hhsim.live.session.setup import palm_place
from hhsim.live.session.statistics import LiveTally
from hhsim.live.session.supervisor import SessionOutcome
from hhsim.mesh.catalogue import load_object
from hhsim.metrics.session_faults import FaultCounts, broken_off, ended_before_its_time
from hhsim.replay.repeat import run_again
from hhsim.replay.stored_scene import stored_hand
from hhsim.result.reader import Result, load_hand, load_result
from hhsim.result.schema import FAULT, WARNING
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
        np.testing.assert_array_equal(np.diff(result["live/tick/period"]), 1 + result["live/tick/missed"][1:])
    assert run_again(whole).identical


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
            until(lambda: sizes.add(record.stat().st_size) or len(sizes) > 3)
            live.send_signal(number)
            live.wait(60.0)
            # Its other processes outlive a command that is killed.
            until(lambda: completed(record))
        finally:
            live.kill()
    result = load_result(record)
    assert result.live["ended"] == ended
    assert broken_off(result).startswith(told) and bool(told) == bool(broken_off(result))
    assert " of 600 s" in ended_before_its_time(result)
    assert ("ended_early" in {row.name for row in gate_result(result).missed}) == bool(told)


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


summary = importlib.import_module("hhsim.cli.live.summary")


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Result:
    return short_result(tmp_path_factory.mktemp("session") / "session.h5", short_grasp(release=0.05))


def ended(record: Path | None, failed: str = "") -> SessionOutcome:
    recorded = 250 if record is not None else 0
    return SessionOutcome("duration", 0.25, 250, 0, LiveTally(), {}, DeviceCounters(), record, recorded, 0, failed)


def table(outcome: SessionOutcome) -> list[tuple[str, str, str]]:
    rows: list[tuple[str, str, str]] = summary.summary_rows(outcome, summary.judged(outcome)[1])
    return rows


@pytest.mark.parametrize(
    ("recorded", "failed", "told"), [(True, "", [("0.000", "µm")]), (False, "", []), (True, "the disk is full", [])]
)
def test_how_deep_the_hand_is_is_told_of_a_whole_recording_alone(
    recording: Result, recorded: bool, failed: str, told: list[tuple[str, str]]
) -> None:
    outcome = ended(recording.path if recorded else None, failed)
    assert [row[1:] for row in table(outcome) if row[0] == "penetration in the recording, max"] == told
    depth = summary.summary_json(outcome)["penetration_max"]
    assert depth < 1e-9 if told else depth is None


@pytest.mark.parametrize(
    ("recorded", "failed", "handless"),
    [(6, "", "3"), (9, "", None), (6, "the recording stopped: the disk is full", None)],
)
def test_every_tick_is_recorded_lost_or_had_no_hand(
    recorded: int, failed: str, handless: str | None, tmp_path: Path
) -> None:
    outcome = replace(ended(tmp_path / "none.h5", failed), ticks=10, recorded=recorded, record_lost=1)
    rows = {label: value for label, value, _ in table(outcome)}
    assert rows["ticks recorded, lost"] == f"{recorded}, 1"
    assert rows.get("ticks without a hand, not recorded") == handless


def test_the_end_says_in_a_line_what_went_wrong(capsys: pytest.CaptureFixture[str]) -> None:
    outcome = replace(
        ended(None),
        counters=DeviceCounters(frames=60, malformed=2),
        notices=[(0.1, WARNING, "late"), (0.2, FAULT, "the glove is gone")],
    )
    outcome.tally.ticks, outcome.tally.freed = 250, 10
    assert summary.judged(outcome)[0] == FaultCounts(0, 1, 2, 60, 10, 250)
    summary.print_summary(outcome, "a session")
    assert summary.judged(outcome)[0].line in capsys.readouterr().out.splitlines()
    assert summary.summary_json(outcome)["freed_share"] == 4.0
    # Of a loop that was killed nobody may have told.
    assert summary.judged(replace(outcome, notices=[], loop_failed="SIGKILL"))[0][:2] == (1, 1)


PROGRAM = """
import os, signal, sys, time
from hhsim.cli.live.session import terminal_keys
from hhsim.live.processes import stop_signals
with stop_signals() as stop_signal, terminal_keys() as read:
    if read is None:
        print("no terminal", flush=True)
        sys.exit()
    print("ready", flush=True)
    while True:
        keys = read()
        if keys is None:
            sys.exit(7)
        if keys:
            print(repr(keys), flush=True)
        if "x" in keys:
            raise RuntimeError("an error of the program")
        if "e" in keys:
            sys.exit(3)
        if stop_signal():
            print("stopped by", stop_signal(), flush=True)
            break
        time.sleep(0.005)
"""


@pytest.fixture
def terminal() -> Iterator[Terminal]:
    held = Terminal(sys.executable, "-c", PROGRAM)
    held.until("ready")
    assert termios.tcgetattr(held.line)[3] & (termios.ICANON | termios.ECHO) == 0
    yield held
    held.close()


WAYS_OUT: dict[str, tuple[Callable[[Terminal], None], int]] = {
    "Ctrl-C": (lambda terminal: terminal.type(b"\x03"), 0),
    "Ctrl-Z": (lambda terminal: terminal.type(b"\x1a"), 0),
    "Ctrl-backslash": (lambda terminal: terminal.type(b"\x1c"), 0),
    "SIGTERM": (lambda terminal: terminal.process.send_signal(signal.SIGTERM), 0),
    "SIGHUP": (lambda terminal: terminal.process.send_signal(signal.SIGHUP), 0),
    "an exit": (lambda terminal: terminal.type(b"e"), 3),
    "an error": (lambda terminal: terminal.type(b"x"), 1),
}


@pytest.mark.parametrize("way", WAYS_OUT)
@pytest.mark.quick("Ctrl-C", "an error")
def test_the_terminal_is_as_it_was_on_every_way_out(terminal: Terminal, way: str) -> None:
    leave, code = WAYS_OUT[way]
    leave(terminal)
    assert terminal.process.wait(PATIENCE) == code
    assert termios.tcgetattr(terminal.line) == terminal.before
    if code == 0:
        terminal.until("stopped by ")


def test_keys_come_at_once_and_arrows_are_no_escape(terminal: Terminal) -> None:
    terminal.type(b"w")
    terminal.until("'w'")
    terminal.type(b"\x1b[A\x1b[1;5Ca\x1bOP")
    terminal.until("'a'")
    terminal.type("ü".encode())
    assert "stopped by" not in terminal.until("'ü'")
    assert terminal.process.poll() is None


def test_a_terminal_that_is_gone_is_noticed(terminal: Terminal) -> None:
    os.close(terminal.line)
    os.close(terminal.end)
    # The program is told by SIGHUP, or finds nothing more to read; what it prints then goes nowhere.
    assert terminal.process.wait(PATIENCE) is not None


def test_without_a_terminal_there_are_no_keys() -> None:
    answer = subprocess.run([sys.executable, "-c", PROGRAM], stdin=subprocess.DEVNULL, capture_output=True, text=True)
    assert (answer.returncode, answer.stdout) == (0, "no terminal\n")
