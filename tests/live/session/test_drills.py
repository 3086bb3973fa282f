"""Fault drills: whatever breaks, the glove is told stiffness 0 in time, and what can go on goes on.

Each drill first has a finger stopped and the user's hand held still, so that there is something to free. Processes are
killed as a crash would kill them. The time is taken from the fault to the last instant at which the glove was told, or
would have been told, to hold a finger: by the server's own log where it lives, else by the session's ticks. What the
machine took of it, by the system's accounts, is no part of it (`machine_share.MachineShare`).

The faults that a session survives are held in one session; a drill that fails takes it along, and the next has another.
"""

import json
import os
import resource
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from live_drill import IN_TIME, LOOP, PATIENCE, STIFF, Drill, FakeDexmo, Fault, Safety, grasping_setup, stiff
from live_peers import free_ports
from machine_share import MachineShare, assert_in_time, keeps_time
from numpy.typing import NDArray
from renewed import Renewed
from sampled import sampled

from hhsim.kernels.live.plausibility import TRUST
from hhsim.live.session.status import Stage
from hhsim.live.session.supervisor import RECORDER, WATCHDOG
from hhsim.result.reader import load_result

pytestmark = [pytest.mark.slow, keeps_time]

JUST_BEFORE = 1_000_000_000
"""A finger is held so shortly before a fault [ns]."""
ENOUGH = 150
"""Ticks that are recorded before the recorder meets its fault."""
HHSIM = [sys.executable, "-c", "from hhsim.cli.main import main; main()"]


@pytest.fixture(scope="module", autouse=True)
def kernels() -> None:
    """Scene and kernels are made before a drill begins."""
    grasping_setup(1, None)


@contextmanager
def dexmo(log: Path) -> Iterator[FakeDexmo]:
    server = FakeDexmo(log)
    server.port = free_ports(socket.SOCK_STREAM)
    with server:
        yield server


@pytest.fixture
def glove(tmp_path: Path) -> Iterator[FakeDexmo]:
    with dexmo(tmp_path / "commands.log") as server:
        yield server


@pytest.fixture(scope="module")
def drills(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Renewed[Drill]]:
    """A session for the faults that it survives, with a recorder."""

    @contextmanager
    def session() -> Iterator[Drill]:
        folder = tmp_path_factory.mktemp("drill")
        with dexmo(folder / "commands.log") as server, Drill(server, folder / "session.h5") as held:
            yield held

    with Renewed(session, lambda drill: drill.sound) as shared:
        yield shared


@pytest.fixture
def drill(request: pytest.FixtureRequest, drills: Renewed[Drill]) -> Iterator[Drill]:
    yield from drills.use(request.node)


def held_last(commands: NDArray[Any], since: int) -> int:
    """How long after `since` a finger was last held [ns]; negative where it was free by then."""
    times = commands["time_ns"][stiff(commands)]
    return int(times.max()) - since if times.size else -since


def assert_free_in_time(commands: NDArray[Any], fault: Fault) -> None:
    """Fingers were held right before a fault, and `commands` holds none of them any more soon after it."""
    before = commands[(commands["time_ns"] < fault.before) & (commands["time_ns"] > fault.before - JUST_BEFORE)]
    assert stiff(before).any(), "nothing was held: the drill shows nothing"
    assert_in_time(held_last(commands, fault.since), fault.allowed)


def assert_ramp(drill: Drill, since: int) -> None:
    """A finger is held again, and no harder than the ramp lets it be since then, however late a command comes."""
    drill.until_held()
    drill.go_on(0.05)
    commands = drill.commands()
    held = commands[(commands["time_ns"] > since) & stiff(commands)]
    assert len(held)
    setup = drill.session.setup
    # The ramp rises by the period, of which the first and the last one need not be whole.
    risen = (1e-9 * (held["time_ns"] - since) + 2.0 / setup.rate) / setup.output.ramp
    most = 1.001 * max(setup.output.stiffness) * risen
    assert (held["stiffness"].max(axis=1) <= most).all(), "they come back by the ramp"


def test_glove_unplugged_and_back(drill: Drill) -> None:
    drill.grasp()
    unplugged = drill.order("unplug")
    drill.until_over(unplugged, lambda: drill.ticks)
    drill.until_over(unplugged, drill.commands)
    assert drill.session.memory.status["safety"] & Safety.STALE_INPUT
    assert_free_in_time(drill.commands(), unplugged)
    assert_free_in_time(drill.ticks, unplugged)
    plugged = drill.order("plug")
    assert_ramp(drill, plugged.before)


def test_peer_stalls(drill: Drill) -> None:
    drill.grasp()
    stalled = drill.order("stall")
    drill.until_over(stalled, lambda: drill.ticks)
    assert drill.session.memory.status["safety"] & Safety.STALE_INPUT
    assert_free_in_time(drill.ticks, stalled)
    heard = len(drill.commands())
    going = drill.order("go")
    drill.until_held()
    # What waited in the connection is read in its order: held fingers, then free ones, and then those of the ramp.
    commands = drill.commands()[heard:]
    free = commands["time_ns"][~stiff(commands)]
    assert free.size
    assert_in_time(free[0] - going.since, going.allowed)


def test_glove_changes_hands(drill: Drill) -> None:
    drill.grasp()
    swapped = drill.order("swap")
    drill.until_over(swapped, lambda: drill.ticks)
    assert drill.session.memory.status["safety"] & Safety.STALE_INPUT
    assert_free_in_time(drill.ticks, swapped)
    assert_free_in_time(drill.commands(), swapped)
    drill.until(lambda: "says that it is a left hand's now" in " ".join(drill.log), "word of it")
    drill.order("swap")
    drill.until_held()


def test_peer_dies_and_comes_back(drill: Drill) -> None:
    drill.grasp()
    died = drill.fault(drill.glove.kill)
    status = drill.session.memory.status
    drill.until(lambda: bool(status["safety"] & Safety.DEVICE_LOST), "loss of the glove")
    drill.until_over(died, lambda: drill.ticks)
    assert_free_in_time(drill.ticks, died)
    back = time.monotonic_ns()
    drill.glove.start()
    assert_ramp(drill, back)


def test_glove_jumps(drill: Drill) -> None:
    drill.grasp()
    jumped = drill.order("jump")
    drill.until_over(jumped, lambda: drill.ticks)
    # Who comes late to look may find the fingers trusted again.
    ticks = drill.ticks
    assert_free_in_time(ticks[ticks["time_ns"] < jumped.before + 1e9 * TRUST], jumped)
    assert drill.session.stage == Stage.RUNNING
    drill.until(lambda: any("finger jumped by" in text for text in drill.log), "word of it")


def test_loop_hangs(drill: Drill) -> None:
    drill.grasp()
    watchdog = drill.session.pid(WATCHDOG)
    assert watchdog is not None
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        os.kill(watchdog, number)
    hung = drill.kill(LOOP, signal.SIGSTOP)
    try:
        # The watchdog says it again and again.
        drill.until(lambda: len(since(drill.commands(), hung)) > 3, "words of the watchdog")
        drill.until_over(hung, drill.commands)
        drill.until(lambda: any("the loop has given no sign of life" in text for text in drill.log), "word of it")
        commands = drill.commands()
        assert_free_in_time(commands, hung)
        going = time.monotonic_ns()
    finally:
        drill.kill(LOOP, signal.SIGCONT)
    assert_ramp(drill, going)
    assert drill.session.pid(WATCHDOG) == watchdog, "no signal ends it before the loop has ended"


def since(commands: NDArray[Any], fault: Fault) -> NDArray[Any]:
    """What was told after the time in which fingers may be held."""
    return commands[commands["time_ns"] > fault.since + fault.allowed]


def test_driver_hangs(drill: Drill) -> None:
    drill.grasp()
    (pid,) = drill.drivers()
    hung = drill.kill_pid(pid, signal.SIGSTOP)
    try:
        drill.until_over(hung, lambda: drill.ticks)
        drill.until(lambda: len(since(drill.commands(), hung)) > 3, "words of the watchdog, again and again")
        assert drill.session.memory.status["safety"] & Safety.DEVICE_LOST
        assert_free_in_time(drill.commands(), hung)
        assert_free_in_time(drill.ticks, hung)
        going = time.monotonic_ns()
    finally:
        os.kill(pid, signal.SIGCONT)
    assert_ramp(drill, going)


def test_watchdog_killed(drill: Drill) -> None:
    drill.grasp()
    first = drill.session.pid(WATCHDOG)
    killed = drill.kill(WATCHDOG)
    status = drill.session.memory.status
    drill.until(lambda: bool(status["safety"] & Safety.NO_WATCHDOG), "word of the lost watchdog")
    stale = round(1e9 * drill.session.setup.safety.watchdog_stale)
    assert_in_time(held_last(drill.ticks, killed.since), killed.allowed + stale)
    drill.until_held()
    assert drill.session.pid(WATCHDOG) not in (None, first)


def test_disk_full(drill: Drill) -> None:
    drill.grasp()
    status, path = drill.session.memory.status, drill.session.setup.record
    drill.until(lambda: int(status["recorder_ticks"]) > ENOUGH, "recorded ticks")
    pid = drill.session.pid(RECORDER)
    assert pid is not None
    assert path is not None
    # The file may not grow any more: a full disk that needs no root.
    size = path.stat().st_size
    resource.prlimit(pid, resource.RLIMIT_FSIZE, (size, size))
    drill.until(lambda: drill.session.pid(RECORDER) is None, "full disk")
    drill.still_holds()
    assert status["recorder_failed"]
    assert any("the recorder ended with code 2: " in text for text in drill.log), drill.log
    result = load_result(path)
    assert not result.complete
    assert result.ticks > ENOUGH


@pytest.mark.soak
def test_recorder_killed_then_loop_killed(glove: FakeDexmo, tmp_path: Path) -> None:
    with Drill(glove, tmp_path / "session.h5") as drill:
        drill.grasp()
        drill.until(lambda: int(drill.session.memory.status["recorder_ticks"]) > ENOUGH, "recorded ticks")
        drill.kill(RECORDER)
        drill.still_holds()
        # Its memory is given back before it has ended, which takes a busy machine a while.
        drill.until(lambda: any("the recorder was ended by SIGKILL" in text for text in drill.log), "word of its end")
        drill.grasp()
        loop = drill.loop_client()
        killed = drill.kill(LOOP)
        drill.let_it_end(killed)
        commands = drill.commands()
    assert_free_in_time(commands, killed)
    # By the watchdog, on a connection of its own, soon enough and again.
    freed = commands[(commands["client"] != loop) & (commands["time_ns"] > killed.before)]
    assert len(freed) >= 2
    assert not stiff(freed).any()
    assert_in_time(freed["time_ns"].min() - killed.since, killed.allowed)
    outcome = drill.session.end()
    assert "SIGKILL" in outcome.loop_failed
    assert outcome.watchdog_releases >= 2
    assert "SIGKILL" in outcome.record_failed
    result = load_result(tmp_path / "session.h5")
    assert not result.complete
    assert result.ticks > ENOUGH
    assert np.isfinite(result["graphic/position"]).all()


@pytest.mark.soak
def test_driver_killed(glove: FakeDexmo, tmp_path: Path) -> None:
    with Drill(glove) as drill:
        drill.grasp()
        (pid,) = drill.drivers()
        killed = drill.kill_pid(pid)
        drill.let_it_end(killed)
        commands = drill.commands()
        assert_free_in_time(commands, killed)
        assert not stiff(commands[-1:]).any()
    assert "driver was ended by SIGKILL" in drill.session.end().loop_failed


def test_a_session_ends_with_free_fingers(drill: Drill) -> None:
    drill.grasp()
    drill.session.end()
    commands = drill.commands()
    last = {client: commands[commands["client"] == client][-1:] for client in set(commands["client"].tolist())}
    assert last
    for client, command in last.items():
        assert not stiff(command).any(), f"client {client} left a finger held"


@pytest.mark.parametrize("number", sampled([signal.SIGINT, signal.SIGKILL], lambda _, number: number == signal.SIGINT))
@pytest.mark.soak
def test_the_command_is_ended(glove: FakeDexmo, tmp_path: Path, number: signal.Signals) -> None:
    """As a user runs it; SIGKILL of the supervisor, too, ends in free fingers and no process left."""
    command = [*HHSIM, "live", "glove", "cube", "--device", "dexmo", "--port", str(glove.port), "--level", "3"]
    # A slow loop is late less often on a busy machine, which would begin the ramp anew.
    command += ["--pose", "fixed", "--stiffness", "1", "--rate", "250", "--stale", "100", "--no-record", "--json"]
    with subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=tmp_path
    ) as process:
        try:
            end_the_command(glove, process, number)
        finally:
            process.terminate()


def end_the_command(glove: FakeDexmo, process: "subprocess.Popen[str]", number: signal.Signals) -> None:
    """Wait until a finger is held, send the signal, and look at what the glove was told."""
    limit = time.monotonic() + PATIENCE
    while not (commands := glove.commands).size or commands["stiffness"][-1].max() < STIFF:
        assert time.monotonic() < limit
        assert process.poll() is None, process.communicate()
        time.sleep(0.01)
    glove.order("hold")
    time.sleep(0.05)
    # The command itself is not in real time, and looks for signals every 20 ms.
    share = MachineShare(process.pid, glove.pid)
    before = time.monotonic_ns()
    os.kill(process.pid, number)
    sent = time.monotonic_ns()
    while glove.noted("gone") < glove.noted("connected"):
        share.look()
        assert time.monotonic() < limit, "a process of the session is left behind"
        time.sleep(0.002)
    out, err = process.communicate(timeout=PATIENCE)
    commands = glove.commands
    assert stiff(commands[commands["time_ns"] < before]).any()
    assert_in_time(held_last(commands, sent), IN_TIME + share.taken_ns)
    assert not stiff(commands[-1:]).any()
    if number == signal.SIGINT:
        assert process.returncode == 0, err
        assert json.loads(out)["reason"] == "Ctrl-C"
