"""A fake glove as another process, for tests and long runs."""

from hhsim.live.simulators.peer import PeerRecord, read_peer_log
from hhsim.live.simulators.process import FakeProcess


class FakePeerProcess(FakeProcess):
    """A program whose log is that of `hhsim.live.simulators.peer`."""

    def record(self) -> PeerRecord:
        """What it wrote down so far."""
        return read_peer_log(self.log)
