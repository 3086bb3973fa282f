"""Who took the time of a period that was missed, from what the system and the loop's own clock say of it."""

from typing import Protocol

from hhsim.live.loop.deadlines import Deadlines
from hhsim.result.miss_cause import TimeTaken
from hhsim.system.cpu_accounts import CpuAccounts, risen

STEAL_TICKS = 32
"""What the host has taken is read once in so many ticks, and where a period was missed."""
STEAL_SHARE = 0.1
"""Of a period: where one reading takes longer, as on machines of very many processors, it is done without."""


class Accounts(Protocol):
    """What the system says of the loop's thread, in ns and ever rising; -1 where it does not say."""

    def cpu_ns(self) -> int:
        """CPU time of the thread."""

    def run_delay_ns(self) -> int:
        """How long it could have run and was not let."""

    def steal_ns(self) -> int:
        """How long the host had its processor."""


class MissAccounts:
    """Keeps what is needed to say of a missed period who took it: a few microseconds a tick.

    Args:
        deadlines: Of the loop.
        accounts: Of its thread; by default those of the system, of the thread that calls `begin`.

    Attributes:
        device_ns: What the calls to the devices of this tick took; the loop adds to it.
        steal_unread: Reading what the host took is too slow here.
    """

    def __init__(self, deadlines: Deadlines, accounts: Accounts | None = None) -> None:
        """Nothing is read yet."""
        self._deadlines = deadlines
        self._accounts = accounts
        self.device_ns = 0
        self.steal_unread = False
        self._device_before = 0
        self._woke = self._woke_before = self._late = self._late_before = 0
        self._cpu = self._cpu_before = self._delay = self._delay_before = self._steal = -1

    def begin(self) -> None:
        """Take the readings that the first tick is compared with, in the loop's thread."""
        if self._accounts is None:
            self._accounts = CpuAccounts()
        accounts, clock = self._accounts, self._deadlines.clock
        took = []
        for _ in range(3):
            began = clock.now()
            self._steal = accounts.steal_ns()
            took.append(clock.now() - began)
        self.steal_unread = min(took) > STEAL_SHARE * self._deadlines.period_ns
        if self.steal_unread:
            self._steal = -1
        self._cpu, self._delay, self._woke = accounts.cpu_ns(), accounts.run_delay_ns(), self._deadlines.woke_ns

    def woke(self) -> None:
        """A tick begins: what was counted until now is that of the one before."""
        accounts = self._accounts
        if accounts is None:
            return
        self._device_before, self.device_ns = self.device_ns, 0
        self._woke_before, self._woke = self._woke, self._deadlines.woke_ns
        self._late_before, self._late = self._late, self._deadlines.wakeup_ns
        self._cpu_before, self._cpu = self._cpu, accounts.cpu_ns()
        self._delay_before, self._delay = self._delay, accounts.run_delay_ns()

    def taken(self) -> TimeTaken:
        """Where the time since the deadline of the tick before went, where this tick missed periods."""
        deadlines, before = self._deadlines, self._steal
        self._read_steal()
        computed = risen(self._cpu_before, self._cpu)
        worked = deadlines.asked_ns - self._woke_before
        return TimeTaken(
            computed=computed,
            kept=self._late_before + max(0, worked - computed) + deadlines.late_ns,
            run_delay=risen(self._delay_before, self._delay),
            steal=risen(before, self._steal),
            device=self._device_before,
        )

    def at_leisure(self) -> None:
        """Read now and then what the host has taken, so that a miss is not charged with what it took long before."""
        if self._deadlines.tick % STEAL_TICKS == 0:
            self._read_steal()

    def _read_steal(self) -> None:
        if self._accounts is not None and not self.steal_unread:
            self._steal = self._accounts.steal_ns()
