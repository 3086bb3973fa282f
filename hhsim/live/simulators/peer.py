"""What the fake gloves share: a hand that moves, faults on request, and a log of every frame.

A fake glove is a process of its own, for tests, for soak runs, and to try the loop with. When it can be reached it says
`ready` and where; then it takes orders from its standard input, a line each, and answers each with `ok`. It ends when
the standard input does.

| order | what the glove does |
|---|---|
| stall, go | sends nothing and reads nothing any more; goes on |
| leave, back | its connection is gone, as when it is unplugged; is there again |
| jump F | finger F, 0 to 4, jumps by 90° in one sample and back |
| stick F | the sensor of finger F keeps its value from now on; stick 9 lets all move |
| nan | one sample holds a NaN, or what the format has for it |

Its log has a line for each frame sent and each command received: CLOCK_MONOTONIC [ns], `sent` or `command`, a number
counted from 0, and the values; `note` lines tell the faults. Each line is written at once, so that a log is whole up to
the moment of a kill.
"""

import math
import os
import select
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hhsim.live.device import FINGER_COUNT

Array = NDArray[np.float64]

JUMP = math.pi / 2.0 / math.radians(85.0)
"""Bend by which the proximal joint of a finger moves 90°."""
MARK_STEP = 0.001
"""The thumb's bend moves by this from sample to sample, so that a sample tells which one it is."""
MARK_RANGE = (0.1, 0.5)


class PeerLog:
    """Writes the log of a fake glove.

    Args:
        path: Of the log; None keeps none.
    """

    def __init__(self, path: Path | None) -> None:
        """Begin a log, or go on with one."""
        flags = os.O_WRONLY | os.O_CREAT | os.O_APPEND
        self._file = None if path is None else os.open(path, flags, 0o644)
        self._counts = {"sent": 0, "command": 0}

    def sent(self, values: Sequence[float], now_ns: int) -> None:
        """A frame was sent at `now_ns`."""
        self._line("sent", values, now_ns)

    def command(self, values: Sequence[float], now_ns: int) -> None:
        """A command was received at `now_ns`."""
        self._line("command", values, now_ns)

    def note(self, text: str) -> None:
        """Something else happened now."""
        self._write(f"{time.monotonic_ns()} note {text}\n")

    def _line(self, kind: str, values: Sequence[float], now_ns: int) -> None:
        numbers = " ".join(f"{value:.9g}" for value in values)
        self._write(f"{now_ns} {kind} {self._counts[kind]} {numbers}\n")
        self._counts[kind] += 1

    def _write(self, line: str) -> None:
        if self._file is not None:
            os.write(self._file, line.encode())


class PeerRecord(NamedTuple):
    """A log that was read: times [ns] and values of the frames sent and of the commands received, and the notes."""

    sent_ns: NDArray[np.int64]
    sent: Array
    command_ns: NDArray[np.int64]
    command: Array
    notes: list[tuple[int, str]]


def read_peer_log(path: Path) -> PeerRecord:
    """Read the log of a fake glove; a last line that was cut off is left out."""
    times: dict[str, list[int]] = {"sent": [], "command": []}
    values: dict[str, list[list[float]]] = {"sent": [], "command": []}
    notes = []
    for line in path.read_text(encoding="utf-8").splitlines(keepends=True):
        if not line.endswith("\n"):
            break
        now, kind, rest = line.rstrip("\n").split(" ", 2)
        if kind == "note":
            notes.append((int(now), rest))
        else:
            times[kind].append(int(now))
            values[kind].append([float(word) for word in rest.split()[1:]])
    return PeerRecord(
        np.array(times["sent"], dtype=np.int64),
        np.array(values["sent"], dtype=np.float64),
        np.array(times["command"], dtype=np.int64),
        np.array(values["command"], dtype=np.float64),
        notes,
    )


class FakeHand:
    """The hand in a fake glove, with its faults.

    Args:
        rate: Samples a second [Hz].
        seed: Of its motion.
    """

    def __init__(self, rate: float, seed: int) -> None:
        """Choose the motion."""
        random = np.random.default_rng(seed)
        self._step = 2.0 * np.pi / (rate * random.uniform(1.5, 3.0, FINGER_COUNT))
        self._phase = random.uniform(0.0, 2.0 * np.pi, FINGER_COUNT)
        self.jump = -1
        self.broken = False
        self.faulty = False
        """Whether a jump or a NaN shows in the last sample."""
        self._stuck: dict[int, float] = {}
        self._last = np.zeros(FINGER_COUNT)

    def stick(self, finger: int) -> None:
        """The sensor of a finger keeps its value; of no finger, all move again."""
        if 0 <= finger < FINGER_COUNT:
            self._stuck[finger] = float(self._last[finger])
        else:
            self._stuck.clear()

    def bends(self, number: int) -> Array:
        """Bend of each finger in the sample of this number, shape (5,); a fault that was asked for shows in one."""
        values: Array = 0.3 - 0.25 * np.cos(self._step * number + self._phase)
        low, high = MARK_RANGE
        turn = round((high - low) / MARK_STEP)
        values[0] = low + MARK_STEP * abs((number + turn) % (2 * turn) - turn)
        for finger, value in self._stuck.items():
            values[finger] = value
        self._last[:] = values
        self.faulty = self.jump >= 0 or self.broken
        if self.jump >= 0:
            values[self.jump] += JUMP
            self.jump = -1
        if self.broken:
            values[1] = np.nan
            self.broken = False
        return values


class FakePeer:
    """Runs a fake glove: samples at their times, commands as they come, faults as they are asked for.

    Args:
        rate: Samples a second [Hz].
        seed: Of the hand's motion.
        log: Where the frames are written down.
        orders: That this glove obeys besides those of all, with what follows the word.
    """

    def __init__(
        self, rate: float, seed: int, log: PeerLog, orders: Mapping[str, Callable[[str], None]] | None = None
    ) -> None:
        """Nothing is sent yet."""
        self._own_orders = orders or {}
        self.rate = rate
        self.log = log
        self.hand = FakeHand(rate, seed)
        self.stalled = False
        self.left = False
        self._orders = b""

    def run(
        self,
        send: Callable[[int], None],
        sources: Callable[[], dict[int, Callable[[], None]]],
        leave: Callable[[], None] | None = None,
        back: Callable[[], None] | None = None,
    ) -> None:
        """Go on until the standard input ends.

        Args:
            send: Sends the sample of this number; numbers that fell into a stall are left out.
            sources: Descriptors from which commands come, and what reads them.
            leave, back: Take the connection away, and bring it back.
        """
        start = time.monotonic()
        number = 0
        while True:
            now = time.monotonic()
            due = start + number / self.rate
            if now >= due:
                if not (self.stalled or self.left):
                    send(number)
                number = max(number + 1, int((now - start) * self.rate))
                continue
            readers = {} if self.stalled or self.left else sources()
            ready, _, _ = select.select([sys.stdin.fileno(), *readers], [], [], due - now)
            for descriptor in ready:
                if descriptor in readers:
                    readers[descriptor]()
                elif not self._obey(leave, back):
                    return

    def _obey(self, leave: Callable[[], None] | None, back: Callable[[], None] | None) -> bool:
        """Read the standard input; False where it has ended."""
        data = os.read(sys.stdin.fileno(), 4096)
        *lines, self._orders = (self._orders + data).split(b"\n")
        for line in lines:
            word, _, rest = line.decode().partition(" ")
            self.log.note(line.decode())
            if word in ("stall", "go"):
                self.stalled = word == "stall"
            elif word == "leave" and not self.left:
                self.left = True
                if leave is not None:
                    leave()
            elif word == "back" and self.left:
                self.left = False
                if back is not None:
                    back()
            elif word == "jump":
                self.hand.jump = int(rest)
            elif word == "stick":
                self.hand.stick(int(rest))
            elif word == "nan":
                self.hand.broken = True
            elif word in self._own_orders:
                self._own_orders[word](rest)
            print("ok", flush=True)
        return bool(data)
