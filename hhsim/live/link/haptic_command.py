"""`HapticCommand`, what the glove plugins of NVIDIA's Isaac Teleop (Isaac Capture) take: an endpoint and its powers.

A FlatBuffers table of two fields, `endpoint` (string, id 0) and `values` (vector of float32, id 1): facts of
`src/core/schema/fbs/haptic_command.fbs` and of the plugin `src/plugins/manus` of github.com/NVIDIA/IsaacTeleop
(Apache-2.0), and of FlatBuffers' internals. Bytes are those of FlatBuffers' own builder.

| bytes | what, little-endian |
|---|---|
| 0 | uint32, where the table is: 12 |
| 4 | its vtable, uint16: own size 8, table's size 12, endpoint at 4 in the table, values at 8 |
| 12 | the table: int32 back to the vtable 8; uint32 on to the endpoint 32; uint32 on to the values 4 |
| 24 | the values: uint32 5, then five float32, thumb to little finger, 0 to 1 |
| 48 | the endpoint: uint32 length, its letters, zeros to a multiple of four, one at least |
"""

import struct
from collections.abc import Sequence

_BEFORE = struct.Struct("<I4Hi3I")
_FIVE = struct.Struct("<5f")
_HEAD = _BEFORE.pack(12, 8, 12, 4, 8, 8, 32, 4, 5)
_TAIL = {name: struct.pack("<I8s", len(name), name.encode()) for name in ("left", "right")}


def encode_haptic_command(endpoint: str, powers: Sequence[float]) -> bytes:
    """The bytes of a command.

    Args:
        endpoint: "left" or "right".
        powers: Of the five motors, 0 to 1, thumb to little finger.
    """
    return _HEAD + _FIVE.pack(*powers) + _TAIL[endpoint]
