"""Which datagrams of a sender are new, which are late, and which never came."""

MODULUS = 2**32
MOST_MISSING = 4096
"""Numbers that are remembered as missing; a datagram that is later than this counts as one that came twice."""
SESSION_SILENCE_NS = 100_000_000
"""A session must have been silent for so long before another one is taken [ns]."""


class PacketOrder:
    """Counts by `seq`, per session.

    Attributes:
        lost: datagrams that were sent and have not come.
        late: those that came behind a newer one.
        repeated: those that came twice, or far too late.
        foreign: those of another session while this one still spoke.
        sessions: how many sessions there were.
    """

    def __init__(self) -> None:
        """Nothing came yet."""
        self.lost = self.late = self.repeated = self.foreign = self.sessions = 0
        self._session = -1
        self._newest = -1
        self._newest_ns = 0
        self._missing: dict[int, None] = {}

    def take(self, session: int, seq: int, now_ns: int) -> bool:
        """Whether this datagram is newer than all before it.

        Args:
            session, seq: of the datagram.
            now_ns: when it came [ns].
        """
        if session != self._session:
            if self._session >= 0 and now_ns - self._newest_ns < SESSION_SILENCE_NS:
                self.foreign += 1
                return False
            self.sessions += 1
            self._session, self._newest, self._newest_ns = session, seq, now_ns
            self._missing.clear()
            return True
        ahead = (seq - self._newest) % MODULUS
        if 0 < ahead < MODULUS // 2:
            self.lost += ahead - 1
            for step in range(max(1, ahead - MOST_MISSING), ahead):
                self._missing[(self._newest + step) % MODULUS] = None
            while len(self._missing) > MOST_MISSING:
                del self._missing[next(iter(self._missing))]
            self._newest, self._newest_ns = seq, now_ns
            return True
        if seq in self._missing:
            del self._missing[seq]
            self.lost -= 1
            self.late += 1
        else:
            self.repeated += 1
        return False
