"""Fault drills: whatever breaks, the glove is told stiffness 0 in time, and what can go on goes on.

Each drill first has a finger stopped and the user's hand held still, so that there is something to free. Processes are
killed as a crash would kill them. The time is taken from before the fault to the last instant at which the glove was
told, or would have been told, to hold a finger: by the server's own log where it lives, else by the session's ticks.
"""

import json
import os
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from live_drill import IN_TIME, LOOP, STIFF, WITHOUT_REAL_TIME, Drill, FakeDexmo, Kind, Safety, grasping_setup, stiff
from numpy.typing import NDArray

from hhsim.live.live_records import Stage
from hhsim.live.supervisor import GUARDIAN, RECORDER, VIEWER
from hhsim.result import load_result

HHSIM = [sys.executable, "-c", "from hhsim.cli.main import main; main()"]


@pytest.fixture(scope="module", autouse=True)
def kernels() -> None:
    """Scene and kernels are made before a drill begins."""
    grasping_setup(1, None)


@pytest.fixture
def glove(tmp_path: Path) -> Iterator[FakeDexmo]:
    with FakeDexmo(tmp_path / "told.log") as server:
        yield server


def held_last(told: NDArray[Any], since: int) -> int:
    """How long after `since` a finger was last held [ns]; negative where it was free by then."""
    times = told["time_ns"][stiff(told)]
    return int(times.max()) - since if times.size else -since


def assert_free_in_time(drill: Drill, told: NDArray[Any], since: int) -> None:
    assert stiff(told[told["time_ns"] < since]).any(), "nothing was held: the drill shows nothing"
    assert held_last(told, since) <= drill.allowed


def test_loop_killed(glove: FakeDexmo, tmp_path: Path) -> None:
    with Drill(glove, tmp_path / "session.h5") as drill:
        drill.grasp()
        loop = drill.loop_client()
        killed = drill.kill(LOOP)
        while drill.session.poll():
            time.sleep(0.002)
    told = drill.commands()
    assert_free_in_time(drill, told, killed)
    # By the guardian, on a connection of its own, soon enough and again.
    freed = told[(told["client"] != loop) & (told["time_ns"] > killed)]
    assert len(freed) >= 2
    assert not stiff(freed).any()
    assert freed["time_ns"].min() - killed <= drill.allowed
    assert "SIGKILL" in drill.session.end().loop_failed
    assert drill.session.end().guardian_releases >= 2
    result = load_result(tmp_path / "session.h5")
    assert result.ticks > 100


def test_peer_dies_and_comes_back(glove: FakeDexmo, tmp_path: Path) -> None:
    with Drill(glove) as drill:
        drill.grasp()
        died = time.monotonic_ns()
        glove.kill()
        drill.until(lambda: bool(drill.session.memory.status["safety"] & Safety.DEVICE_LOST), "loss of the glove")
        drill.go_on(0.1)
        assert_free_in_time(drill, drill.ticks, died)
        back = time.monotonic_ns()
        glove.start()
        drill.until(lambda: drill.stiffness > STIFF, "finger that is stopped again")
        drill.go_on(0.05)
    told = drill.commands()
    told = told[told["time_ns"] > back]
    assert stiff(told).any()
    assert not stiff(told[:10]).any(), "the fingers come back by the ramp"


def test_peer_stalls(glove: FakeDexmo) -> None:
    with Drill(glove) as drill:
        drill.grasp()
        stalled = time.monotonic_ns()
        glove.order("stall")
        drill.go_on(0.3)
        assert drill.session.memory.status["safety"] & Safety.STALE_INPUT
        assert_free_in_time(drill, drill.ticks, stalled)
        heard = len(drill.commands())
        going = time.monotonic_ns()
        glove.order("go")
        drill.until(lambda: drill.stiffness > STIFF, "finger that is stopped again")
    # What waited in the connection is read in its order: held fingers, then free ones, and then those of the ramp.
    told = drill.commands()[heard:]
    assert not stiff(told).all()
    free = np.flatnonzero(~stiff(told))
    assert told["time_ns"][free[0]] - going <= drill.allowed


def test_glove_unplugged_and_back(glove: FakeDexmo) -> None:
    with Drill(glove) as drill:
        drill.grasp()
        unplugged = time.monotonic_ns()
        glove.order("unplug")
        drill.go_on(0.3)
        assert_free_in_time(drill, drill.commands(), unplugged)
        assert_free_in_time(drill, drill.ticks, unplugged)
        plugged = time.monotonic_ns()
        glove.order("plug")
        drill.until(lambda: drill.stiffness > STIFF, "finger that is stopped again")
        drill.go_on(0.05)
        told = drill.commands()
        told = told[told["time_ns"] > plugged]
        first = told[stiff(told)][0]["stiffness"].max()
        assert first < STIFF / 2, "the fingers come back by the ramp"
        assert drill.session.stage == Stage.RUNNING


def test_glove_jumps(glove: FakeDexmo) -> None:
    with Drill(glove) as drill:
        drill.grasp()
        jumped = time.monotonic_ns()
        glove.order("jump")
        drill.go_on(0.1)
        ticks = drill.ticks
        assert stiff(ticks[ticks["time_ns"] < jumped]).any()
        free = ticks[(ticks["time_ns"] > jumped) & ~stiff(ticks)]
        assert len(free)
        assert free["time_ns"][0] - jumped <= drill.allowed
        assert drill.session.stage == Stage.RUNNING
    words = " / ".join(text for _, _, text in drill.session.end().notices)
    assert "finger jumped by" in words, words


def test_recorder_killed(glove: FakeDexmo, tmp_path: Path) -> None:
    path = tmp_path / "session.h5"
    with Drill(glove, path) as drill:
        drill.grasp()
        drill.until(lambda: int(drill.session.memory.status["recorder_ticks"]) > 500, "recorded ticks")
        drill.kill(RECORDER)
        drill.still_holds()
    assert_free_at_the_end(drill)
    result = load_result(path)
    assert not result.complete
    assert result.ticks > 500
    assert np.isfinite(result["graphic/position"]).all()
    assert "the recorder was ended by SIGKILL" in drill.session.end().record_failed + str(drill.session.end().notices)


def test_disk_full(glove: FakeDexmo, tmp_path: Path) -> None:
    path = tmp_path / "session.h5"
    with Drill(glove, path) as drill:
        drill.grasp()
        drill.until(lambda: int(drill.session.memory.status["recorder_ticks"]) > 500, "recorded ticks")
        pid = drill.session.pid(RECORDER)
        assert pid is not None
        # The file may not grow any more: a full disk that needs no root.
        size = path.stat().st_size
        resource.prlimit(pid, resource.RLIMIT_FSIZE, (size, size))
        status = drill.session.memory.status
        drill.until(lambda: bool(status["recorder_failed"]) or drill.session.pid(RECORDER) is None, "full disk")
        drill.still_holds()
    assert_free_at_the_end(drill)
    result = load_result(path)
    assert not result.complete
    assert result.ticks > 500
    assert drill.session.end().record_failed


def test_viewer_closed(glove: FakeDexmo, tmp_path: Path) -> None:
    pytest.importorskip("rerun")
    with Drill(glove, rerun=str(tmp_path / "session.rrd")) as drill:
        drill.grasp()
        drill.until(lambda: drill.session.memory.status["viewer_ns"] != 0, "viewer")
        drill.kill(VIEWER)
        drill.still_holds()
    assert_free_at_the_end(drill)
    assert "the viewer was ended by SIGKILL" in str(drill.session.end().notices)


def test_guardian_killed(glove: FakeDexmo) -> None:
    with Drill(glove) as drill:
        drill.grasp()
        first = drill.session.pid(GUARDIAN)
        killed = drill.kill(GUARDIAN)
        status = drill.session.memory.status
        drill.until(lambda: bool(status["safety"] & Safety.NO_GUARDIAN), "word of the lost guardian")
        free = held_last(drill.ticks, killed)
        assert free <= drill.allowed + 1e9 * drill.session.setup.safety.guardian_stale
        drill.until(lambda: drill.stiffness > STIFF, "finger that is stopped again")
        assert drill.session.pid(GUARDIAN) not in (None, first)
    assert drill.session.end().guardian_restarts == 1


def assert_free_at_the_end(drill: Drill) -> None:
    told = drill.commands()
    last = {client: told[told["client"] == client][-1:] for client in set(told["client"].tolist())}
    assert last
    for client, command in last.items():
        assert not stiff(command).any(), f"client {client} left a finger held"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_the_command_is_ended(glove: FakeDexmo, tmp_path: Path, number: signal.Signals) -> None:
    """As a user runs it; SIGKILL of the supervisor, too, ends in free fingers and no process left."""
    command = [*HHSIM, "live", "glove", "cube", "--device", "dexmo", "--port", str(glove.port), "--level", "3"]
    command += ["--pose", "fixed", "--stiffness", "0.5", "--no-record", "--json"]
    process = subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=tmp_path
    )
    limit = time.monotonic() + 40.0
    while not (commands := glove.records(Kind.COMMAND)).size or commands["stiffness"][-1].max() < STIFF:
        assert time.monotonic() < limit
        assert process.poll() is None, process.communicate()
        time.sleep(0.01)
    glove.order("hold")
    time.sleep(0.05)
    sent = time.monotonic_ns()
    os.kill(process.pid, number)
    out, err = process.communicate(timeout=30.0)
    time.sleep(0.3)
    told = glove.records(Kind.COMMAND)
    assert stiff(told[told["time_ns"] < sent]).any()
    if number == signal.SIGKILL:
        assert held_last(told, sent) <= WITHOUT_REAL_TIME
    else:
        assert process.returncode == 0, err
        document = json.loads(out)
        assert document["reason"] == "Ctrl-C"
        assert held_last(told, sent) <= (IN_TIME if document["real_time"]["fifo"] else WITHOUT_REAL_TIME)
    gone = glove.records(Kind.GONE)
    assert len(gone) == len(glove.records(Kind.CONNECTED)), "a process of the session is left behind"
