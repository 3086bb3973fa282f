"""A hand that a headset tracks: OpenXR's 26 joints, by a bridge that sends them as open packets of the kind `HAND`.

Order, frames and radii of the joints are those of XR_EXT_hand_tracking (OpenXR 1.1, `XrHandJointEXT` and
`XrHandJointLocationEXT`). As in recordings (`hhsim.recordings.joint_positions`) our palm is laid into wrist and
knuckles, and our bones are brought nearest to those between the joints: what a runtime says of their orientations and
radii is not used, since rigs differ in it.
"""

from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hhsim.live.device import Capability, GloveInfo, PalmReading
from hhsim.live.devices.openxr import HandOptions
from hhsim.live.devices.registry import GloveConfig
from hhsim.live.drivers.packet_glove import PacketGlove
from hhsim.live.link.udp_codec import Kind, Packet
from hhsim.motion.trajectory import HandSide
from hhsim.recordings.finger_ik import finger_angles, palm_from_knuckles, palm_origin
from hhsim.recordings.frames import in_palm, to_our_world
from hhsim.recordings.joint_names import KEYPOINTS, OPENXR_JOINTS
from hhsim.recordings.joint_positions import HAND_LENGTHS

Array = NDArray[np.float64]

FARTHEST = 100.0
"""A joint beyond [m] was sent in another unit."""
NUMBERS = 8
"""Of a joint: its orientation (x, y, z, w), its position, its radius."""
PLACE = slice(4, 7)
USED = [OPENXR_JOINTS.index(name) for name in KEYPOINTS]
CHANNELS = tuple(f"{name}_{axis}" for name in KEYPOINTS for axis in "xyz")


class _Seen(NamedTuple):
    """A sample as our hand; nothing of it may be used where `good` is false."""

    good: bool
    flexion: Array
    abduction: Array
    position: Array
    orientation: Array


class OpenXrHand(PacketGlove):
    """A tracked hand, which is told nothing.

    Args:
        config: With `HandOptions`.
    """

    SAMPLES = (Kind.HAND,)
    NAME = "openxr hand"
    TAKES = Capability.NONE

    def __init__(self, config: GloveConfig) -> None:
        """Nothing is opened yet."""
        options = config.options
        assert isinstance(options, HandOptions)
        super().__init__(options.host, options.port, self.NAME)
        self._hand = config.hand
        self._seen: deque[_Seen] = deque()
        self.palm: PalmReading = PalmReading()

    def _look_ahead(self, packets: Sequence[Packet]) -> None:
        # Together: one hand costs as much as a tick's worth of them.
        numbers = np.stack([packet.values for packet in packets]).astype(np.float64)
        self._seen.extend(hands(numbers, self._hand))

    def _take(self, values: Array, now_ns: int) -> bool:
        seen = self._seen.popleft()
        if seen.good:
            self._flexion, self._abduction = seen.flexion, seen.abduction
            self.palm.position, self.palm.orientation, self.palm.came_ns = seen.position, seen.orientation, now_ns
        return seen.good

    def _channels(self, values: Array) -> Array:
        return np.asarray(values.reshape(-1, NUMBERS)[USED, PLACE].ravel())

    def _describe(self, first: Packet) -> GloveInfo:
        can = Capability.JOINTS | Capability.SPLAY | Capability.STAMPS | Capability.PALM | self.TAKES
        if first.battery >= 0:
            can |= Capability.BATTERY
        return GloveInfo(self._name, can, CHANNELS, hand=self._hand, unit="m")


def hands(numbers: Array, side: HandSide) -> list[_Seen]:
    """What our hand makes of tracked joints.

    Args:
        numbers: Of the packets, shape (T, 208).
        side: "right" or "left".

    Returns:
        For each packet the angles [rad], and the palm in a world with z up.
    """
    points = numbers.reshape(len(numbers), -1, NUMBERS)[:, USED, PLACE]
    with np.errstate(all="ignore"):
        points = np.where(np.abs(points) <= FARTHEST, points, np.nan)
        wrist, fingers = points[:, 0], points[:, 1:].reshape(-1, 5, 4, 3)
        bones = np.diff(fingers, axis=2)
        orientation = palm_from_knuckles(fingers[:, 1:, 0], wrist, side)
        flexion, abduction, _ = finger_angles(in_palm(bones, orientation), side)
        position = palm_origin(fingers[:, 1:, 0], orientation, side)
        position, orientation = to_our_world(position, orientation, "y")
        middle = np.linalg.norm(fingers[:, 2, 0] - wrist, axis=1) + np.linalg.norm(bones[:, 2], axis=2).sum(axis=1)
    low, high = HAND_LENGTHS
    # NaN compares false.
    good = (middle >= low) & (middle <= high)
    for part in (flexion, abduction, position, orientation):
        good &= np.isfinite(part.reshape(len(part), -1)).all(axis=1)
    return [_Seen(bool(good[t]), flexion[t], abduction[t], position[t], orientation[t]) for t in range(len(good))]
