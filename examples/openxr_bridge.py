"""A bridge from an OpenXR headset, with or without MANUS gloves, to hhsim.

Put your headset's calls into the two functions, run this, and then `hhsim live glove --device openxr --takes forces`.
The packet is described in docs/live-protocols.md; nothing but Python is needed.
"""

import math
import os
import signal
import socket
import struct
import sys
import time

held = [False] * 5  # which fingers are shaken
begun_at = time.monotonic()


def read_hand():  # xrLocateHandJointsEXT: orientation x y z w, position x y z, radius of 26 joints; NaN where not valid
    bend, joints = (
        0.5 - 0.5 * math.cos(time.monotonic() - begun_at),
        [(0.0, 1.0, -0.31, 0.015), (0.0, 1.0, -0.24, 0.02)],
    )
    for side, bones in ((-0.4, (0.05, 0.04, 0.03)), *((a, (0.06, 0.04, 0.03, 0.02)) for a in (-0.2, 0.0, 0.2, 0.4))):
        angle, x, y, z = 0.0, 0.05 * side, 1.0, -0.25  # the world's y is up, and the hand points along -z
        joints.append((x, y, z, 0.015))
        for number, bone in enumerate(bones):  # the palm of the hand is below
            angle += bend * (number > 0)
            x, y = x + bone * math.sin(side) * math.cos(angle), y - bone * math.sin(angle)
            z -= bone * math.cos(side) * math.cos(angle)
            joints.append((x, y, z, 0.008))
    return [number for x, y, z, radius in joints for number in (0.0, 0.0, 0.0, 1.0, x, y, z, radius)]


FULL = 2.0  # force on a fingertip that shakes it with full power [N]


def tell_fingers(forces):  # MANUS: TensorPushTracker("manus_glove_haptic", "haptic_command").push(…) of these powers
    global held
    powers = [min(1.0, math.hypot(*forces[3 * finger : 3 * finger + 3]) / FULL) for finger in range(5)]
    if held != (held := [power > 0 for power in powers]):  # a line where a finger is shaken or let go
        print(*(f"{power:.2f}" for power in powers), flush=True)


PERIOD = 1 / 90  # as often as the headset looks [s]
samples_to = ("127.0.0.1", int(sys.argv[1]) if len(sys.argv) > 1 else 24170)
bridge = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
bridge.bind(("127.0.0.1", samples_to[1] + 1))  # commands arrive here, x, y, z on each fingertip [N]
for stop in (signal.SIGINT, signal.SIGTERM):
    signal.signal(stop, lambda *_: sys.exit())
session, seq, commanded_at, forces = int.from_bytes(os.urandom(4), "little"), 0, 0.0, None
due = time.monotonic()
print(f"sending to port {samples_to[1]}; Ctrl-C ends it, or kill, such as kill %1 after &", file=sys.stderr)
try:
    while True:
        header = struct.pack("<4sBBHIIQIi", b"HHGL", 1, 5, 208, session, seq, time.monotonic_ns(), 2**32 - 1, -1)
        bridge.sendto(header + struct.pack("<208f", *read_hand()), samples_to)
        seq = (seq + 1) % 2**32
        # From the last deadline, not from now: what a sample took moves no later one. Deadlines gone by are left out.
        due += max(1, (time.monotonic() - due) // PERIOD) * PERIOD
        while (left := due - time.monotonic()) > 0:
            bridge.settimeout(left)
            try:
                packet, commanded_at = bridge.recv(2048), time.monotonic()
            except OSError:
                break
            if packet[:6] == b"HHGL\x01\x11" and len(packet) == 92:
                forces = struct.unpack_from("<15f", packet, 32)
                forces = forces if all(map(math.isfinite, forces)) else [0.0] * 15
        if forces:  # the newest alone; nobody there for 100 ms: let go
            fresh = time.monotonic() < commanded_at + 0.1
            tell_fingers(forces if fresh else [0.0] * 15)
            forces = forces if fresh else None
finally:
    if forces:
        tell_fingers([0.0] * 15)
