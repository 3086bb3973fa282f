"""The status block of a live session, and the setup of the process that watches it: all that the watchdog shares."""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from hhsim.live.devices.registry import GloveConfig
from hhsim.live.real_time import RealTimeWishes


class Stage(IntEnum):
    """Where a session is."""

    STARTING = 0
    RUNNING = 1
    ENDING = 2
    ENDED = 3


LIVE_STATUS = np.dtype(
    [
        # Written by the loop.
        ("heartbeat_ns", np.int64),
        ("stage", np.int64),
        ("loop_pid", np.int64),
        ("ticks", np.int64),
        ("missed", np.int64),
        ("missed_by", np.int64, (4,)),
        ("streak", np.int64),
        ("safety", np.int64),
        ("contacts", np.int64),
        ("battery", np.int64),
        ("sample_ns", np.int64),
        ("wakeup_p50_ns", np.int64),
        ("wakeup_p99_ns", np.int64),
        ("latency_p50_ns", np.int64),
        ("latency_p99_ns", np.int64),
        ("force", np.float64, (5,)),
        ("command_bend", np.float64, (5,)),
        ("command_stiffness", np.float64, (5,)),
        ("counters", np.int64, (9,)),
        # Written by the watchdog.
        ("watchdog_ns", np.int64),
        ("watchdog_armed", np.int64),
        ("watchdog_releases", np.int64),
        # Written by the recorder and by the viewer.
        ("recorder_ns", np.int64),
        ("recorder_ticks", np.int64),
        ("recorder_lost", np.int64),
        ("recorder_failed", np.int64),
        ("viewer_ns", np.int64),
        # Written by the supervisor.
        ("stop_requested", np.int64),
        ("pose_version", np.int64),
        ("pose_position", np.float64, (3,)),
        ("pose_orientation", np.float64, (4,)),
    ],
    align=True,
)
"""The state of a session that changes in place; every field has one writer. `counters` are those of `DeviceCounters`
in their order, `missed_by` is by `MissCause` without NONE; times are CLOCK_MONOTONIC [ns]. `pose_version` is odd while
the pose of the keyboard is being written.
"""


@dataclass(frozen=True)
class WatchdogSetup:
    """What the watchdog of a session has to know, without the scene and without what the readings of the glove mean.

    Attributes:
        status: Descriptor of the status block.
        device: The glove; None in a dry run, in which nothing is sent.
        period_ns: Of a tick [ns].
        heartbeat_stale: Age of the loop's last sign of life at which the fingers are freed [s].
        real_time: What the loop asks the system for.
        supervisor: Process id of who starts the processes of the session.
    """

    status: int
    device: GloveConfig | None
    period_ns: int
    heartbeat_stale: float
    real_time: RealTimeWishes
    supervisor: int
