"""Base class of gloves whose samples come in the open packet of `hhsim.live.link.udp_codec`."""

import contextlib
import os
import socket
import time
from abc import abstractmethod
from collections import deque
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from hhsim.arrays import FloatArray
from hhsim.live.device import FINGER_COUNT, UNKNOWN, DeviceCounters, DeviceError, FingerCommand, GloveDevice, GloveInfo
from hhsim.live.link.udp import PacketOrder, UdpPort, resolve
from hhsim.live.link.udp_codec import NONE_YET, Kind, Packet

SILENCE_NS = 500_000_000
"""Silence after which a bridge counts as gone [ns]; the fingers are free long before."""
RELEASE_COPIES = 3
"""Datagrams a release is sent in, as one may be lost."""


class PacketGlove(GloveDevice):
    """Glove of a bridge.

    Samples arrive at `port`, and commands go to the next one. Samples are used in the order of their sequence numbers;
    late ones are left out and counted. The first packet sets the kind of numbers that the bridge sends.
    """

    SAMPLES: ClassVar[tuple[Kind, ...]]
    """Kinds of packets that are samples."""

    def __init__(self, host: str, port: int, name: str) -> None:
        self._host, self._port_number = host, port
        self._name = f"{name} at {host}, samples to port {port}"
        self._port: UdpPort | None = None
        self._out: socket.socket | None = None
        self._target = ("", 0)
        self._session = int.from_bytes(os.urandom(4), "little")
        self._sent = 0
        self._answers = NONE_YET
        self._order = PacketOrder()
        self._kind = self.SAMPLES[0]
        self._unused: Kind | None = None
        self._hint_raised = False
        self._waiting: deque[tuple[Packet, int]] = deque()
        self._heard_ns = 0
        self._flexion, self._abduction = np.zeros((FINGER_COUNT, 3)), np.zeros(FINGER_COUNT)
        self.counters = DeviceCounters()
        self._known = False

    @abstractmethod
    def _describe(self, first: Packet) -> GloveInfo:
        """Describe the glove from its first packet; raises InputError where the settings do not fit its numbers."""

    @abstractmethod
    def _take(self, values: FloatArray, now_ns: int) -> bool:
        """Set `_flexion` and `_abduction` from a sample's numbers; False beyond a hand's range."""

    def _channels(self, values: FloatArray) -> FloatArray:
        """Return the recorded numbers of a sample."""
        return values

    def _command(self, command: FingerCommand | None) -> bytes:
        """Encode a command, None or not finite for a release; empty where the glove takes none."""
        return b""

    def open(self, timeout: float = 5.0) -> None:
        """See `GloveDevice.open`; waits for the first sample."""
        self.open_for_release(timeout)
        self._waiting.clear()
        self._known, self._unused = False, None
        try:
            self._port = UdpPort(self._host, self._port_number)
        except DeviceError:
            self.close()
            raise
        deadline = time.monotonic() + timeout
        while not self._waiting:
            left = deadline - time.monotonic()
            if left <= 0.0:
                hint = self._rejected_input() or "is the bridge running, and does it send to that port?"
                self.close()
                raise DeviceError(f"{self._name}: no sample came within {timeout:g} s: {hint}")
            self._port.wait(left)
            self._receive(1)
        packet = self._waiting[0][0]
        self._kind, self._known = packet.kind, True
        self.info = self._describe(packet)

    def open_for_release(self, timeout: float = 5.0) -> None:
        """See `GloveDevice.open_for_release`; the port of the samples stays with the loop."""
        self.close()
        self._target = (resolve(self._host), self._port_number + 1)
        self._out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._out.setblocking(False)

    def read(self, samples_out: NDArray[np.void]) -> int:
        """See `GloveDevice.read`."""
        if self._port is None:
            raise DeviceError(f"{self._name}: not open")
        self._receive(len(samples_out) - len(self._waiting))
        count = 0
        while self._waiting and count < len(samples_out):
            packet, now = self._waiting.popleft()
            self._store(packet, now, samples_out[count])
            count += 1
        if count == 0 and time.monotonic_ns() - self._heard_ns > SILENCE_NS:
            hint = self._rejected_input()
            self._hint_raised = bool(hint)
            what = "no sample" if hint else "nothing"
            raise DeviceError(f"{self._name}: {what} came for {1e-9 * SILENCE_NS:g} s{hint and ': '}{hint}")
        return count

    def descriptors(self) -> tuple[int, ...]:
        """See `GloveDevice.descriptors`."""
        return () if self._port is None else (self._port.descriptor,)

    def send(self, command: FingerCommand) -> bool:
        """See `GloveDevice.send`; fingers of a command that is not finite are free."""
        if self._send(self._command(command)):
            return True
        self.counters.commands_refused += 1
        return False

    def release(self, timeout: float = 0.05) -> bool:
        """See `GloveDevice.release`."""
        sent = False
        for _ in range(RELEASE_COPIES):
            with contextlib.suppress(DeviceError):
                sent = self._send(self._command(None)) or sent
        return sent

    def reconnect(self) -> bool:
        """See `GloveDevice.reconnect`; the bridge is back with its next sample."""
        if self._port is None:
            return self._out is not None
        if not self._waiting:
            self._receive(1)
        if not self._waiting and not self._hint_raised and (hint := self._rejected_input()):
            self._hint_raised = True
            raise DeviceError(f"{self._name}: {hint}")
        return bool(self._waiting)

    def close(self) -> None:
        """See `GloveDevice.close`."""
        if self._port is not None:
            self._port.close()
        if self._out is not None:
            self._out.close()
        self._port = self._out = None

    def _send(self, data: bytes) -> bool:
        if self._out is None:
            raise DeviceError(f"{self._name}: not open")
        if not data:
            return True
        try:
            self._out.sendto(data, self._target)
        except (BlockingIOError, InterruptedError):
            return False
        except OSError as error:
            raise DeviceError(f"{self._name}: cannot send: {error.strerror or error}") from None
        self._sent += 1
        self.counters.commands += 1
        return True

    def _receive(self, most: int) -> None:
        """Take at most so many samples of what has arrived; each datagram is counted."""
        assert self._port is not None
        if most < 1:
            return
        counters, before = self.counters, self._port.malformed
        for packet, now in self._port.arrived():
            counters.frames += 1
            if packet.kind not in self.SAMPLES or (self._known and packet.kind is not self._kind):
                counters.other += 1
                self._unused = packet.kind
            elif self._order.take(packet.session, packet.seq, now):
                self._port.keep_to_sender()
                self._waiting.append((packet, now))
                self._heard_ns = now
                self._unused, self._port.hint = None, ""
                most -= 1
                if most < 1:
                    break
            else:
                counters.other += 1
        malformed = self._port.malformed - before
        counters.malformed += malformed
        counters.frames += malformed
        counters.dropped = self._order.lost
        counters.resyncs = max(0, self._order.sessions - 1)

    def _rejected_input(self) -> str:
        """Describe packets since the last sample that are none; "" without any."""
        if self._unused is None:
            return self._port.hint if self._port is not None else ""
        if self._known:
            wanted = f"this glove's are of kind {int(self._kind)}"
        else:
            wanted = f"a glove's are of kind {', '.join(str(int(kind)) for kind in self.SAMPLES)}"
        return f"packets of kind {int(self._unused)} come; {wanted}"

    def _store(self, packet: Packet, now: int, row: np.void) -> None:
        values = packet.values.astype(np.float64)
        good = self._take(values, now)
        self._answers = packet.seq
        self._write_sample(
            row,
            now,
            good,
            self._channels(values),
            (self._flexion, self._abduction),
            device_time_ns=packet.t_ns if packet.t_ns < 2**63 else UNKNOWN,
            device_seq=packet.seq,
            battery=packet.battery if 0 <= packet.battery <= 100 else UNKNOWN,
        )
