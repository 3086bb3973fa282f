"""A bridge from any glove to hhsim.

Put the glove's own calls into the two functions, run this, and then `hhsim live glove --device udp`. The packet is
described in docs/live-protocols.md; nothing but Python is needed.
"""

import math
import os
import select
import signal
import socket
import struct
import sys
import time

held = [False] * 5  # which fingers are stopped
begun_at = math.inf  # first command; the example's hand is flat until then, so that it begins outside the object


def read_bends():  # bend of thumb, index, middle, ring and little finger, 0 (flat) to 1 (fist)
    return [0.3 - 0.3 * math.cos(max(0.0, time.monotonic() - begun_at))] * 5


def tell_fingers(bend, stiffness):  # stop each finger at this bend, this hard: 0 (free) to 1
    global held
    if held != (
        held := [s > 0 for s in stiffness]
    ):  # a line where a finger is stopped or let go, not a thousand a second
        print(*(f"{b:.2f}/{s:.2f}" for b, s in zip(bend, stiffness)), flush=True)


PERIOD = 1_000_000  # from sample to sample [ns]
samples_to = ("127.0.0.1", int(sys.argv[1]) if len(sys.argv) > 1 else 24170)
bridge = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
bridge.bind(("127.0.0.1", samples_to[1] + 1))  # commands arrive here
for stop in (signal.SIGINT, signal.SIGTERM):  # by kill too, which would else let nobody go
    signal.signal(stop, lambda *_: sys.exit())
session, seq, commanded_at, free = int.from_bytes(os.urandom(4), "little"), 0, 0.0, True
due = time.monotonic_ns()
print(f"sending to port {samples_to[1]}; Ctrl-C ends it, or kill, such as kill %1 after &", file=sys.stderr)
try:
    while True:
        header = struct.pack("<4sBBHIIQIi", b"HHGL", 1, 1, 5, session, seq, time.monotonic_ns(), 2**32 - 1, -1)
        bridge.sendto(header + struct.pack("<5f", *read_bends()), samples_to)
        seq = (seq + 1) % 2**32
        # From the last deadline, not from now: what a sample took moves no later one. Deadlines gone by are left out.
        due += max(1, (time.monotonic_ns() - due) // PERIOD) * PERIOD
        while (left := due - time.monotonic_ns()) > 0:
            if not select.select([bridge], [], [], 1e-9 * left)[0]:  # a socket's own timeout counts milliseconds
                continue
            try:
                data = bridge.recv(2048)
            except OSError:
                continue
            if len(data) == 72 and data[:6] == b"HHGL\x01\x10":
                numbers = struct.unpack_from("<10f", data, 32)
                if all(map(math.isfinite, numbers)):
                    tell_fingers(numbers[:5], numbers[5:])
                    commanded_at, free = time.monotonic(), False
                    begun_at = min(begun_at, commanded_at)
        if not free and time.monotonic() > commanded_at + 0.1:  # nobody is there any more: let go
            tell_fingers([0] * 5, [0] * 5)
            begun_at, free = math.inf, True
finally:  # the glove's calls failed, or the bridge is stopped: let go too
    tell_fingers([0] * 5, [0] * 5)
