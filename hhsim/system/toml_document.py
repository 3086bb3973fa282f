"""TOML documents that people write: what is wrong in one is said in a line, with where it is and what would be right.

`where` names the document, or a part of it, in messages; `error` is the class of what is raised.
"""

import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from hhsim.errors import InputError, UnknownNameError
from hhsim.system.input_file import read_input_text
from hhsim.system.media_kind import media_kind_of

MOST_BYTES = 1 << 24
"""Of a document that somebody has written."""


def read_toml_text(path: Path, what: str, error: type[InputError] = InputError) -> str:
    """The text of a TOML file.

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
    """The table of a TOML document.

    Raises:
        InputError: No TOML.
    """
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as reason:
        # Of the first kind is also a whole number of more digits than Python reads.
        raise error(f"{where}: not TOML: {reason}") from None


def check_keys(
    where: str, table: Mapping[str, Any], known: Iterable[str], error: type[InputError] = InputError
) -> None:
    """Refuse a key that is none of the known ones; the message lists the near ones.

    Raises:
        InputError: Such a key.
    """
    names = tuple(known)
    for key in table:
        if key not in names:
            raise error(f"{where}: {UnknownNameError('key', key, names)}")


def checked_table(
    where: str, key: str, value: Any, known: Iterable[str] | None = None, error: type[InputError] = InputError
) -> dict[str, Any]:
    """A value that is a table, with no other keys than the known ones where these are given.

    Raises:
        InputError: No table, or another key.
    """
    if not isinstance(value, dict):
        raise error(f"{where}: {key} = {value!r}; expected a table")
    if known is not None:
        check_keys(f"{where}: {key}", value, known, error)
    return value


def checked_number(
    where: str, key: str, value: Any, low: float, high: float, error: type[InputError] = InputError
) -> float:
    """A value that is a number from `low` to `high`.

    Raises:
        InputError: It is none; truths are no numbers.
    """
    if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
        raise error(f"{where}: {key} = {value!r}; expected a number from {low:g} to {high:g}")
    return float(value)


def checked_text(where: str, key: str, value: Any, error: type[InputError] = InputError) -> str:
    """A value that is a text; it may be empty.

    Raises:
        InputError: It is none.
    """
    if not isinstance(value, str):
        raise error(f"{where}: {key} = {value!r}; expected text in quotes")
    return value
