"""Settings files, TOML or JSON, read into declared structures; a fault is one line.

A `Settings` class declares a table: its fields are the keys, their types say what each may hold. The line names the
file, the path of the key, what is wrong and what would be right; entries of a list count from 1:
`suite.toml: scene[2].limits.stuck_ticks = -1; expected a number from 0 on, or false`.

No field may be either a number or a text with bounds or a tuple of fixed length: msgspec 0.22 reads beyond its memory
there. `Annotated[tuple[T, ...], Meta(min_length=2, max_length=2)]` says the same; a test examines every class.

`where` names the document, or a part of it, in messages; `error` is the class of what is raised.
"""

import re
import tomllib
from collections.abc import Iterable
from pathlib import Path
from types import GenericAlias
from typing import Annotated, Any, Literal, TypeVar, get_type_hints

import msgspec
from msgspec import inspect

from hhsim.errors import InputError, UnknownNameError
from hhsim.system.input_file import media_kind_of, read_input_text

MOST_BYTES = 1 << 24
"""Size of the largest document [byte]."""
MOST = 1.7e308
"""Greatest number if only the least one is bounded: msgspec has no infinite bound."""
MOST_SHOWN = 60
"""Length of a wrong value in messages."""
MOST_PARTS = 64
"""Largest number of parts of a dotted key."""
_LONG_KEY = re.compile(rf"""(?<![\w-])(?:(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+){{{MOST_PARTS}}}""")
_PLACED = re.compile(r"(?P<what>.*?)(?: - at (?P<key>`key` in )?`\$(?P<path>[^`]*)`)?", re.DOTALL)
_STEP = re.compile(r"\.(\w+)|\[(\d+|\.\.\.)\]")

Content = TypeVar("Content")


class SettingsError(InputError, ValueError):
    """Values of a table that do not fit together; msgspec adds the place to a ValueError."""


class Settings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Table of settings: its fields are the keys, their types say what each may hold."""

    def check(self) -> None:
        """Raise InputError for what the types of the fields cannot express."""

    def __post_init__(self) -> None:
        try:
            self.check()
        except InputError as error:
            raise SettingsError(str(error)) from None


Positive = Annotated[float, msgspec.Meta(gt=0.0, le=MOST, description="a number above 0")]
Version = Annotated[Literal[1], msgspec.Meta(description="1, which this hhsim reads")]


def a_list(example: str) -> msgspec.Meta:
    """Return the constraint of an `Annotated` list that is not empty, with an example for messages."""
    return msgspec.Meta(min_length=1, description=f"a list such as {example}")


def one_of(names: Iterable[str]) -> msgspec.Meta:
    """Return the constraint of an `Annotated` text, or of the key of a dictionary, to these names."""
    known = tuple(names)
    return msgspec.Meta(pattern=rf"\A({'|'.join(map(re.escape, known))})\Z", extra={"names": known})


def between(least: float, most: float = MOST, unit: str = "") -> msgspec.Meta:
    """Return the constraint of an `Annotated` number to a range; `unit` is of both ends."""
    return msgspec.Meta(ge=least, le=most, extra={"unit": unit})


Count = Annotated[int, between(1, 1_000_000_000)]
Names = Annotated[tuple[str, ...], msgspec.Meta(min_length=1, description="at least one name")]


def read_settings(path: Path, kind: type[Content], what: str) -> Content:
    """Read a TOML file, such as a "calibration" (`what`), as the type `kind` declares it.

    InputError for no such file, no permission, no TOML, or a fault in the content.
    """
    return parse_settings(read_toml_text(path, what), kind, str(path))


def parse_settings(text: str, kind: type[Content], where: str, error: type[InputError] = InputError) -> Content:
    """Read a TOML document as the type `kind` declares it; raise InputError for no TOML or a fault."""
    return typed(parse_toml(text, where, error), kind, where, error)


def typed(document: Any, kind: type[Content], where: str, error: type[InputError] = InputError) -> Content:
    """Convert a document of plain values to the type `kind`; raise InputError for a fault."""
    try:
        return msgspec.convert(document, kind)
    except msgspec.ValidationError as reason:
        # A key or a text may hold a line break.
        fault = _fault(reason, document, kind).replace("\n", "\\n")
        raise error(f"{where}: {fault}") from None


def check_fields(settings: Any, error: type[InputError] = InputError) -> None:
    """Raise InputError, which begins with the field's name, for a dataclass with a value that its type refuses."""
    for name, kind in get_type_hints(type(settings), include_extras=True).items():
        value, table = {name: getattr(settings, name)}, GenericAlias(dict, (str, kind))
        try:
            msgspec.convert(value, table)
        except msgspec.ValidationError as reason:
            raise error(_fault(reason, value, table)) from None


def read_toml_text(path: Path, what: str, error: type[InputError] = InputError) -> str:
    """Return the text of a TOML file that should hold `what`; raise InputError if it cannot be read."""
    try:
        return read_input_text(path, most=MOST_BYTES)
    except FileNotFoundError:
        raise error(f"{path}: no such file; expected a TOML {what}") from None
    except OSError as reason:
        raise error(f"{path}: cannot be read: {reason.strerror or reason}") from reason
    except UnicodeDecodeError:
        raise error(f"{path}: {media_kind_of(path) or 'not a text file'}; expected a TOML {what}") from None


def parse_toml(text: str, where: str, error: type[InputError] = InputError) -> dict[str, Any]:
    """Return the table of a TOML document; raise InputError for no TOML."""
    # The time of the parser grows with the square of a key's parts.
    if found := _LONG_KEY.search(text):
        line = 1 + text.count("\n", 0, found.start())
        raise error(f"{where}: line {line}: a key of more than {MOST_PARTS} parts with dots between; expected a few")
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as reason:
        # A whole number of more digits than Python reads is a ValueError.
        raise error(f"{where}: not TOML: {reason}") from None


def _fault(reason: msgspec.ValidationError, document: Any, kind: Any) -> str:
    """Describe the first fault of a document: the place, what is wrong, what would be right."""
    own, text = reason.__cause__, str(reason)
    # The message of a check may look like a place itself.
    found = _PLACED.fullmatch(text.removeprefix(str(own)) if own else text)
    assert found
    what, value, expected, place, last = found["what"], document, inspect.type_info(kind), "", ""
    for name, entry in _STEP.findall(found["path"] or ""):
        step: Any = name or (_guilty_key(document, value, kind, text) if entry == "..." else int(entry))
        value, expected = value[step], _inside(expected, step)
        place += f"[{step + 1}]" if isinstance(step, int) else f".{step}" if place else step
        last = last.removesuffix("s") if isinstance(step, int) else step
    before, names = f"{place}: " if place else "", _names(expected)
    if own:
        return f"{before}{own}"
    if unknown := re.fullmatch("Object contains unknown field `(.*)`", what, re.DOTALL):
        return f"{before}{UnknownNameError('key', unknown[1], names)}"
    if missing := re.fullmatch("Object missing required field `(.*)`", what):
        return f"{before}{missing[1]} is missing; expected {_described(_inside(expected, missing[1]))}"
    if found["key"]:
        return f"{before}{UnknownNameError('key', next(key for key in value if key not in names), names)}"
    if isinstance(value, str) and names and what.startswith(("Invalid enum value", "Expected `str` matching regex")):
        return f"{before}{UnknownNameError(last, value, names)}"
    shown = repr(value)
    shown = shown if len(shown) <= MOST_SHOWN else f"{shown[:MOST_SHOWN]}…"
    return f"{place and f'{place} = '}{shown}; expected {_described(expected)}"


def _guilty_key(document: Any, table: dict[str, Any], kind: Any, message: str) -> str:
    """Return the key of a table whose value alone causes the message, which leaves the key out; others are dropped."""
    for key, value in tuple(table.items()):
        table.clear()
        table[key] = value
        try:
            msgspec.convert(document, kind)
        except msgspec.ValidationError as error:
            if str(error) == message:
                return key
    raise AssertionError(message)


def _inside(kind: Any, step: Any) -> Any:
    """Return the type of a value in a table, or of an entry of a list; None for a type without these."""
    match kind:
        case inspect.Metadata(type=inner):
            return _inside(inner, step)
        case inspect.UnionType(types=types):
            return next((found for one in types if (found := _inside(one, step)) is not None), None)
        case inspect.StructType(fields=fields) | inspect.DataclassType(fields=fields):
            return next((field.type for field in fields if field.encode_name == step), None)
        case inspect.TupleType(item_types=types):
            return types[step]
        case inspect.DictType(value_type=inner) | inspect.ListType(item_type=inner):
            return inner
        case inspect.VarTupleType(item_type=inner):
            return inner
    return None


def _names(kind: Any) -> tuple[str, ...]:
    """Return the words that a text may be, or the keys that a table may have."""
    match kind:
        case inspect.Metadata(type=inner, extra=extra):
            return (extra or {}).get("names") or _names(inner)
        case inspect.UnionType(types=types):
            return tuple(name for one in types for name in _names(one))
        case inspect.StructType(fields=fields):
            return tuple(field.encode_name for field in fields)
        case inspect.DictType(key_type=key):
            return _names(key)
        case inspect.LiteralType(values=values):
            return tuple(value for value in values if isinstance(value, str))
    return ()


def _described(kind: Any) -> str:
    """Describe the values of a type."""
    match kind:
        case inspect.Metadata(type=inner, extra_json_schema=schema, extra=extra):
            unit = (extra or {}).get("unit")
            return str((schema or {}).get("description") or f"{_described(inner)}{(unit and f' {unit}') or ''}")
        case inspect.UnionType(types=types):
            return ", or ".join(_described(one) for one in types if not isinstance(one, inspect.NoneType))
        case inspect.IntType(ge=least, le=most):
            return "a whole number" if least is None else f"a whole number from {least} to {most}"
        case inspect.FloatType(ge=least, le=most):
            if least is None or most is None:
                return "a number"
            return f"a number from {least:g} {'on' if most == MOST else f'to {most:g}'}"
        case inspect.LiteralType(values=values):
            return " or ".join(str(value).lower() for value in values)
        case inspect.TupleType(item_types=types):
            return f"a list of {len(types)}, each {_described(types[0])}"
        case inspect.VarTupleType(item_type=inner) | inspect.ListType(item_type=inner):
            return f"a list, each entry {_described(inner)}"
        case inspect.StrType():
            return "text in quotes"
    return "true or false" if isinstance(kind, inspect.BoolType) else "a table of keys"
