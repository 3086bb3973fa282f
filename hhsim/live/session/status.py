"""Status of a live session, and the setup of its watchdog, which needs little."""

import os
import select
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np

from hhsim.live.gloves import GloveConfig
from hhsim.live.real_time import RealTimeWishes


class Stage(IntEnum):
    """Stage of a session."""

    STARTING = 0
    RUNNING = 1
    ENDING = 2
    ENDED = 3


def _integers(*names: str) -> list[tuple[str, type]]:
    return [(name, np.int64) for name in names]


LIVE_STATUS = np.dtype(
    [
        # Written by the loop.
        *_integers("heartbeat_ns", "stage", "ending_ns", "loop_pid", "ticks", "missed"),
        ("missed_by", np.int64, (4,)),
        *_integers("safety", "contacts", "battery", "sample_ns"),
        ("force", np.float64, (5,)),
        ("command_bend", np.float64, (5,)),
        ("command_stiffness", np.float64, (5,)),
        ("command_force", np.float64, (5, 3, 3)),
        ("command_safety", np.int64),
        ("command_version", np.int64, (1,)),
        ("loop_ready", np.int64),
        # Written by the driver, a thread of the loop's process.
        *_integers("driver_ns", "device_lost"),
        ("counters", np.int64, (9,)),
        ("palm_ns", np.int64),
        ("palm_position", np.float64, (3,)),
        ("palm_orientation", np.float64, (4,)),
        ("palm_version", np.int64, (1,)),
        # Written by the watchdog.
        *_integers("watchdog_ns", "watchdog_armed", "watchdog_releases"),
        # Written by the recorder and by the viewer.
        *_integers("recorder_ticks", "recorder_lost", "recorder_failed", "viewer_ns"),
        # Written by the supervisor.
        *_integers("stop_requested", "pose_version"),
        ("pose_position", np.float64, (3,)),
        ("pose_orientation", np.float64, (4,)),
    ],
    align=True,
)
"""State of a session that changes in place; every field has one writer. Times are CLOCK_MONOTONIC [ns]; that of
`ending_ns` is when the loop had made its last tick, 0 before. `counters` are those of `DeviceCounters`, `missed_by` is
by `MissCause` without NONE, both in their order. `command_version`, `palm_version` and `pose_version` are odd while
the command, the palm's pose and the pose of the keyboard are being written. `loop_ready` is 1 when the kernels are
compiled, and the glove is opened. `watchdog_armed` is 1 if the watchdog reaches the glove. `stop_requested` is 1 if the
user ends the session, -n if signal n does. Of two gloves each has a block: those of the second one's loop, stop and
recorder say the same.
"""


class LoopProcess:
    """Process of the loop, whose end wakes a process that did not start it; `status` is the record of `LIVE_STATUS`."""

    def __init__(self, status: Any) -> None:
        self._status = status
        self._descriptor = -1
        self.known = self.gone = False

    @property
    def alive(self) -> bool:
        """True from its begin to its end, as far as `wait` has seen either."""
        return self.known and not self.gone

    def wait(self, timeout: float = 0.0) -> None:
        """Sleep for `timeout` [s], or until the process ends."""
        number = int(self._status["loop_pid"])
        if not self.known and number:
            self.known = True
            try:
                self._descriptor = os.pidfd_open(number)
            except ProcessLookupError:
                self.gone = True
        ended, _, _ = select.select([self._descriptor] if self.alive else [], [], [], timeout)
        if ended:
            self.gone = True
            os.close(self._descriptor)


@dataclass(frozen=True)
class WatchedGlove:
    """Settings of the watchdog for a glove, without scene and calibration."""

    device: GloveConfig
    real_time: RealTimeWishes
    oldest_ns: int  # age of the loop's heartbeat beyond which its command is void, and the fingers are freed [ns]
    parent: int  # process id of the supervisor
    status: int  # descriptor of the memory that begins with the status
    periods: int  # number of periods after which the loop ends by itself, -1 for none
