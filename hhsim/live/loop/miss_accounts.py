"""System accounts by which `hhsim.kernels.live.accounts` names the cause of a missed period."""

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from hhsim.kernels.live.accounts import MISSES, account_steal, account_waking
from hhsim.kernels.live.loop import SystemFiles
from hhsim.solver.workspace import zeroed
from hhsim.system.cpu_accounts import LINE_BYTES, CpuAccounts

STEAL_SHARE = 0.2
"""Fraction of a period: if one warm reading of the steal takes longer, as with very many processors, it is not read.

Two processors take 12 µs: a tenth of a period would leave the host's misses at 10 kHz without a cause. A cold reading
takes eight times as long, less than two periods of the ten or more that are missed when it is done.
"""


class MissAccounts:
    """Accounts of the loop's thread since the tick before, by `DEADLINES`, shape (1,), and the loop's clock [ns].

    `state` is a record of `MISSES`, shape (1,); `steal_unread` is True if reading the steal is too slow here.
    """

    def __init__(self, deadlines: Any, now: Callable[[], int] = time.monotonic_ns) -> None:
        self._deadlines = deadlines[0]
        self._now = now
        self._accounts: CpuAccounts | None = None
        self.state = zeroed(MISSES)
        self.steal_unread = False

    def begin(self, accounts: CpuAccounts) -> None:
        """Take the readings that the first tick is compared with, in the loop's thread, to which `accounts` belong."""
        self._accounts = accounts
        took = []
        for _ in range(3):
            began = self._now()
            steal = accounts.steal_ns()
            took.append(self._now() - began)
        at = self.state[0]
        self.steal_unread = min(took) > STEAL_SHARE * self._deadlines.period_ns
        at.steal_read = not self.steal_unread
        at.steal_ns = -1 if self.steal_unread else steal
        account_waking(at, self._deadlines.woke_ns, 0, accounts.cpu_ns(), accounts.run_delay_ns())

    def keep_steal(self) -> None:
        """Read the steal now and then, in another thread than the loop's, so that a miss counts only later steal."""
        if self._accounts is not None and self.state[0].steal_read:
            account_steal(self.state[0], self._accounts.steal_ns())


def system_files(accounts: CpuAccounts) -> SystemFiles:
    """Return the files of the system's accounts for compiled code, without the events that wake driver and loop."""
    allowed = np.zeros(max(accounts.processors, default=0) + 1, np.bool_)
    allowed[list(accounts.processors)] = True
    return SystemFiles(
        descriptors=np.array([accounts.schedule, accounts.stat, -1, -1]),
        line=np.zeros(LINE_BYTES, np.uint8),
        lines=np.zeros(accounts.stat_bytes, np.uint8),
        allowed=allowed,
        step=np.array([accounts.steal_step_ns]),
    )


NO_FILES = SystemFiles(
    np.full(4, -1), np.zeros(1, np.uint8), np.zeros(1, np.uint8), np.zeros(1, np.bool_), np.ones(1, np.int64)
)
