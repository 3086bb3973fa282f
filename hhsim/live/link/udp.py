"""Datagrams: a port where packets arrive from one sender, and which of them are new, late, or never came."""

import contextlib
import ctypes
import select
import socket
import time
from collections.abc import Callable, Iterator
from typing import Any

from hhsim.live.device import DeviceError
from hhsim.live.link.byte_stream import ready
from hhsim.live.link.udp_codec import LONGEST, PacketError, decode_packet

BUFFER = 1 << 20
"""Of the system for what is not yet read [bytes]; some seconds at 1 kHz."""

MOST_LOOKED_AT = 64
"""Datagrams taken from the system in one go."""
MOST_IN_VAIN = 32
"""So many of them may be of no use, of whatever kind and sender: a flood cannot hold up who looks."""
MODULUS = 2**32
MOST_MISSING = 4096
"""Numbers that are remembered as missing; a datagram that is later than this counts as one that came twice."""
SESSION_SILENCE_NS = 100_000_000
"""A session, and a sender, must have been silent for so long before another one is taken [ns]."""

_NOBODY = ctypes.create_string_buffer(16)
"""A `sockaddr` of the family AF_UNSPEC: what a socket is connected to that is to take datagrams from everybody."""
_C = ctypes.CDLL(None, use_errno=True)


def resolve(host: str) -> str:
    """IPv4 address of a host.

    Raises:
        DeviceError: No such host.
    """
    try:
        return socket.gethostbyname(host)
    except OSError as error:
        raise DeviceError(f"udp: no host {host}: {error.strerror or error}") from None


class UdpPort:
    """Takes datagrams without waiting; those of other hosts are not looked at.

    Once a sender is kept to, the system itself turns away everybody else, other programs of the same host too: a flood
    of theirs costs the reader nothing. Who has been silent for `SESSION_SILENCE_NS` is kept to no longer.

    Args:
        host: From which they come.
        port: Where they arrive.
        decode: Reads one, and raises `PacketError` where it is none; of open packets by default.

    Attributes:
        strangers: Datagrams that came from others.
        malformed: Datagrams that are no packets.
        hint: What last came in vain, in words.

    Raises:
        DeviceError: No such host, or the port is taken.
    """

    def __init__(self, host: str, port: int, decode: Callable[[bytes], Any] = decode_packet) -> None:
        """Open the port."""
        self._decode = decode
        self.address = resolve(host)
        self.name = f"udp port {port} from {host}"
        self.strangers = self.malformed = 0
        self.hint = ""
        self._sender: tuple[str, int] | None = None
        self._kept: tuple[str, int] | None = None
        self._kept_ns = 0
        self._used = False
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        # What comes from this machine is asked for on this machine only.
        own = self.address if self.address.startswith("127.") else ""
        try:
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER)
            self._socket.bind((own, port))
        except OSError as error:
            self._socket.close()
            raise DeviceError(f"{self.name}: cannot listen: {error.strerror or error}") from None

    def arrived(self) -> Iterator[tuple[Any, int]]:
        """The packets that have arrived, oldest first, each with when it was read, CLOCK_MONOTONIC [ns].

        Ends after `MOST_LOOKED_AT` datagrams, or `MOST_IN_VAIN` after which the sender was not kept to; what is left
        waits. Those that are no packet are counted as malformed.
        """
        in_vain = 0
        for _ in range(MOST_LOOKED_AT):
            if in_vain == MOST_IN_VAIN:
                return
            in_vain += 1
            try:
                data, sender = self._socket.recvfrom(LONGEST + 1)
            except BlockingIOError:
                self._forget_who_is_silent()
                return
            except OSError:
                # The system may hand on a complaint about something that was sent; it says nothing of what arrives.
                continue
            now = time.monotonic_ns()
            # Some of others may have been on their way when the sender was kept to.
            if sender[0] != self.address or (self._kept is not None and sender != self._kept):
                self.strangers += 1
                self.hint = f"packets come from {sender[0]} instead" if sender[0] != self.address else self.hint
                continue
            try:
                packet = self._decode(data)
            except PacketError as error:
                self.malformed += 1
                self.hint = f"what came is no {'open packet' if self._decode is decode_packet else 'packet'}: {error}"
                continue
            self._sender, self._used = sender, False
            yield packet, now
            in_vain -= self._used

    def keep_to_sender(self) -> None:
        """Whoever sent the newest packet is the peer: take nothing of others while it goes on to send."""
        self._kept_ns, self._used = time.monotonic_ns(), True
        if self._kept is None and self._sender is not None:
            # A sender that the system cannot connect to is kept to all the same, datagram by datagram.
            with contextlib.suppress(OSError):
                self._socket.connect(self._sender)
            self._kept = self._sender

    def _forget_who_is_silent(self) -> None:
        # Only where nothing waits: a reader that was itself held up has not yet heard what the peer said meanwhile.
        if self._kept is not None and time.monotonic_ns() - self._kept_ns > SESSION_SILENCE_NS:
            self._kept = None
            _C.connect(self._socket.fileno(), _NOBODY, len(_NOBODY))

    @property
    def descriptor(self) -> int:
        """Of the port, to wait on."""
        return self._socket.fileno()

    def wait(self, timeout: float) -> bool:
        """Wait until something has arrived, or for so long [s]; True where it has."""
        return ready(self._socket.fileno(), select.POLLIN, timeout)

    def close(self) -> None:
        """Close the port; never raises."""
        self._socket.close()


class PacketOrder:
    """Counts by `seq`, per session.

    Attributes:
        lost: Datagrams that were sent and have not come.
        late: Those that came behind a newer one.
        repeated: Those that came twice, or far too late.
        foreign: Those of another session while this one still spoke.
        sessions: How many sessions there were.
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
            now_ns: When it came [ns].
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
