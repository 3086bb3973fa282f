"""Driver of gloves with OpenGloves' letter format (LucidGloves and their kin), on a serial line or over TCP.

Such a glove takes a position limit without a stiffness: a servo blocks the finger's string. So a stiffness moves the
limit: from free at 0 to the wanted bend at `FULL_STIFFNESS` and above.

hhsim connects to the glove and not the reverse: the watchdog needs a connection of its own.
"""

import contextlib
import math
import time
from dataclasses import replace
from typing import TYPE_CHECKING, cast

import numpy as np

from hhsim.errors import InputError
from hhsim.live.device import FINGER_COUNT, Capability, DeviceError, FingerCommand, GloveInfo
from hhsim.live.devices.opengloves import OpenGlovesOptions
from hhsim.live.devices.registry import GloveConfig
from hhsim.live.drivers.stream_glove import MOST_MALFORMED, StreamGlove
from hhsim.live.link import opengloves_codec
from hhsim.live.link.serial import SerialLink
from hhsim.live.link.tcp import TcpLink

if TYPE_CHECKING:
    from hhsim.live.drivers.calibration import GloveCalibration

FULL_STIFFNESS = 0.25
BONES = ("metacarpal", "proximal", "middle", "distal")


class OpenGlovesGlove(StreamGlove):
    """One glove; InputError for an invalid baud rate or full scale.

    Its curls are the bends of `hhsim.recordings.dexmo_regression`; joints that it sends move on their own.
    """

    def __init__(self, config: GloveConfig) -> None:
        options = config.options
        assert isinstance(options, OpenGlovesOptions)
        if not (math.isfinite(options.full_scale) and options.full_scale > 0.0):
            raise InputError(f"full scale {options.full_scale}; expected the largest reading, such as 1023 or 4095")
        self._full_scale = options.full_scale
        self._configured = cast("GloveCalibration", config.calibration)
        self._hand = config.hand
        self._serial = bool(options.path)
        link: SerialLink | TcpLink
        if self._serial:
            name = f"opengloves at {options.path}, {options.baud} baud"
            link = SerialLink(options.path, options.baud, name)
        else:
            link = TcpLink(options.host, options.port, f"opengloves at {options.host}:{options.port}")
        super().__init__(link)

    def open(self, timeout: float = 5.0) -> None:
        """See `GloveDevice.open`; waits for a sample, a second or two where the board resets."""
        deadline = time.monotonic() + timeout
        self._connect(timeout)
        seen, bad = b"", 0
        while (left := deadline - time.monotonic()) > 0.0:
            self._link.wait(left)
            seen = (seen + self._receive())[:40]
            for line, _ in list(self._waiting)[bad:]:
                with contextlib.suppress(opengloves_codec.LineError):
                    if (found := opengloves_codec.parse_line(line)) is not None:
                        self._begin(found)
                        return
                bad += 1
        self._link.close()
        if seen:
            raise DeviceError(
                f"{self._link.name}: sends {seen!r}, no line of the letter format: is the baud rate right?"
            )
        raise DeviceError(f"{self._link.name}: sent nothing within {timeout:g} s: is this the glove's line?")

    def open_for_release(self, timeout: float = 5.0) -> None:
        """See `GloveDevice.open_for_release`."""
        self._connect(timeout)

    def send(self, command: FingerCommand) -> bool:
        """See `GloveDevice.send`; fingers of a command that is not finite are free."""
        return self._send(opengloves_codec.format_limits(limits(command)))

    def _release_message(self) -> bytes:
        return opengloves_codec.RELEASE

    def _begin(self, line: opengloves_codec.GloveLine) -> None:
        """Set `info` from the first sample."""
        from hhsim.hand.fingers import FINGERS

        calibration = self._configured
        if calibration.counts is not None:
            calibration = replace(calibration, regression=calibration.counts)
        self._calibration = calibration
        self._scale = 1.0 if calibration.counted else self._full_scale
        self._flexion, self._abduction = calibration.regression.angles(calibration.regression.open)
        can = Capability.POSITION_LIMIT
        if any(map(math.isfinite, line.splay)):
            can |= Capability.SPLAY
        if any(math.isfinite(value) for bones in line.joints for value in bones):
            can |= Capability.JOINTS
        self.info = GloveInfo(
            name=self._link.name,
            capabilities=can,
            channels=(
                *(f"{finger}_curl" for finger in FINGERS),
                *(f"{finger}_splay" for finger in FINGERS),
                *(f"{finger}_{bone}" for finger in FINGERS for bone in BONES),
            ),
            hand=self._hand,
            unit="count",
            doubtful=calibration.doubtful,
            kept_free=calibration.kept_free,
        )

    def _begin_stream(self) -> None:
        # TCP begins with a whole line, a serial line anywhere.
        self._stream, self._overlong = opengloves_codec.LineStream(whole=not self._serial), 0

    def _cut(self, data: bytes) -> list[bytes]:
        lines = self._stream.feed(data)
        overlong = self._stream.overlong - self._overlong
        self._overlong += overlong
        self.counters.frames += overlong
        self.counters.malformed += overlong
        return lines

    def _store(self, message: bytes, now: int, row: np.void) -> int:
        self.counters.frames += 1
        try:
            found = opengloves_codec.parse_line(message)
        except opengloves_codec.LineError:
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
        channels = (*found.curl, *found.splay, *(value for bones in found.joints for value in bones))
        self._write_sample(row, now, good, channels, (self._flexion, self._abduction))
        return 1

    def _angles(self, line: opengloves_codec.GloveLine) -> bool:
        """Set the hand's angles from a sample; False beyond a hand's range."""
        calibration, scale = self._calibration, self._scale
        curl, splay = np.array(line.curl) / scale, np.array(line.splay) / scale
        if scale != 1.0:
            # Without a calibration, mid-range is a straight finger.
            splay = 2.0 * splay - 1.0
        found = calibration.angles(calibration.readings(curl, splay))
        if found is None:
            return False
        flexion, abduction = found
        # Most gloves send no joints, and the arrays below cost more than the rest of a sample.
        if any(math.isfinite(value) for bones in line.joints for value in bones):
            bones = np.array(line.joints)
            # Our first joint moves the proximal bone; gloves without a distal sensor number from the first joint on.
            readings = np.where(np.isfinite(bones[:, 3:]), bones[:, 1:], bones[:, :3])
            joints = calibration.bends(readings / scale)
            if joints is None:
                return False
            low, high = calibration.bend_ends()
            bends = (curl - low) / (high - low)
            slope, _ = calibration.bend_lines()
            flexion = flexion + np.where(np.isfinite(joints), (joints - bends[:, None]) * slope, 0.0)
        self._flexion, self._abduction = flexion, abduction
        return True


def limits(command: FingerCommand) -> list[int]:
    """Compute the limit of each finger, 0 free to 1000 blocked fully extended."""
    bend, stiffness = command.bend.tolist(), command.stiffness.tolist()
    if not all(map(math.isfinite, bend)) or not all(map(math.isfinite, stiffness)):
        return [0] * FINGER_COUNT
    return [
        round(opengloves_codec.FULL_LIMIT * (1.0 - min(max(b, 0.0), 1.0)) * min(max(k, 0.0) / FULL_STIFFNESS, 1.0))
        for b, k in zip(bend, stiffness)
    ]
