"""Reasons why the fingers must be free, judged anew in every tick."""

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
OTHER_HAND = 512
"""Bits of `hhsim.result.safety.Safety`, whose test compares them."""
FREES_BOTH = STALE_INPUT | NOT_FINITE | SOLVER_FAILED | OVERRUN_STREAK | DEVICE_LOST | NO_WATCHDOG
"""Faults of one hand that free the user's other one, too."""

INTERLOCK = np.dtype(
    [
        ("stale_ns", np.int64),  # age from which on the input is stale
        ("watchdog_ns", np.int64),  # age of its last sign of life from which on the watchdog counts as gone
        ("eased", np.int64),  # periods missed in a row from which on the stiffness is eased
        ("released", np.int64),  # and from which on the fingers are freed
        ("watched", np.int64),  # 1: a watchdog must be there
        ("always", np.int64),  # bits of every tick
        ("streak", np.int64),  # periods missed, or begun late, since the last tick in time
        ("eases", np.int64),  # 1: the stiffness is to be eased
    ],
    align=True,
)
"""Limits and state of the interlock."""


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
    """Compute the bits of a tick before it is solved; a bit stands as long as its reason does.

    Sample and pose in use came at `sample_ns` and `pose_ns`, -1 before the first; the newest sample may be unusable.
    `missed` counts the periods right before this tick, and one more if it began late, without a sleep. The watchdog's
    last sign of life is 0 before the first; it may be `armed`, that is, reach the glove, which may be `lost`.
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
    if interlock.watched == 1 and (not armed or now - watchdog_ns > interlock.watchdog_ns):
        bits |= NO_WATCHDOG
    return bits
