"""A bridge of an OpenXR headset on the wire, from the published formats alone.

Sources: `XrHandJointEXT` (26 joints: palm 0, wrist 1, thumb 2 to 5, then five each of index, middle, ring and little
finger) and `XrHandJointLocationEXT` (pose: orientation x y z w, then position; radius [m]; a flag says whether the
position is valid) of the OpenXR specification 1.1; the table of the open packet in docs/live-protocols.md.
"""

import struct
from collections.abc import Sequence
from typing import NamedTuple


class Location(NamedTuple):
    """A joint as `XrHandJointLocationEXT` has it behind its flags."""

    orientation: Sequence[float]
    position: Sequence[float]
    radius: float


def hand_datagram(joints: Sequence[Location], session: int, seq: int, t_ns: int) -> bytes:
    """A packet of kind 5, put together field by field."""
    parts = [b"HHGL", bytes([1, 5]), (208).to_bytes(2, "little")]
    parts += [session.to_bytes(4, "little"), seq.to_bytes(4, "little"), t_ns.to_bytes(8, "little")]
    parts += [b"\xff\xff\xff\xff", b"\xff\xff\xff\xff"]
    for joint in joints:
        parts.append(struct.pack("<8f", *joint.orientation, *joint.position, joint.radius))
    return b"".join(parts)
