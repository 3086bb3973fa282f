"""The Dexmo messages as google.protobuf has them, built at run time: the referee of our own codec."""

from typing import Any

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

Proto = descriptor_pb2.FieldDescriptorProto
HAND = ("thumb_rotate", "thumb_split", "thumb_bend", "index_split", "index_bend", "middle_split", "middle_bend") + (
    *("ring_split", "ring_bend", "pinky_split", "pinky_bend"),
)
FINGERS = ("thumb", "index", "middle", "ring", "pinky")

TABLES: dict[str, list[tuple[int, str, str]]] = {
    # number, name, type; * before a message that is repeated. From the published format, not from our schemas;
    # without what of a command hhsim never uses.
    "Hand": [(number, name, "float") for number, name in enumerate(HAND, start=3)],
    "Device": [(2, "is_right", "bool"), (3, "battery_percent", "int32")],
    "FrameMessage": [(1, "id", "int32"), (2, "hand", "Hand"), (3, "device", "Device")],
    "Frame": [(1, "frame_len", "int32"), (2, "messages", "*FrameMessage")],
    "ImpedanceData": [(1, "stiffness", "float"), (2, "set_point", "float")],
    "Impedance": [*((k, f, "ImpedanceData") for k, f in enumerate(FINGERS, start=1)), (6, "has_index", "bool")],
    "Command": [(1, "id", "int32"), (2, "impedance", "*Impedance")],
}
SCALARS = {"float": Proto.TYPE_FLOAT, "int32": Proto.TYPE_INT32, "bool": Proto.TYPE_BOOL}


def message_classes() -> dict[str, Any]:
    """google.protobuf's class of each message by name."""
    file = descriptor_pb2.FileDescriptorProto(name="dexmo.proto", package="dexmo", syntax="proto3")
    for name, rows in TABLES.items():
        message = file.message_type.add(name=name)
        for number, field, kind in rows:
            repeated = kind.startswith("*")
            added = message.field.add(name=field, number=number)
            added.label = Proto.LABEL_REPEATED if repeated else Proto.LABEL_OPTIONAL
            if kind in SCALARS:
                added.type = SCALARS[kind]
            else:
                added.type, added.type_name = Proto.TYPE_MESSAGE, f".dexmo.{kind.lstrip('*')}"
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    return {name: message_factory.GetMessageClass(pool.FindMessageTypeByName(f"dexmo.{name}")) for name in TABLES}


def as_plain(message: Any, kind: str) -> dict[str, Any]:
    """A message of google.protobuf as our decoder gives one."""
    plain: dict[str, Any] = {}
    for _, field, type_ in TABLES[kind]:
        value = getattr(message, field)
        if type_ in SCALARS:
            plain[field] = value
        elif type_.startswith("*"):
            plain[field] = [as_plain(part, type_[1:]) for part in value]
        else:
            plain[field] = as_plain(value, type_) if message.HasField(field) else None
    return plain
