"""The drill of a glove that is told forces: it is told 0 in time when the loop is killed.

Its peer knows the published format alone, and writes down what it is told and when: that it has to wait for a processor
is the machine's share (`machine_share.MachineShare`), as what the session's processes wait is.
"""

import contextlib
import os
import socket
import struct
import threading
import time
from dataclasses import replace

import numpy as np
import pytest
from live_drill import Watched, grasping_setup
from live_peers import free_ports, until
from machine_share import assert_in_time, keeps_time

from hhsim.live.gloves import configure
from hhsim.live.session.supervisor import LOOP

pytestmark = [pytest.mark.slow, keeps_time]

CLOSED = 0.95
"""Bend at which the fingers rest on the cube, or would be in it."""
RATE = 100.0
LEAST = 0.05
"""A finger that feels so much is told of [N]."""


def bends(bend: float, seq: int) -> bytes:
    header = struct.pack("<4sBBHIIQIi", b"HHGL", 1, 1, 5, 5, seq, 0, 2**32 - 1, -1)
    return header + struct.pack("<5f", *[bend] * 5)


def told_force(data: bytes) -> float:
    assert data[:6] == b"HHGL\x01\x11"
    return float(np.abs(struct.unpack("<15f", data[32:])).max())


class Peer(threading.Thread):
    """A hand that closes and then rests; what it is told, and when it heard that, CLOCK_MONOTONIC [ns]."""

    def __init__(self, port: int) -> None:
        super().__init__(daemon=True)
        self._to = "127.0.0.1", port
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", port + 1))
        self.heard: list[tuple[int, float]] = []
        self.ended = False

    def run(self) -> None:
        with self._socket as link:
            begun, seq = time.monotonic(), 0
            while not self.ended:
                due = begun + seq / RATE
                left = due - time.monotonic()
                # However many commands come: a sample that is due is sent before they are heard.
                if left <= 0.0:
                    link.sendto(bends(min(CLOSED, 0.6 * (due - begun)), seq), self._to)
                    # Late ones are left out: what is heard is written down when it comes.
                    seq = max(seq + 1, int(RATE * (time.monotonic() - begun)))
                    continue
                link.settimeout(left)
                with contextlib.suppress(TimeoutError):
                    data = link.recv(2048)
                    self.heard.append((time.monotonic_ns(), told_force(data)))

    @property
    def feels(self) -> bool:
        """Whether the newest word is of a force."""
        return bool(self.heard) and self.heard[-1][1] > LEAST


def test_a_loop_that_is_killed_leaves_nobody_to_feel() -> None:
    port = free_ports(socket.SOCK_DGRAM)
    hand, drill = Peer(port), Watched()
    drill.carriers = [os.getpid()]
    device = configure("udp", port=port, takes="forces")
    hand.start()
    try:
        setup = grasping_setup([1])
        with drill.begun(replace(setup, worn=(replace(setup.worn[0], device=device),))):
            drill.until(lambda: hand.feels, "word of a force")
            killed = drill.kill(LOOP)
            drill.let_it_end(killed)
            until(lambda: hand.heard[-1][0] > killed.since and hand.heard[-1][1] <= 0.0)
    finally:
        hand.ended = True
        hand.join()
    felt = [now for now, most in hand.heard if most > 0.0]
    assert_in_time(max(felt) - killed.since, killed.allowed)
