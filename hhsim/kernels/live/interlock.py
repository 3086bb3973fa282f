"""Why the fingers must be free in a tick, judged anew in every tick."""

import numpy as np

from hhsim.kernels.jit import Record, jit

STALE_INPUT = 1
NOT_FINITE = 2
SOLVER_FAILED = 4
OVERRUN_STREAK = 8
DEVICE_LOST = 16
STOPPING = 32
NO_WATCHDOG = 64
DRY_RUN = 128
NO_INPUT_YET = 256
"""The bits of `hhsim.result.safety.Safety`, whose test compares them."""

INTERLOCK = np.dtype(
    [
        ("stale_ns", np.int64),
        ("watchdog_ns", np.int64),
        ("eased", np.int64),
        ("released", np.int64),
        ("watched", np.int64),
        ("always", np.int64),
        ("streak", np.int64),
        ("eases", np.int64),
    ],
    align=True,
)
"""The limits, and what the interlock keeps.

| field | meaning |
|---|---|
| stale_ns, watchdog_ns | ages [ns] from which on the input is stale, and the watchdog counts as gone |
| eased, released | periods missed in a row from which on the stiffness is eased, and the fingers are freed |
| watched | 1: a watchdog must be there |
| always | bits of every tick |
| streak | periods missed, or begun late, since the last tick that came in time |
| eases | 1: these are a stall after which the stiffness is to fall, but not at once |
"""


@jit
def judge(
    interlock: Record,
    now: int,
    sample_ns: int,
    pose_ns: int,
    usable: bool,
    missed: int,
    watchdog_ns: int,
    armed: bool,
    lost: bool,
    stopping: bool,
) -> int:
    """Bits of a tick before it is solved; a bit stands as long as its reason does.

    Args:
        interlock: Of `INTERLOCK`.
        now: CLOCK_MONOTONIC [ns].
        sample_ns, pose_ns: Of sample and pose in use, -1 before the first.
        usable: Whether the newest sample that came can be used.
        missed: Periods missed right before this tick, and one more where it began late, without a sleep.
        watchdog_ns: The watchdog's last sign of life, 0 before the first.
        armed: Whether the watchdog can reach the glove.
        lost: Whether the glove is gone.
        stopping: Whether this is one of the last ticks.
    """
    bits = interlock.always
    if sample_ns < 0 or pose_ns < 0:
        bits |= NO_INPUT_YET
    elif now - min(sample_ns, pose_ns) > interlock.stale_ns:
        bits |= STALE_INPUT
    if not usable:
        bits |= NOT_FINITE
    interlock.streak = interlock.streak + missed if missed > 0 else 0
    if interlock.streak >= interlock.released:
        bits |= OVERRUN_STREAK
    interlock.eases = 1 if interlock.streak >= interlock.eased else 0
    if lost:
        bits |= DEVICE_LOST
    if stopping:
        bits |= STOPPING
    if interlock.watched == 1 and not (armed and now - watchdog_ns <= interlock.watchdog_ns):
        bits |= NO_WATCHDOG
    return bits
