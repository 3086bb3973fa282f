"""A DOGlove and its scripts on the wire, from the published format alone: bytes put together one by one.

Sources: `Core/Src/main.c`, `Users/fsr.c`, `Users/ads1256.c`, `Users/lra_control.c` of DOGlove_Firmware, and
`glove_mcu.py`, `servo.py` of DOGlove (both MIT), from which these facts are taken and no code:

- UART, 921,600 baud, 19 words of 32 bits, little-endian: 0x55AA; the reference voltage [µV]; 16 readings of 24 bits
  with sign, of which 0x7FFFFF is 5 V; then the low 16 bits of the sum of the 17 words before, above 16 bits of
  milliseconds.
- An encoder's angle [deg] is its voltage by the reference voltage, times 360.
- UDP: 16 floats of 32 bits to port 5009, these angles; 5 floats to 5010, the servos' angles [deg].

As a program it sends a hand that closes, at 120 Hz: `python doglove_peer.py PORT [DESCRIPTOR]`, the last that of its
line.
"""

import os
import socket
import sys
import time
from collections.abc import Sequence

import numpy as np


def word(value: int) -> bytes:
    return bytes(value >> shift & 0xFF for shift in (0, 8, 16, 24))


def uart_frame(reference_uv: int, readings: Sequence[int], milliseconds: int) -> bytes:
    words = [reference_uv, *readings]
    total = sum(words) & 0xFFFF
    last = total << 16 | milliseconds & 0xFFFF
    return b"".join(word(value & 0xFFFFFFFF) for value in (0x55AA, *words, last))


def reading_of(degrees: float, reference_uv: int) -> int:
    return round(degrees / 360.0 * 1e-6 * reference_uv / 5.0 * 0x7FFFFF)


def datagram(degrees: Sequence[float]) -> bytes:
    return b"".join(np.float32(value).tobytes() for value in degrees)


def published_angles(bend: float) -> tuple[list[float], list[float]]:
    """Encoders and servos [deg] of a hand whose every joint is bent by so much [deg], split and rotation at rest.

    Where `glove_mcu.py` turns them into the model's angles, which fall below 0 as a finger bends, this turns them back.
    """
    thumb = [90.0 + bend, 270.0 - bend, 180.0, 270.0]
    finger = [90.0 + bend, 270.0 - bend, 180.0]
    return thumb + 4 * finger, [zero + bend for zero in (182.2, 165.2, 150.29, 151.44, 145.9)]


def main(port: int, line: int) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        for number in range(10_000_000):
            encoders, servos = published_angles(40.0 + 40.0 * np.sin(0.02 * number))
            out.sendto(datagram(servos), ("127.0.0.1", port + 1))
            if line >= 0:
                readings = [reading_of(angle, 3_300_000) for angle in encoders]
                os.write(line, uart_frame(3_300_000, readings, 8 * number))
            else:
                out.sendto(datagram(encoders), ("127.0.0.1", port))
            time.sleep(1.0 / 120.0)


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else -1)
