"""The drills of the gloves that are told forces: whatever breaks, they are told 0 in time.

Their peers know the published formats alone (`openxr_peer`), and write down what they are told, and when the system had
it: a peer that has to wait for a processor reads late what it was told in time.
"""

import contextlib
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from live_drill import Watched, grasping_setup
from live_peers import free_ports, until
from machine_share import assert_in_time, keeps_time
from openxr_peer import Location, hand_datagram
from renewed import Renewed
from sampled import sampled

from hhsim.hand.model import HandModel
from hhsim.live.gloves import configure
from hhsim.live.session.supervisor import LOOP
from hhsim.recordings.dexmo_regression import BEND, DexmoRegression

pytestmark = [pytest.mark.slow, keeps_time]

CLOSED = 0.95
"""Bend at which the fingers rest on the cube, or would be in it."""
RATE = 100.0
LEAST = 0.05
"""A finger that feels so much is told of [N]."""
SO_TIMESTAMPNS = 35
"""Has the system say when a datagram was there, CLOCK_REALTIME (socket(7)); Python has no name for it."""


@cache
def right_hand() -> HandModel:
    return HandModel.default("right")


def hand_of_bends(bend: float, seq: int) -> bytes:
    """26 joints of our own hand, all fingers bent alike."""
    hand = right_hand()
    channels = np.zeros(11)
    channels[list(BEND)] = bend
    fingers = hand.joints(
        np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0, 0.0]), *DexmoRegression.default().angles(channels)
    )
    wrist = np.array([-0.070 * hand.hand_breadth, -0.223 * hand.hand_length, 1.0])
    points = [wrist, wrist, *fingers[0]]
    for finger in fingers[1:]:
        points += [0.5 * (finger[0] + wrist), *finger]
    # OpenXR's world has y up.
    joints = [Location((0.0, 0.0, 0.0, 1.0), (float(x), float(z), -float(y)), 0.01) for x, y, z in points]
    return hand_datagram(joints, 5, seq, 0)


def bends(bend: float, seq: int) -> bytes:
    header = struct.pack("<4sBBHIIQIi", b"HHGL", 1, 1, 5, 5, seq, 0, 2**32 - 1, -1)
    return header + struct.pack("<5f", *[bend] * 5)


def told_force(data: bytes) -> float:
    assert data[:6] == b"HHGL\x01\x11"
    return float(np.abs(struct.unpack("<15f", data[32:])).max())


def realtime_offset() -> int:
    """What CLOCK_REALTIME is ahead of CLOCK_MONOTONIC [ns], by the reading that took least."""
    readings = [(time.monotonic_ns(), time.time_ns(), time.monotonic_ns()) for _ in range(20)]
    before, now, _ = min(readings, key=lambda reading: reading[2] - reading[0])
    return now - before


class Peer(threading.Thread):
    """A hand that closes and then rests; what it is told, and when that was there, CLOCK_MONOTONIC [ns]."""

    def __init__(self, port: int, sample: Callable[[float, int], bytes], told: Callable[[bytes], float]) -> None:
        super().__init__(daemon=True)
        self._sample, self._told, self._to = sample, told, ("127.0.0.1", port)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        self._socket.bind(("127.0.0.1", port + 1))
        self._offset = realtime_offset()
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
                    link.sendto(self._sample(min(CLOSED, 0.6 * (due - begun)), seq), self._to)
                    # Late ones are left out: what is heard is written down when it comes.
                    seq = max(seq + 1, int(RATE * (time.monotonic() - begun)))
                    continue
                link.settimeout(left)
                with contextlib.suppress(TimeoutError):
                    data, ((_, _, stamp),), _, _ = link.recvmsg(2048, 256)
                    seconds, nanoseconds = struct.unpack("qq", stamp)
                    self.heard.append((10**9 * seconds + nanoseconds - self._offset, self._told(data)))

    @property
    def feels(self) -> bool:
        """Whether the newest word is of a force."""
        return bool(self.heard) and self.heard[-1][1] > LEAST

    def felt_after(self, since: int) -> int:
        """How long after `since` it was last told of a force [ns]; negative where it was not."""
        felt = [now for now, most in self.heard if most > 0.0]
        return max(felt) - since


class Worn(Watched):
    """A peer, and the session in which one of its fingers feels something."""

    def __init__(self, peer: Peer) -> None:
        super().__init__()
        self.peer = peer


@contextmanager
def worn(kind: str) -> Iterator[Worn]:
    port = free_ports(socket.SOCK_DGRAM)
    sample = hand_of_bends if kind == "openxr" else bends
    peer, device = Peer(port, sample, told_force), configure(kind, port=port, takes="forces")
    held = Worn(peer)
    peer.start()
    try:
        setup = grasping_setup([1])
        with held.begun(replace(setup, worn=(replace(setup.worn[0], device=device),))):
            held.until(lambda: peer.feels, "word of a force")
            yield held
    finally:
        peer.ended = True
        peer.join()


@pytest.fixture(scope="module", params=sampled(["openxr", "udp"], lambda _, kind: kind == "openxr"))
def peers(request: pytest.FixtureRequest) -> Iterator[Renewed[Worn]]:
    with Renewed(lambda: worn(request.param), lambda held: held.sound) as shared:
        yield shared


@pytest.fixture
def drill(request: pytest.FixtureRequest, peers: Renewed[Worn]) -> Iterator[Worn]:
    yield from peers.use(request.node)


def test_a_loop_that_is_killed_leaves_nobody_to_feel(drill: Worn) -> None:
    hand = drill.peer
    drill.until(lambda: hand.feels, "word of a force")
    killed = drill.kill(LOOP)
    drill.let_it_end(killed)
    until(lambda: hand.heard[-1][0] > killed.since and hand.heard[-1][1] <= 0.0)
    assert_in_time(hand.felt_after(killed.since), killed.allowed)
