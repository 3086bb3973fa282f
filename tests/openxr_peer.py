"""A bridge of an OpenXR headset on the wire, and a MANUS plugin's end, from the published formats alone.

Sources: `XrHandJointEXT` (26 joints: palm 0, wrist 1, thumb 2 to 5, then five each of index, middle, ring and little
finger) and `XrHandJointLocationEXT` (pose: orientation x y z w, then position; radius [m]; a flag says whether the
position is valid) of the OpenXR specification 1.1; the table of the open packet in docs/live-protocols.md; FlatBuffers'
internals, and `haptic_command.fbs` of Isaac Teleop: table HapticCommand {endpoint: string (id 0); values: [float]
(id 1)}.
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


class Haptic(NamedTuple):
    """What the plugin reads of a payload."""

    endpoint: str
    values: list[float]


def read_haptic(data: bytes) -> Haptic:
    """Read a HapticCommand as any reader of FlatBuffers does: by its offsets, whatever the order of the parts.

    Every part is where it is aligned, ends within the data, and the string ends in a zero.
    """

    def number(form: str, at: int) -> int:
        size = struct.calcsize(form)
        assert at % size == 0 and 0 <= at <= len(data) - size, f"{form} at {at} of {len(data)}"
        return int(struct.unpack_from("<" + form, data, at)[0])

    table = number("I", 0)
    vtable = table - number("i", table)
    size, inline = number("H", vtable), number("H", vtable + 2)
    assert size >= 8 and inline >= 12

    def field(number_of_field: int) -> int:
        place = table + number("H", vtable + 4 + 2 * number_of_field)
        assert place > table, "the field is not there"
        return place + number("I", place)

    text, vector = field(0), field(1)
    length, count = number("I", text), number("I", vector)
    assert data[text + 4 + length] == 0
    values = [struct.unpack_from("<f", data, vector + 4 + 4 * k)[0] for k in range(count)]
    return Haptic(data[text + 4 : text + 4 + length].decode(), values)
