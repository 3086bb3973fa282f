"""A glove that speaks the letter format of OpenGloves: LucidGloves and their kin, on a serial line or over TCP.

What such a glove takes is a position limit without a stiffness: a servo blocks the finger's string. So a stiffness here
moves the limit: from free at 0 to the wanted bend at `FULL_STIFFNESS` and above.

hhsim connects to the glove and never waits for it to connect: the guardian needs a connection of its own.
"""

import math
import time
from collections import deque
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hhsim.errors import InputError
from hhsim.hand.fingers import FINGERS
from hhsim.live.device import (
    FINGER_COUNT,
    UNKNOWN,
    Capability,
    DeviceCounters,
    DeviceError,
    FingerCommand,
    GloveDevice,
    GloveInfo,
)
from hhsim.live.devices.calibration import load_calibration
from hhsim.live.link.opengloves_codec import (
    FULL_LIMIT,
    RELEASE,
    GloveLine,
    LineError,
    LineStream,
    format_limits,
    parse_line,
)
from hhsim.live.link.serial import SerialLink
from hhsim.live.link.tcp import TcpLink
from hhsim.recordings.dexmo_regression import BEND, CHANNELS, DexmoRegression

if TYPE_CHECKING:
    from hhsim.live.devices.registry import DeviceConfig

FULL_SCALE = 4095.0
"""Of a reading, without a calibration that says otherwise."""
FULL_STIFFNESS = 0.25
FAR = (-0.5, 1.5)
"""Normalised bends beyond are of no hand."""
MOST_MALFORMED = 20
"""So many lines in a row that cannot be read are told once, as lost framing."""
SPLIT = tuple(CHANNELS.index(f"{finger}_split") for finger in FINGERS)
BONES = ("metacarpal", "proximal", "middle", "distal")


class OpenGlovesGlove(GloveDevice):
    """One glove.

    Its curls are the bends of `hhsim.recordings.dexmo_regression`; where it sends every joint, each joint goes its own
    way.

    Args:
        config: `path` and `baud` of the serial line, or `host` and `port`; `calibration` where its curls are not 0 to
            `full_scale`.

    Raises:
        InputError: a calibration that cannot be read, or a baud rate or full scale that is none.
    """

    def __init__(self, config: "DeviceConfig") -> None:
        """Read the calibration; nothing is connected yet."""
        if not (math.isfinite(config.full_scale) and config.full_scale >= 0.0):
            raise InputError(f"full scale {config.full_scale}; expected the largest reading, such as 1023 or 4095")
        path = Path(config.calibration) if config.calibration else None
        calibration = load_calibration(path, config.hand, config.profile)
        self._regression = calibration.counts or calibration.regression
        self._scale = 1.0 if calibration.counts else config.full_scale or FULL_SCALE
        self._serial = bool(config.path)
        self._link: SerialLink | TcpLink
        if self._serial:
            self._link = SerialLink(config.path, config.baud, f"opengloves at {config.path}, {config.baud} baud")
        else:
            self._link = TcpLink(config.host, config.port_used, f"opengloves at {config.host}:{config.port_used}")
        self._stream = LineStream(whole=True)
        self._waiting: deque[tuple[bytes, int]] = deque()
        self._lost: DeviceError | None = None
        self._malformed_run = 0
        self._overlong = 0
        self._seq = 0
        self._flexion, self._abduction = self._regression.angles(self._regression.open)
        self.counters = DeviceCounters()
        self.info = GloveInfo(
            name=self._link.name,
            capabilities=Capability.POSITION_LIMIT,
            channels=(
                *(f"{finger}_curl" for finger in FINGERS),
                *(f"{finger}_splay" for finger in FINGERS),
                *(f"{finger}_{bone}" for finger in FINGERS for bone in BONES),
            ),
            hand=config.hand,
            unit="count",
            doubtful=calibration.doubtful,
            kept_free=calibration.kept_free,
        )

    def open(self, timeout: float = 5.0) -> None:
        """See `GloveDevice.open`; waits for the first sample, which a board that resets sends after a second or two."""
        deadline = time.monotonic() + timeout
        self.open_for_release(timeout)
        self._waiting.clear()
        self._begin_stream()
        seen, bad = b"", 0
        while (left := deadline - time.monotonic()) > 0.0:
            self._link.wait(left)
            fresh = self._receive()
            seen = (seen + fresh)[:40]
            for line, _ in list(self._waiting)[bad:]:
                try:
                    found = parse_line(line)
                except LineError:
                    bad += 1
                    continue
                if found is not None:
                    self._describe(found)
                    return
                bad += 1
        self._link.close()
        if seen:
            raise DeviceError(
                f"{self._link.name}: sends {seen!r}, no line of the letter format: is the baud rate right?"
            )
        raise DeviceError(f"{self._link.name}: sent nothing within {timeout:g} s: is this the glove's line?")

    def open_for_release(self, timeout: float = 5.0) -> None:
        """See `GloveDevice.open_for_release`; a serial line is not read by the guardian."""
        self._lost = None
        self._link.connect(timeout)

    def drain(self) -> None:
        """See `GloveDevice.drain`; what a serial line brings is the loop's."""
        if isinstance(self._link, SerialLink):
            self._link.check()
            return
        for _ in range(4):
            if self._link.receive() is None:
                return

    def read(self, samples_out: NDArray[np.void]) -> int:
        """See `GloveDevice.read`."""
        if self._lost is None:
            try:
                self._receive()
            except DeviceError as error:
                # What came before the end is still to be handed on.
                self._lost = error
        count = 0
        while self._waiting and count < len(samples_out):
            line, now = self._waiting.popleft()
            count += self._store(line, now, samples_out[count])
        if count == 0 and self._lost is not None and not self._waiting:
            raise self._lost
        return count

    def send(self, command: FingerCommand) -> bool:
        """See `GloveDevice.send`; fingers of a command that is not finite are free."""
        if self._link.send(format_limits(limits(command))):
            self.counters.commands += 1
            return True
        self.counters.commands_refused += 1
        return False

    def release(self, timeout: float = 0.05) -> bool:
        """See `GloveDevice.release`; on a fresh connection where this one takes nothing."""
        before = self._link.connection
        sent = self._link.send_within(RELEASE, timeout)
        if self._link.connection != before:
            self._begin_stream()
            self._lost = None
        self.counters.commands += sent
        return sent

    def reconnect(self) -> bool:
        """See `GloveDevice.reconnect`; the glove may say nothing yet."""
        if self._lost is None and self._link.connected:
            return True
        if not self._link.reconnect():
            return False
        self._lost = None
        self._begin_stream()
        self.counters.resyncs += 1
        return True

    def close(self) -> None:
        """See `GloveDevice.close`."""
        self._link.close()

    def _begin_stream(self) -> None:
        """A connection begins with a line, a serial line anywhere."""
        self._stream, self._overlong, self._malformed_run = LineStream(whole=not self._serial), 0, 0

    def _receive(self) -> bytes:
        data = self._link.receive()
        if data is None:
            return b""
        now = time.monotonic_ns()
        self._waiting.extend((line, now) for line in self._stream.feed(data))
        overlong = self._stream.overlong - self._overlong
        self._overlong += overlong
        self.counters.frames += overlong
        self.counters.malformed += overlong
        return data

    def _store(self, line: bytes, now: int, row: np.void) -> int:
        """Write a sample; 1 where there is one."""
        self.counters.frames += 1
        try:
            found = parse_line(line)
        except LineError:
            self.counters.malformed += 1
            self._malformed_run += 1
            if self._malformed_run == MOST_MALFORMED:
                self.counters.resyncs += 1
            return 0
        self._malformed_run = 0
        if found is None:
            self.counters.other += 1
            return 0
        good = self._angles(found)
        row["seq"] = self._seq
        row["time_ns"] = now
        row["device_time_ns"] = row["device_seq"] = row["battery"] = UNKNOWN
        row["good"] = good
        row["channels"] = math.nan
        row["channels"][:30] = (*found.curl, *found.splay, *(value for bones in found.joints for value in bones))
        row["flexion"], row["abduction"] = self._flexion, self._abduction
        self._seq += 1
        self.counters.samples += good
        self.counters.rejected += not good
        return 1

    def _angles(self, line: GloveLine) -> bool:
        """Take a sample as the angles of the hand; False where they are those of no hand."""
        regression = self._regression
        readings = regression.open.copy()
        readings[list(BEND)] = np.array(line.curl) / self._scale
        splay = np.array(line.splay) / self._scale
        if self._scale != 1.0:
            # Without a calibration, the middle of the range is taken for straight fingers.
            splay = 2.0 * splay - 1.0
        known = np.isfinite(splay)
        readings[np.array(SPLIT)[known]] = splay[known]
        normalised = regression.normalised(readings)
        bends = normalised[list(BEND)]
        if not (bends >= FAR[0]).all() or not (bends <= FAR[1]).all():
            return False
        joints = self._joint_bends(line, bends)
        if joints is None:
            return False
        np.clip(normalised, *FAR, out=normalised)
        plain = DexmoRegression(_ZEROS, _ONES, regression.slope, regression.offset)
        flexion, self._abduction = plain.angles(normalised)
        slope = np.stack([regression.slope[3 * f : 3 * f + 3, BEND[f]] for f in range(FINGER_COUNT)])
        self._flexion = flexion + np.where(np.isfinite(joints), (joints - bends[:, None]) * slope, 0.0)
        return True

    def _joint_bends(self, line: GloveLine, bends: NDArray[np.float64]) -> NDArray[np.float64] | None:
        """Normalised bend of our three joints where the glove sends them, else NaN; None where one is out of range."""
        bones = np.array(line.joints)
        if not np.isfinite(bones).any():
            return np.full((FINGER_COUNT, 3), np.nan)
        # Our first joint is the knuckle, which moves the proximal bone; gloves without a distal sensor number from the
        # first joint on.
        joints = np.where(np.isfinite(bones[:, 3:]), bones[:, 1:], bones[:, :3])
        low, high = self._regression.open[list(BEND), None], self._regression.closed[list(BEND), None]
        scaled: NDArray[np.float64] = (joints / self._scale - low) / (high - low)
        known = np.isfinite(scaled)
        if (scaled[known] < FAR[0]).any() or (scaled[known] > FAR[1]).any():
            return None
        return scaled

    def _describe(self, line: GloveLine) -> None:
        can = Capability.POSITION_LIMIT
        if any(map(math.isfinite, line.splay)):
            can |= Capability.SPLAY
        if any(math.isfinite(value) for bones in line.joints for value in bones):
            can |= Capability.JOINTS
        info = self.info
        self.info = GloveInfo(info.name, can, info.channels, info.hand, info.unit, info.doubtful, info.kept_free)


_ZEROS, _ONES = np.zeros(len(CHANNELS)), np.ones(len(CHANNELS))


def limits(command: FingerCommand) -> list[int]:
    """What the glove is told: 0 free to 1000 blocked fully extended, for each finger."""
    bend, stiffness = command.bend.tolist(), command.stiffness.tolist()
    if not all(map(math.isfinite, bend)) or not all(map(math.isfinite, stiffness)):
        return [0] * FINGER_COUNT
    return [
        round(FULL_LIMIT * (1.0 - min(max(b, 0.0), 1.0)) * min(max(k, 0.0) / FULL_STIFFNESS, 1.0))
        for b, k in zip(bend, stiffness)
    ]
