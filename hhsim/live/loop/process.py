"""Process of the loop: `python -m hhsim.live.loop.process --setup FD`, started by the supervisor.

Kernels are ready before the drivers, children of this process, one for each glove, connect. However this process ends,
the system notifies the drivers, which release the gloves.

Exit codes: 0 it was stopped, 1 a fault of hhsim's own, 2 the glove or the pose cannot be reached, or the setup cannot
be used. The reason is the last event and a line on stderr.
"""

import os
import signal
import sys
import threading
import time
from collections.abc import Sequence
from dataclasses import replace
from types import FrameType
from typing import Any

from hhsim.errors import HhsimError
from hhsim.live.child_process import ChildProcess
from hhsim.live.device import Capability, GloveInfo
from hhsim.live.ipc.config import LiveSetup
from hhsim.live.ipc.session_memory import SessionMemory, exit_code, session_process
from hhsim.live.ipc.status import DriverSetup, Stage
from hhsim.live.loop.driver import BEGIN, OPEN, glove_info
from hhsim.live.loop.loop import LiveLoop, loop_options
from hhsim.live.real_time import become_ordinary, become_real_time, described, end_with, keep_off, processors_awake
from hhsim.result.schema import FAULT, INFORMATION, WARNING
from hhsim.solver.hand_solver import warm_up
from hhsim.solver.scene_solver import warm_up_hands

TELL_SECONDS = 0.02
"""Period at which the loop's notes are logged [s]."""
DRIVER_PATIENCE = 10.0
"""Time that the driver has to release the glove and end [s]."""
BELOW_DRIVER = -2
COMMAND_KILLED = "the command was killed"


class Ending:
    """Signal handling: before the loop runs a signal ends the process, then it makes the next tick the last one."""

    loop: LiveLoop | None = None

    def __init__(self) -> None:
        self._signalled = False
        self._supervisor = os.getppid()
        for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
            signal.signal(number, self._handle)

    def _handle(self, number: int, frame: FrameType | None) -> None:
        if self.loop is not None:
            # The system sends SIGTERM when the supervisor has died (`end_with`); the parent has changed by then.
            orphan = os.getppid() != self._supervisor
            self.loop.stop(COMMAND_KILLED if orphan else signal.Signals(number).name)
        elif not self._signalled:
            # Once: the second signal may come while the glove is being released.
            self._signalled = True
            raise SystemExit(0)


def run_session(setup: LiveSetup, memory: SessionMemory, ending: Ending, drivers: Sequence[ChildProcess]) -> None:
    """Make everything ready, run the loop until it is stopped, and leave the gloves released.

    The loop has its own thread, in which compiled code runs; the calling one logs its notes. HhsimError if a glove or a
    pose cannot be reached, or if a driver has died.
    """
    make_ready(setup, memory)
    for hand in memory.hands:
        hand.status["loop_ready"] = OPEN
    while not all(devices := [hand.device.read() for hand in memory.hands]):
        for driver in drivers:
            if not driver.running:
                raise HhsimError(driver.last_line() or f"the glove's {driver.name} {driver.how_it_ended()}")
        time.sleep(TELL_SECONDS / 10)
    loop = LiveLoop(setup, memory, *map(glove_info, devices))
    loop.prepare()
    thread = LoopThread(loop, devices)
    ending.loop = loop
    thread.start()
    died = ""
    while thread.is_alive():
        loop.tell()
        dead = next((driver for driver in drivers if not driver.running), None)
        if dead is not None and not died and not loop.stopped:
            died = f"the glove's {dead.name} {dead.how_it_ended()}"
            loop.stop(died)
        thread.join(TELL_SECONDS)
    loop.tell()
    if thread.failure is not None:
        raise thread.failure
    for driver in drivers:
        if not driver.wait(DRIVER_PATIENCE):
            memory.log(FAULT, f"the glove's {driver.name} does not end: it is killed")
            driver.send(signal.SIGKILL)
            driver.wait(DRIVER_PATIENCE)
    loop.tell()
    for hand, facts in zip(memory.hands, thread.facts):
        hand.facts.write(facts | {"reason": loop.stopped})
    if died:
        raise HhsimError(died)


def make_ready(setup: LiveSetup, memory: SessionMemory) -> None:
    """Compile, or load, the kernels of a session's ticks and of its loop."""
    options = loop_options(setup.options, setup.rate)
    if setup.beside is not None:
        warm_up_hands(setup.scene, options)
    if options.method not in ("coupled", "progressive") or setup.seen.free is not None:
        # `coupled` brings a hand out that begins inside the object.
        warm_up(setup.hand, replace(options, method="coupled"))
    nothing = GloveInfo("", Capability.NONE, ())
    LiveLoop(setup, memory, *(nothing for _ in memory.hands)).prepare()


class LoopThread(threading.Thread):
    """Thread of a loop, with real-time requests of its own; `devices` describe glove and pose as the drivers do.

    `facts` are those of the session of each hand when it began, `failure` is the exception that ended the thread.
    """

    def __init__(self, loop: LiveLoop, devices: Sequence[dict[str, Any]]) -> None:
        super().__init__(name="hhsim-loop", daemon=True)
        self._loop = loop
        self.facts: list[dict[str, Any]] = [
            {"pose": device["pose"], "device": {name: device[name] for name in device if name != "pose"}}
            for device in devices
        ]
        self.failure: BaseException | None = None

    def start(self) -> None:
        """Start it, and a thread below the driver that places the shown hand; keep the caller off its processor."""
        super().start()
        keep_off(self._loop.setup.real_time.loop_cpu)
        if self._loop.compiled:
            threading.Thread(target=self._place, name="hhsim-place", daemon=True).start()

    def _place(self) -> None:
        wishes = self._loop.setup.real_time
        become_real_time(replace(wishes, lock_memory=False, cpu=-1, freeze_gc=False), above=BELOW_DRIVER)
        self._loop.place()

    def run(self) -> None:
        """Become real time, log the mode, and run the loop."""
        loop = self._loop
        try:
            mode = become_real_time(loop.setup.real_time)
            with processors_awake(loop.setup.real_time, mode):
                self._run(mode)
            become_ordinary()
        except BaseException as error:  # raised again by `run_session`
            self.failure = error
            loop.end()

    def _run(self, mode: dict[str, Any]) -> None:
        loop, memory = self._loop, self._loop.memory
        for hand, facts in zip(memory.hands, self.facts):
            facts["real_time"] = mode
            hand.facts.write(facts)
        memory.log(INFORMATION, f"the loop runs at {loop.setup.rate:g} Hz: {described(mode)}")
        for line in mode["refused"]:
            memory.log(WARNING, line)
        # A glove that plays a motion begins it now; earlier samples of others are discarded.
        for hand in memory.hands:
            hand.status["loop_ready"] = BEGIN
        begun = time.monotonic() + DRIVER_PATIENCE
        while not all(hand.status["driver_begun"] for hand in memory.hands) and time.monotonic() < begun:
            time.sleep(0.0005)
        loop.run(mode["cpu"])


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the loop of a session; returns the exit code."""
    setup: LiveSetup
    setup, memory = session_process("loop", arguments)
    ending = Ending()
    drivers: list[ChildProcess] = []
    for hand in memory.hands:
        hand.status["loop_pid"] = os.getpid()
    tell_stage(memory, Stage.STARTING)

    def body() -> None:
        if not end_with(setup.supervisor):
            raise HhsimError("the loop's supervisor ended before the loop began")
        for own, hand in zip(setup.hands, memory.hands):
            given = DriverSetup(
                own.device, own.pose, setup.dry_run, setup.oldest_heartbeat_ns, setup.real_time, os.getpid()
            )
            descriptor = hand.with_setup(given, alone=True)
            # It waits until the loop is ready.
            name = "driver" if setup.beside is None else f"{own.hand.side}-driver"
            drivers.append(ChildProcess(name, "hhsim.live.loop.driver", descriptor, hand.descriptors))
            os.close(descriptor)
        run_session(setup, memory, ending, drivers)

    try:
        return exit_code(body, lambda text: memory.log(FAULT, text))
    finally:
        tell_stage(memory, Stage.ENDING)
        for driver in drivers:
            if not driver.wait(DRIVER_PATIENCE):
                driver.send(signal.SIGKILL)
        tell_stage(memory, Stage.ENDED)


def tell_stage(memory: SessionMemory, stage: Stage) -> None:
    """Set the stage of the session in the status of each hand."""
    for hand in memory.hands:
        hand.status["stage"] = stage


if __name__ == "__main__":
    sys.exit(main())
