"""What the processes of a live session tell each other: the records of the rings, and the status block."""

from enum import IntEnum

import numpy as np

from hhsim.result.schema import TICK_FIELDS


class Stage(IntEnum):
    """Where a session is."""

    STARTING = 0
    RUNNING = 1
    ENDING = 2
    ENDED = 3


LIVE_TICK = np.dtype([(field.name, field.type, field.shape) for field in TICK_FIELDS], align=True)
"""One tick of the loop; `hhsim.result.schema.LIVE_TICK_COLUMNS` says what the fields are that only a session has.

Periods that were missed leave gaps in `tick`; `input_seq` is the `seq` of the sample in use, -1 before the first.
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
