"""What the loop of a live session publishes: the records of the rings of ticks and of events."""

import numpy as np

from hhsim.result.schema import TICK_FIELDS

LIVE_TICK = np.dtype([(field.name, field.type, field.shape) for field in TICK_FIELDS], align=True)
"""One tick of the loop; `hhsim.result.schema.LIVE_TICK_COLUMNS` says what the fields are that only a session has.

Periods that were missed leave gaps in `tick`; `input_seq` is the `seq` of the sample in use, -1 before the first.
"""

EVENT = np.dtype([("time_ns", np.int64), ("level", np.int64), ("text", "S240")], align=True)
"""A line of the session's log: CLOCK_MONOTONIC [ns]; level 0 for information, 1 a warning, 2 a fault; UTF-8."""
