"""A flood of 100,000 datagrams a second around a peer: only the peer's samples are used, and a look has a bound."""

import contextlib
import json
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import udp_flood
from live_peers import PATIENCE, Reader, free_ports
from numpy.typing import NDArray
from sampled import sampled

from hhsim.live import open_packet
from hhsim.live.devices.registry import configure, open_device
from hhsim.live.open_packet import MOST_LOOKED_AT, UdpPort

RATE = 100_000
FLOOD = Path(udp_flood.__file__)
TELLS = {"joints": 0, "hand": 1}
"""The channel that tells which sample it is."""
DEVICES = {"joints": "udp", "hand": "openxr"}


class Flood:
    """The flood while it runs, and what it sent when it has ended."""

    def __init__(self, form: str, port: int) -> None:
        words = [sys.executable, str(FLOOD), form, str(port), str(RATE)]
        self._process = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
        self.sent: dict[str, float] = {}

    def end(self) -> None:
        self._process.terminate()
        out, _ = self._process.communicate(timeout=PATIENCE)
        self.sent = json.loads(out)

    @property
    def own(self) -> float:
        """Sent from the peer's own port."""
        return sum(self.sent[kind] for kind in udp_flood.OWN)

    @property
    def foreign(self) -> float:
        """Sent by others."""
        return sum(self.sent[kind] for kind in udp_flood.KINDS if kind not in udp_flood.OWN)


@contextmanager
def flooded(form: str, port: int) -> Iterator[Flood]:
    flood = Flood(form, port)
    try:
        yield flood
    finally:
        with contextlib.suppress(ValueError):
            flood.end()


class LooksAt:
    """Counts what is taken from the system in one go, at every port."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.most = self.strangers = 0
        arrived: Callable[[UdpPort], Iterator[tuple[Any, int]]] = UdpPort.arrived
        real = socket.socket.recvfrom
        taken = 0

        def counted(link: socket.socket, *rest: Any) -> Any:
            nonlocal taken
            found = real(link, *rest)
            taken += 1
            return found

        def looked(port: UdpPort) -> Iterator[tuple[Any, int]]:
            nonlocal taken
            taken, before = 0, port.strangers
            yield from arrived(port)
            self.most = max(self.most, taken)
            self.strangers += port.strangers - before

        monkeypatch.setattr(socket.socket, "recvfrom", counted)
        monkeypatch.setattr(UdpPort, "arrived", looked)


def own_samples(form: str, samples: NDArray[np.void]) -> NDArray[np.int64]:
    """Numbers of the peer's samples that these are, which every good one of them has to be."""
    told = samples["channels"][:, TELLS[form]]
    numbers = np.asarray(samples["device_seq"])
    assert told.tolist() == [udp_flood.own_number(int(number)) for number in numbers]
    assert (np.diff(numbers) > 0).all()
    return numbers


@pytest.mark.parametrize("form", sampled(["joints", "hand"], lambda _, form: form == "hand"))
def test_nothing_is_used_that_is_not_the_peers_and_every_frame_is_accounted_for(
    form: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    # A busy machine may hold up the process that sends for longer than a peer that goes on to send is silent.
    monkeypatch.setattr(open_packet, "SESSION_SILENCE_NS", int(1e9 * PATIENCE))
    port, looks = free_ports(socket.SOCK_DGRAM), LooksAt(monkeypatch)
    with closing(open_device(configure(DEVICES[form], port=port))) as glove, flooded(form, port) as flood:
        glove.open(PATIENCE)
        reader = Reader(glove)
        reader.until(lambda: reader.count() >= 400)
        early = looks.strangers
        reader.until(lambda: reader.count() >= 800)
        # Those that were on their way when the peer was known; since then the system turns them away.
        assert looks.strangers == early
        flood.end()
        reader.until(lambda: len(reader.read()) == 0)
    numbers, counters = own_samples(form, reader.samples), glove.counters
    assert reader.samples["good"].all()
    assert counters.samples == len(reader.samples)
    assert counters.frames == counters.samples + counters.rejected + counters.other + counters.malformed <= flood.own
    assert counters.malformed > 0
    assert flood.foreign > 0
    assert counters.dropped == numbers[-1] - numbers[0] + 1 - len(numbers)
    assert counters.other > 0, "what the peer said twice is counted"
    assert 0 < looks.most <= MOST_LOOKED_AT
