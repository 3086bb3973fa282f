"""Settings that people write, as TOML or JSON, read into declared structures; a fault is told in one line.

A `Settings` class declares a table: its fields are the keys, their types say what each may hold. The line names the
file, the path of the key, what is wrong and what would be right; entries of a list count from 1:
`suite.toml: scene[2].limits.stuck_ticks = -1; expected a number from 0 on, or false`.

`where` names the document, or a part of it, in messages; `error` is the class of what is raised.
"""

import re
import tomllib
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import msgspec
from msgspec import inspect

from hhsim.errors import InputError, UnknownNameError
from hhsim.system.input_file import read_input_text
from hhsim.system.media_kind import media_kind_of

MOST_BYTES = 1 << 24
"""Of a document that somebody has written."""
MOST = 1.7e308
"""Greatest number where only the least one is bounded: the library knows no infinite bound."""
MOST_SHOWN = 60
"""Letters of a wrong value that are shown."""
_PLACED = re.compile(r"(?P<what>.*?)(?: - at (?P<key>`key` in )?`\$(?P<path>[^`]*)`)?", re.DOTALL)
_STEP = re.compile(r"\.(\w+)|\[(\d+|\.\.\.)\]")

Content = TypeVar("Content")


class SettingsError(InputError, ValueError):
    """Values of a table that do not fit together; as a ValueError it is told with its place when a file is read."""


class Settings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Table of settings: its fields are the keys, their types say what each may hold."""

    def check(self) -> None:
        """Raise an InputError for what the types of the fields cannot say."""

    def __post_init__(self) -> None:
        """Check the values together.

        Raises:
            SettingsError: They do not fit.
        """
        try:
            self.check()
        except InputError as error:
            raise SettingsError(str(error)) from None


Version = Annotated[Literal[1], msgspec.Meta(description="1, which this hhsim reads")]


def a_list(example: str) -> msgspec.Meta:
    """Return what an `Annotated` list must be, not empty, with an example for messages."""
    return msgspec.Meta(min_length=1, description=f"a list such as {example}")


def one_of(names: Iterable[str]) -> msgspec.Meta:
    """Return what an `Annotated` text, or the key of a dictionary, must be one of."""
    known = tuple(names)
    return msgspec.Meta(pattern=f"^({'|'.join(map(re.escape, known))})$", extra={"names": known})


def between(least: float, most: float = MOST, unit: str = "") -> msgspec.Meta:
    """Return the range of a number, which goes beside its type in `Annotated`; `unit` is of both ends."""
    return msgspec.Meta(ge=least, le=most, extra={"unit": unit})


def read_settings(path: Path, kind: type[Content], what: str, error: type[InputError] = InputError) -> Content:
    """Return the content of a TOML file as what `kind` declares.

    Args:
        what: It should hold, such as "calibration".

    Raises:
        InputError: No such file, no permission, no TOML, or what `kind` does not allow.
    """
    return parse_settings(read_toml_text(path, what, error), kind, str(path), error)


def parse_settings(text: str, kind: type[Content], where: str, error: type[InputError] = InputError) -> Content:
    """Return the content of a TOML document as what `kind` declares.

    Raises:
        InputError: No TOML, or what `kind` does not allow.
    """
    return typed(parse_toml(text, where, error), kind, where, error)


def typed(document: Any, kind: type[Content], where: str, error: type[InputError] = InputError) -> Content:
    """Return a document of plain values as what `kind` declares.

    Raises:
        InputError: It holds what `kind` does not allow.
    """
    try:
        return msgspec.convert(document, kind)
    except msgspec.ValidationError as reason:
        raise error(f"{where}: {_fault(reason, document, kind)}") from None


def read_toml_text(path: Path, what: str, error: type[InputError] = InputError) -> str:
    """Return the text of a TOML file.

    Args:
        what: It should hold, such as "calibration".

    Raises:
        InputError: No such file, no permission, or no text.
    """
    try:
        return read_input_text(path, most=MOST_BYTES)
    except FileNotFoundError:
        raise error(f"{path}: no such file; expected a TOML {what}") from None
    except OSError as reason:
        raise error(f"{path}: cannot be read: {reason.strerror or reason}") from reason
    except UnicodeDecodeError:
        raise error(f"{path}: {media_kind_of(path) or 'not a text file'}; expected a TOML {what}") from None


def parse_toml(text: str, where: str, error: type[InputError] = InputError) -> dict[str, Any]:
    """Return the table of a TOML document.

    Raises:
        InputError: No TOML.
    """
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as reason:
        # A whole number of more digits than Python reads is a ValueError.
        raise error(f"{where}: not TOML: {reason}") from None


def _fault(reason: msgspec.ValidationError, document: Any, kind: Any) -> str:
    """Return what a document holds that `kind` does not allow: the place, what is wrong, what would be right."""
    own, text = reason.__cause__, str(reason)
    # The message of a check may look like a place itself.
    found = _PLACED.fullmatch(text.removeprefix(str(own)) if own else text)
    assert found
    value, expected, place, last = document, inspect.type_info(kind), "", ""
    for name, entry in _STEP.findall(found["path"] or ""):
        step: Any = name or (_guilty_key(document, value, kind, text) if entry == "..." else int(entry))
        value, expected = value[step], _inside(expected, step)
        place += f"[{step + 1}]" if isinstance(step, int) else f".{step}" if place else step
        last = step if isinstance(step, str) else last
    before = f"{place}: " if place else ""
    named = re.search("`(.*)`", found["what"], re.DOTALL)
    if own:
        return f"{before}{own}"
    if named and found["what"].startswith("Object contains unknown field"):
        return f"{before}{UnknownNameError('key', named[1], _keys(expected))}"
    if named and found["what"].startswith("Object missing required field"):
        return f"{before}{named[1]} is missing; expected {_described(_inside(expected, named[1]))}"
    if found["key"]:
        known = _words(_key_type(expected))
        return f"{before}{UnknownNameError('key', next(key for key in value if key not in known), known)}"
    words = _words(expected)
    if isinstance(value, str) and words:
        what = last.removesuffix("s") if place.endswith("]") else last
        return f"{place}: {UnknownNameError(what, value, words)}"
    shown = repr(value)
    shown = shown if len(shown) <= MOST_SHOWN else f"{shown[:MOST_SHOWN]}…"
    return f"{place and f'{place} = '}{shown}; expected {_described(expected)}"


def _guilty_key(document: Any, table: dict[str, Any], kind: Any, message: str) -> str:
    """Return the key of a table whose value alone brings the message, which leaves the key out."""
    content = dict(table)
    try:
        for key, value in content.items():
            table.clear()
            table[key] = value
            try:
                msgspec.convert(document, kind)
            except msgspec.ValidationError as error:
                if str(error) == message:
                    return key
    finally:
        table.clear()
        table.update(content)
    raise AssertionError(message)


def _choices(kind: Any) -> tuple[Any, ...]:
    """Return the types that a value may be of, null aside."""
    if isinstance(kind, inspect.Metadata):
        return _choices(kind.type)
    if isinstance(kind, inspect.UnionType):
        return tuple(one for part in kind.types for one in _choices(part) if not isinstance(one, inspect.NoneType))
    return (kind,)


def _inside(kind: Any, step: str | int) -> Any:
    """Return the type of what a key of a table, or an entry of a list, may hold."""
    for one in _choices(kind):
        if isinstance(one, inspect.StructType) and isinstance(step, str):
            return next((field.type for field in one.fields if field.encode_name == step), inspect.AnyType())
        if isinstance(one, inspect.DictType) and isinstance(step, str):
            return one.value_type
        if isinstance(one, inspect.ListType | inspect.VarTupleType) and isinstance(step, int):
            return one.item_type
        if isinstance(one, inspect.TupleType) and isinstance(step, int):
            return one.item_types[step]
    return inspect.AnyType()


def _keys(kind: Any) -> list[str]:
    return [field.encode_name for one in _choices(kind) if isinstance(one, inspect.StructType) for field in one.fields]


def _key_type(kind: Any) -> Any:
    return next(one.key_type for one in _choices(kind) if isinstance(one, inspect.DictType))


def _words(kind: Any) -> tuple[str, ...]:
    """Return the words that a value may be one of."""
    if isinstance(kind, inspect.Metadata):
        return (kind.extra or {}).get("names") or _words(kind.type)
    if isinstance(kind, inspect.UnionType):
        return tuple(word for part in kind.types for word in _words(part))
    values = kind.values if isinstance(kind, inspect.LiteralType) else ()
    return tuple(value for value in values if isinstance(value, str))


def _described(kind: Any) -> str:
    """Return what a value may be, in words."""
    if isinstance(kind, inspect.Metadata):
        stated = (kind.extra_json_schema or {}).get("description")
        unit = (kind.extra or {}).get("unit")
        return str(stated or f"{_described(kind.type)}{f' {unit}' if unit else ''}")
    if isinstance(kind, inspect.UnionType):
        parts = [one for one in kind.types if not isinstance(one, inspect.NoneType)]
        return ", or ".join(map(_described, parts))
    if isinstance(kind, inspect.IntType | inspect.FloatType):
        what = "a whole number" if isinstance(kind, inspect.IntType) else "a number"
        if kind.ge is None or kind.le is None:
            return what
        return f"{what} from {kind.ge:g} {'on' if kind.le == MOST else f'to {kind.le:g}'}"
    if isinstance(kind, inspect.LiteralType):
        return " or ".join("true" if v is True else "false" if v is False else f"{v}" for v in kind.values)
    if isinstance(kind, inspect.TupleType):
        return f"a list of {len(kind.item_types)}, each {_described(kind.item_types[0])}"
    if isinstance(kind, inspect.ListType | inspect.VarTupleType):
        return f"a list, each entry {_described(kind.item_type)}"
    if isinstance(kind, inspect.StrType):
        return "text in quotes"
    return "true or false" if isinstance(kind, inspect.BoolType) else "a table of keys"
