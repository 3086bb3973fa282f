"""The process of the loop: `python -m hhsim.live.loop.process --setup FD --status FD …`, started by the supervisor.

Kernels are ready and everything is allocated before the glove is connected. However the process ends, short of being
killed outright, the glove is released; then the watchdog does it.

Exit codes: 0 it was stopped, 1 a fault of hhsim's own, 2 the glove or the pose cannot be reached, or a setup that
cannot be used. The reason is the last event and a line on stderr.
"""

import argparse
import os
import signal
import sys
import traceback
from collections.abc import Sequence
from dataclasses import replace
from types import FrameType
from typing import Any

from hhsim.errors import HhsimError
from hhsim.live.device import GloveDevice
from hhsim.live.devices.registry import open_device
from hhsim.live.ipc.config import LiveSetup
from hhsim.live.ipc.session_memory import FAULT, INFORMATION, WARNING, SessionMemory, add_memory_options, attached
from hhsim.live.ipc.status import Stage
from hhsim.live.loop.loop import LiveLoop, loop_options
from hhsim.live.pose.registry import PoseSource, make_pose_source
from hhsim.live.real_time import become_ordinary, become_real_time, described, end_with
from hhsim.live.shared_memory import read_setup
from hhsim.solver.compile import warm_up

SIGNALS = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)


class Ending:
    """What a signal does: before the loop runs it ends the process, then it makes the next tick the last one."""

    loop: LiveLoop | None = None
    _signalled = False

    def install(self) -> None:
        """Take over `SIGNALS`."""
        for number in SIGNALS:
            signal.signal(number, self._handle)

    def _handle(self, number: int, frame: FrameType | None) -> None:
        if self.loop is not None:
            self.loop.stop(signal.Signals(number).name)
        elif not self._signalled:
            # Once: the second signal may come while the glove is being released.
            self._signalled = True
            raise SystemExit(0)


def run_session(setup: LiveSetup, memory: SessionMemory, device: GloveDevice, pose: PoseSource, ending: Ending) -> None:
    """Make everything ready, run the loop until it is stopped, and leave the glove released and closed.

    Args:
        setup: Of the session.
        memory: Of the session.
        device: Not yet opened.
        pose: Not yet opened.
        ending: What signals do, installed.

    Raises:
        HhsimError: The glove or the pose cannot be reached.
    """
    facts: dict[str, Any] = {}
    opened = False
    try:
        prepare_kernels(setup)
        pose.open()
        opened = True
        device.open()
        loop = LiveLoop(setup, memory, device, pose)
        mode = become_real_time(setup.real_time)
        facts = {"real_time": mode, "device": device_facts(device), "pose": pose.name}
        memory.write_facts(facts)
        memory.log(INFORMATION, f"the loop runs at {setup.rate:g} Hz: {described(mode)}")
        for line in mode["refused"]:
            memory.log(WARNING, line)
        ending.loop = loop
        loop.run()
        become_ordinary()
        facts["summary"] = loop.summary()
        memory.write_facts(facts)
    finally:
        if opened:
            if not setup.dry_run:
                device.release()
            become_ordinary()
            device.close()
        pose.close()


def prepare_kernels(setup: LiveSetup) -> None:
    """Compile, or load from the cache, every kernel that a tick runs, whatever the place where the hand begins."""
    options = loop_options(setup.options, setup.rate)
    warm_up(setup.hand, options)
    if options.method not in ("coupled", "progressive"):
        # A hand that begins inside the object is brought out by `coupled`.
        warm_up(setup.hand, replace(options, method="coupled"))


def device_facts(device: GloveDevice) -> dict[str, Any]:
    """What a driver says of its glove, as plain values."""
    info = device.info
    return {
        "name": info.name,
        "hand": info.hand,
        "channels": list(info.channels),
        "unit": info.unit,
        "capabilities": [flag.name for flag in info.capabilities],
        "doubtful": list(info.doubtful),
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the loop of a session; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m hhsim.live.loop.process", description=__doc__)
    add_memory_options(parser)
    options = parser.parse_args(arguments)
    setup, memory = read_setup(options.setup, LiveSetup), attached(options)
    ending = Ending()
    ending.install()
    memory.status["loop_pid"] = os.getpid()
    memory.status["stage"] = Stage.STARTING
    try:
        if not end_with(setup.supervisor):
            raise HhsimError("the loop's supervisor ended before the loop began")
        device = open_device(setup.device)
        pose = make_pose_source(setup.pose, memory.status_block, device)
        run_session(setup, memory, device, pose, ending)
    except HhsimError as error:
        memory.log(FAULT, str(error))
        print(f"hhsim: {error}", file=sys.stderr)
        return error.exit_code
    except Exception as error:  # said, and the fingers are free by now
        memory.log(FAULT, f"the loop ended by a fault of its own: {type(error).__name__}: {error}")
        traceback.print_exc()
        return 1
    finally:
        memory.status["stage"] = Stage.ENDED
    return 0


if __name__ == "__main__":
    sys.exit(main())
