"""What the processes of a live session tell each other: the records of the rings, and the status block."""

from enum import IntEnum

import numpy as np

from hhsim.kernels.tick.state import WORK_COUNTERS


class Stage(IntEnum):
    """Where a session is."""

    STARTING = 0
    RUNNING = 1
    ENDING = 2
    ENDED = 3


LIVE_TICK = np.dtype(
    [
        ("tick", np.int64),
        ("time_ns", np.int64),
        ("wakeup_ns", np.int64),
        ("latency_ns", np.int64),
        ("missed", np.int64),
        ("input_seq", np.int64),
        ("safety", np.int64),
        ("status", np.int64),
        ("haptic_position", np.float64, (3,)),
        ("haptic_orientation", np.float64, (4,)),
        ("haptic_flexion", np.float64, (5, 3)),
        ("haptic_abduction", np.float64, (5,)),
        ("position", np.float64, (3,)),
        ("orientation", np.float64, (4,)),
        ("flexion", np.float64, (5, 3)),
        ("abduction", np.float64, (5,)),
        ("joints", np.float64, (5, 4, 3)),
        ("phalanx", np.float64, (5, 3, 3)),
        ("fingertip_normal", np.float64, (5, 3)),
        ("palm_wrench", np.float64, (6,)),
        ("total", np.float64, (3,)),
        ("duration", np.int64, (4,)),
        ("duration_total", np.int64),
        ("duration_cpu", np.int64),
        ("work", np.int64, (WORK_COUNTERS,)),
        ("lag", np.float64),
        ("command_bend", np.float64, (5,)),
        ("command_stiffness", np.float64, (5,)),
    ],
    align=True,
)
"""One tick of the loop.

| field | meaning |
|---|---|
| tick | number of the period since the loop began; periods that were missed leave gaps |
| time_ns | CLOCK_MONOTONIC of the tick's deadline [ns] |
| wakeup_ns | how long after the deadline that it slept for the loop woke; longer than a period: some went by |
| latency_ns | from the newest sample's bytes read to the command sent, -1 where no new sample came |
| missed | periods missed right before this tick |
| input_seq | `seq` of the sample in use, -1 before the first |
| safety | bits of `Safety` |
| haptic_* | what the solver was given; the rest as in `hhsim.kernels.tick.block.TickRecord` |
| command_* | what the glove was told |
"""

EVENT = np.dtype([("time_ns", np.int64), ("level", np.int64), ("text", "S240")], align=True)
"""A line of the session's log: CLOCK_MONOTONIC [ns]; level 0 for information, 1 a warning, 2 a fault; UTF-8."""

LIVE_STATUS = np.dtype(
    [
        # Written by the loop.
        ("heartbeat_ns", np.int64),
        ("stage", np.int64),
        ("loop_pid", np.int64),
        ("ticks", np.int64),
        ("missed", np.int64),
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
        # Written by the guardian.
        ("guardian_ns", np.int64),
        ("guardian_armed", np.int64),
        ("guardian_releases", np.int64),
        # Written by the recorder and by the viewer.
        ("recorder_ns", np.int64),
        ("recorder_ticks", np.int64),
        ("recorder_lost", np.int64),
        ("recorder_failed", np.int64),
        ("viewer_ns", np.int64),
        # Written by the supervisor.
        ("stop_asked", np.int64),
        ("pose_version", np.int64),
        ("pose_position", np.float64, (3,)),
        ("pose_orientation", np.float64, (4,)),
    ],
    align=True,
)
"""The state of a session that changes in place; every field has one writer. `counters` are those of `DeviceCounters`
in their order; times are CLOCK_MONOTONIC [ns]. `pose_version` is odd while the pose of the keyboard is being written.
"""
