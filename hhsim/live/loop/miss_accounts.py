"""Who took the time of a period that was missed, from what the system and the loop's own clock say of it."""

from typing import Any, Protocol

import numpy as np

from hhsim.kernels.live.accounts import MISSES, account_steal, account_waking, measure_miss, name_miss
from hhsim.kernels.live.loop import SystemFiles
from hhsim.live.loop.deadlines import Deadlines
from hhsim.result.miss_cause import TimeTaken
from hhsim.solver.workspace import zeroed
from hhsim.system.cpu_accounts import LINE_BYTES, CpuAccounts

STEAL_SHARE = 0.2
"""Of a period: where one warm reading takes longer, as on machines of very many processors, it is done without.

Two processors take 12 µs: a tenth of a period would leave the host's misses at 10 kHz without their name. A cold
reading takes eight times as long, less than two periods of the ten or more that are missed when it is done.
"""


class Accounts(Protocol):
    """What the system says of the loop's thread, in ns and ever rising; -1 where it does not say."""

    def cpu_ns(self) -> int:
        """CPU time of the thread."""

    def run_delay_ns(self) -> int:
        """How long it could have run and was not let."""

    def steal_ns(self) -> int:
        """How long the host had its processor."""


class MissAccounts:
    """Keeps what is needed to say of a missed period who took it; `hhsim.kernels.live.accounts` says it.

    Args:
        deadlines: Of the loop.
        accounts: Of its thread; by default those of the system, of the thread that calls `begin`.

    Attributes:
        state: Of `MISSES`, shape (1,).
        at: Its one record.
        steal_unread: Reading what the host took is too slow here.
    """

    def __init__(self, deadlines: Deadlines, accounts: Accounts | None = None) -> None:
        """Nothing is read yet."""
        self._deadlines = deadlines
        self._accounts = accounts
        self.state = zeroed(MISSES)
        self.at: Any = self.state[0]
        self.steal_unread = False

    def begin(self, cpu: int = -1) -> SystemFiles:
        """Take the readings that the first tick is compared with, in the loop's thread.

        Args:
            cpu: The processor that it stays on; -1 for any.

        Returns:
            Of the system's accounts, for a loop in compiled code; without what wakes the driver, or the loop.
        """
        if self._accounts is None:
            self._accounts = CpuAccounts(None if cpu < 0 else cpu)
        accounts, clock = self._accounts, self._deadlines.clock
        took = []
        for _ in range(3):
            began = clock.now()
            steal = accounts.steal_ns()
            took.append(clock.now() - began)
        self.steal_unread = min(took) > STEAL_SHARE * self._deadlines.at.period_ns
        self.at.steal_read = not self.steal_unread
        self.at.steal_ns = -1 if self.steal_unread else steal
        account_waking(self.at, self._deadlines.at.woke_ns, 0, accounts.cpu_ns(), accounts.run_delay_ns())
        return system_files(accounts) if isinstance(accounts, CpuAccounts) else NO_FILES

    def woke(self) -> None:
        """A tick begins, in a loop that Python runs."""
        at = self._deadlines.at
        if self._accounts is not None and not at.at_once:
            account_waking(self.at, at.woke_ns, at.wakeup_ns, self._accounts.cpu_ns(), self._accounts.run_delay_ns())

    def name(self) -> None:
        """Say who took the periods that this tick missed; as `woke`."""
        at = self._deadlines.at
        if self._accounts is not None and at.missed > 0:
            long_stall = measure_miss(self.at, at.asked_ns, at.late_ns)
            name_miss(self.at, self._accounts.steal_ns() if long_stall else -1)

    def keep_steal(self) -> None:
        """Read what the host took, now and then, in another thread than the loop's: a miss counts what came since."""
        if self._accounts is not None and self.at.steal_read:
            account_steal(self.at, self._accounts.steal_ns())

    def taken(self) -> TimeTaken:
        """Where the time went that the tick named last had missed."""
        return TimeTaken(*map(int, self.at.taken))


def system_files(accounts: CpuAccounts) -> SystemFiles:
    """The accounts of the system for a loop in compiled code."""
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
