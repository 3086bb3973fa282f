"""A bridge from an OpenXR headset, with or without MANUS gloves, to hhsim.

Put your headset's calls into the two functions, run this, and then `hhsim live glove --device openxr`, or `manus`. The
packet is described in docs/live-protocols.md; nothing but Python is needed.
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


def tell_fingers(payload):  # --device manus: TensorPushTracker("manus_glove_haptic", "haptic_command").push(…, payload)
    global held
    powers = struct.unpack_from("<5f", payload, 28)
    if held != (held := [power > 0 for power in powers]):  # a line where a finger is shaken or let go
        print(*(f"{power:.2f}" for power in powers), flush=True)


PERIOD = 1 / 90  # as often as the headset looks [s]
samples_to = ("127.0.0.1", int(sys.argv[1]) if len(sys.argv) > 1 else 24170)
bridge = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
bridge.bind(("127.0.0.1", samples_to[1] + 1))  # commands arrive here, each a HapticCommand
for stop in (signal.SIGINT, signal.SIGTERM):
    signal.signal(stop, lambda *_: sys.exit())
session, seq, commanded_at, payload = int.from_bytes(os.urandom(4), "little"), 0, 0.0, b""
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
                payload, commanded_at = bridge.recv(2048), time.monotonic()
            except OSError:
                break
        if payload:  # the newest alone; nobody there for 100 ms: let go
            fresh = time.monotonic() < commanded_at + 0.1
            tell_fingers(payload if fresh else payload[:28] + bytes(20) + payload[48:])
            payload = payload if fresh else b""
finally:
    if payload:
        tell_fingers(payload[:28] + bytes(20) + payload[48:])
