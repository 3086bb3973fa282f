"""What the tests of the drivers share."""

import itertools
import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from hhsim.live.device import GLOVE_SAMPLE, DeviceError, GloveDevice
from hhsim.live.gloves import GloveConfig, configure
from hhsim.live.open_packet import Kind, encode_packet

Device = TypeVar("Device", bound=GloveDevice)

PATIENCE = 120.0
"""Longest wait of a test for something that comes at once on a quiet machine [s]."""
FIRST_PORT, PORT_PAIRS = 12_000, 6_000
"""Below the ports that the system gives to clients, and those of hhsim's own that are usual."""
_given = itertools.count(127 * os.getpid())


def free_ports(kind: socket.SocketKind) -> int:
    """A port of 127.0.0.1 that is free, and so is the next one; no other test of this process has had it."""
    while True:
        port = FIRST_PORT + 2 * (next(_given) % PORT_PAIRS)
        with socket.socket(socket.AF_INET, kind) as first, socket.socket(socket.AF_INET, kind) as second:
            try:
                first.bind(("127.0.0.1", port))
                second.bind(("127.0.0.1", port + 1))
            except OSError:
                continue
            return port


def until(reached: Callable[[], object]) -> None:
    """Wait until something is so."""
    end = time.monotonic() + PATIENCE
    while not reached():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.002)


class Reader:
    """Collects the samples of a device."""

    def __init__(self, device: GloveDevice) -> None:
        self.device = device
        self.parts = [np.zeros(0, GLOVE_SAMPLE)]
        self._buffer = np.zeros(64, GLOVE_SAMPLE)

    @property
    def samples(self) -> NDArray[np.void]:
        return np.concatenate(self.parts)

    def read(self) -> NDArray[np.void]:
        fresh = self._buffer[: self.device.read(self._buffer)].copy()
        self.parts.append(fresh)
        return fresh

    def until(self, done: Callable[[], bool]) -> None:
        """Read again and again until something is so."""

        def is_done() -> bool:
            self.read()
            return done()

        until(is_done)

    def count(self) -> int:
        return sum(map(len, self.parts))

    def until_lost(self) -> str:
        """Read until the device is gone; what it says."""
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            try:
                self.read()
            except DeviceError as error:
                return str(error)
            time.sleep(0.001)
        raise AssertionError("the device was never lost")


class Bridge:
    """A bridge of the open packet in the same process: a test sends what it wants, and hears commands."""

    def __init__(self) -> None:
        self.port = free_ports(socket.SOCK_DGRAM)
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", self.port + 1))
        self.socket.settimeout(PATIENCE)

    def packet(self, kind: Kind, values: object, seq: int, **other: int) -> bytes:
        return encode_packet(kind, np.asarray(values), seq=seq, **{"session": 1, "t_ns": 1000 * seq, **other})

    def send(self, kind: Kind, values: object, seq: int, **other: int) -> None:
        self.send_bytes(self.packet(kind, values, seq, **other))

    def send_bytes(self, data: bytes) -> None:
        self.socket.sendto(data, ("127.0.0.1", self.port))

    def config(self, kind: str = "udp", **settings: Any) -> GloveConfig:
        return configure(kind, port=self.port, **settings)

    @contextmanager
    def opened(self, device: Device, first: bytes) -> Iterator[Device]:
        """A device to which the same datagram is sent again and again, until it is open."""
        heard = threading.Event()

        def send() -> None:
            while not heard.wait(0.005):
                self.send_bytes(first)

        sender = threading.Thread(target=send)
        sender.start()
        with closing(device):
            try:
                device.open(PATIENCE)
            finally:
                heard.set()
                sender.join()
            yield device


@contextmanager
def example(path: Path, port: int) -> Iterator[subprocess.Popen[str]]:
    """An example's bridge as another process, and what it prints."""
    words = [sys.executable, "-u", str(path), str(port)]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as bridge:
        try:
            yield bridge
        finally:
            bridge.kill()
