"""Notes of a loop in compiled code, as numbers of which Python makes lines of text later."""

import numpy as np

from hhsim.kernels.jit import Record, as_int64, jit
from hhsim.kernels.parallel.atomic import load_acquire, store_release

CAPACITY = 512
"""Number of notes kept; the oldest are overwritten."""

JUMPED = 1
"""Place: finger; value: jump [rad]."""
JUMPED_BACK = 2
JUMP_FOLLOWED = 3
MOVES_AGAIN = 4
STUCK = 5
"""Place: finger; value: duration [s]; count: two others that moved, `8 * first + second`."""
SAFETY_CHANGED = 6
"""Count: new bits."""
MISSED = 7
"""Place: cause; count: number of periods."""
LONG_TICK = 8
REFUSED = 9
"""Unusable sample after a usable one; kept in `LiveArrays.refused`."""
BEGAN_INSIDE = 10
FULL = 11
DRIVER_SILENT = 12
"""Count: age of the driver's last sign of life [ns]."""

NOTES = np.dtype(
    [
        ("written", np.int64, (1,)),
        ("time_ns", np.int64, (CAPACITY,)),
        ("code", np.int64, (CAPACITY,)),
        ("place", np.int64, (CAPACITY,)),
        ("count", np.int64, (CAPACITY,)),
        ("value", np.float64, (CAPACITY,)),
    ],
    align=True,
)
"""Ring of notes with one writer: note k lies at k modulo `CAPACITY`; `written` is the number of all so far."""


@jit
def note(notes: Record, time_ns: int, code: int, place: int, count: int, value: float) -> None:
    """Write a note; its numbers are described at the codes."""
    written = load_acquire(notes.written[:], as_int64(0))
    i = written % CAPACITY
    notes.time_ns[i] = time_ns
    notes.code[i] = code
    notes.place[i] = place
    notes.count[i] = count
    notes.value[i] = value
    store_release(notes.written[:], as_int64(0), written + 1)
