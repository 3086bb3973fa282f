"""What the tests of the drivers share."""

import itertools
import os
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hhsim.live.device import GLOVE_SAMPLE, DeviceError, GloveDevice

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


def until_listened_to(*ports: int) -> None:
    """Wait until somebody has these UDP ports: a datagram before that is lost."""
    until(lambda: all(f":{port:04X} " in Path("/proc/net/udp").read_text() for port in ports))


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

    def until(self, done: Callable[[], bool], each: Callable[[], object] = lambda: None) -> None:
        """Read at 1 kHz until something is so."""
        end = time.monotonic() + PATIENCE
        while not done():
            assert time.monotonic() < end, "it never came"
            self.read()
            each()
            time.sleep(0.001)

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

    def until_back(self) -> None:
        until(self.device.reconnect)


@contextmanager
def example(path: Path, port: int) -> Iterator[subprocess.Popen[str]]:
    """An example's bridge as another process, and what it prints."""
    words = [sys.executable, "-u", str(path), str(port)]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as bridge:
        try:
            yield bridge
        finally:
            bridge.kill()
