"""A peer that sends its samples, and a flood around it, from another process: what a loop must stand.

As a program: `python udp_flood.py FORM PORT RATE`, until SIGTERM. Each millisecond it sends one sample of the peer, and
RATE datagrams a second besides, in turn: a stranger's, from another address; an impostor's, from another port of the
peer's address, which knows the session and is ahead of it, or gives back what the peer sent; and, from the peer's own
port, what is no packet and what it has sent before. It prints a line of JSON: what it sent of each.

Formats are those of docs/live-protocols.md alone. Numbers of the peer's samples tell which sample they are of, and no
other's do.
"""

import json
import signal
import socket
import struct
import sys
import time
from collections.abc import Callable

SESSION, IMPOSTOR = 77, 0.25
"""A session that everybody knows; what an impostor's numbers are."""
KINDS = ("samples", "stranger", "ahead", "given back", "no packet", "repeated")
OWN = ("samples", "no packet", "repeated")
"""From the peer's own port."""
ALONE = 0.1
"""So long the peer speaks alone [s]: who comes first is taken for it."""
NAP = 2e-4
SLOW = 1000
"""Samples of the peer in a second."""


def packet(kind: int, seq: int, numbers: list[float], session: int = SESSION) -> bytes:
    header = struct.pack("<4sBBHIIQIi", b"HHGL", 1, kind, len(numbers), session, seq, 1000 * seq, 2**32 - 1, -1)
    return header + struct.pack(f"<{len(numbers)}f", *numbers)


def own_number(seq: int) -> float:
    """Of the peer's sample of this number, exact in 32 bits, never `IMPOSTOR`, and never far from the one before."""
    place = seq % 8192
    return min(place, 8191 - place) * 2.0**-13 + 2.0**-20


def joints(seq: int, number: float) -> bytes:
    return packet(3, seq, [number] * 20)


def hand(seq: int, number: float) -> bytes:
    """A flat hand whose wrist has this height."""
    points = [(0.0, -0.04), (0.0, 0.0)]
    for side, first in ((-0.03, -0.02), (-0.02, -0.03), (0.0, -0.03), (0.02, -0.03), (0.04, -0.03)):
        points += [(side, first - 0.035 * k) for k in range(4 if side == -0.03 else 5)]
    return packet(5, seq, [part for x, z in points for part in (0.0, 0.0, 0.0, 1.0, x, number, z, 0.01)])


FORMS: dict[str, Callable[[int, float], bytes]] = {"joints": joints, "hand": hand}


def main(form: str, port: int, rate: float) -> None:
    make, target = FORMS[form], ("127.0.0.1", port)
    peer, stranger, impostor = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(3))
    stranger.bind(("127.0.0.2", 0))
    sent = dict.fromkeys(KINDS, 0)
    ending: list[int] = []
    signal.signal(signal.SIGTERM, lambda number, frame: ending.append(number))
    start, turn = time.monotonic(), 0
    old = forged = b""
    while not ending:
        now = time.monotonic() - start
        if now >= sent["samples"] / SLOW:
            seq = sent["samples"]
            old, forged = make(seq, own_number(seq)), make(seq + 1000, IMPOSTOR)
            kind, link, data = "samples", peer, old
        elif now >= ALONE + turn / rate:
            kind, link, data = (
                ("stranger", stranger, forged),
                ("ahead", impostor, forged),
                ("given back", impostor, old),
                ("no packet", peer, b"HHGL" + bytes(turn % 40)),
                ("repeated", peer, old),
            )[turn % 5]
            turn += 1
        else:
            if min(sent["samples"] / SLOW, ALONE + turn / rate) - now > NAP:
                time.sleep(NAP)
            continue
        link.sendto(data, target)
        sent[kind] += 1
    print(json.dumps({**sent, "seconds": time.monotonic() - start}), flush=True)


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), float(sys.argv[3]))
