"""What the tests of the drivers share."""

import socket
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from hhsim.live.device import GLOVE_SAMPLE, DeviceError, GloveDevice

PATIENCE = 20.0
"""Longest wait of a test for something that comes at once on a quiet machine [s]."""


def free_ports(kind: socket.SocketKind) -> int:
    """A port of 127.0.0.1 that is free, and so is the next one."""
    while True:
        with socket.socket(socket.AF_INET, kind) as first, socket.socket(socket.AF_INET, kind) as second:
            first.bind(("127.0.0.1", 0))
            port = int(first.getsockname()[1])
            try:
                second.bind(("127.0.0.1", port + 1))
            except OSError:
                continue
            return port


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
        end = time.monotonic() + PATIENCE
        while not self.device.reconnect():
            assert time.monotonic() < end, "it never came back"
            time.sleep(0.001)
