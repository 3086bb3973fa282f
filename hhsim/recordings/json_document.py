"""JSON of any maker, one document or one a line; values that are no numbers become NaN."""

import json
import re
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from typing import Any

import numpy as np

from hhsim.errors import TrajectoryError
from hhsim.motion.text_edit import NumberEdit

MOST = 1e20
"""Largest magnitude of a reading: nanoseconds since 1970 are less."""
SHOWN_KEYS = 6


_TOKEN = re.compile(r'"(?:[^"\\]|\\.)*"|-?[0-9]+(?:\.[0-9]+)?(?:[eE][-+]?[0-9]+)?', re.DOTALL)
"""String or number."""


def read_json(text: str, decode: Callable[[str], Any] = json.loads) -> Any:
    """Return the document, or a list of the documents of its lines; raise TrajectoryError with the place of a fault."""
    try:
        return decode(text)
    except (ValueError, RecursionError) as error:
        reason = str(error)
    documents = []
    # Other signs that end a line may stand in a string.
    lines = text.replace("\r", "\n").split("\n")
    for place, line in enumerate((line for line in lines if line.strip()), start=1):
        try:
            documents.append(decode(line))
        except (ValueError, RecursionError) as error:
            # Of a text whose first line alone is none, the whole is one document.
            where, reason = (f"line {place} is ", str(error)) if place > 1 else ("", reason)
            raise TrajectoryError(f"{where}not JSON: {reason[:120]}; was the file cut short?") from None
    return documents


def nested(value: Any) -> dict[str, Any]:
    """Return the object that an array of one JSON text holds; empty for anything else."""
    try:
        found = json.loads(str(value)) if np.ndim(value) == 0 and str(value)[:1] == "{" else {}
    except (ValueError, RecursionError):
        return {}
    return found if isinstance(found, dict) else {}


def number(value: Any) -> float:
    """Return a number as float, NaN for anything else."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return float("nan")
    # Beyond that it is damage, and what is computed from it overflows.
    return float(value) if -MOST <= value <= MOST else float("nan")


def vector(value: Any, names: str = "xyz") -> list[float]:
    """Return the numbers of a list as long as `names`, or of an object with these keys, NaN for missing ones."""
    if isinstance(value, dict):
        return [number(value.get(name)) for name in names]
    if not isinstance(value, list) or len(value) != len(names):
        return [float("nan")] * len(names)
    return [number(item) for item in value]


def objects(node: Any) -> Iterator[dict[str, Any]]:
    """Yield the objects of a list; none of anything else."""
    if isinstance(node, list):
        yield from (item for item in node if isinstance(item, dict))


class _Whole(int):
    """Whole number that knows its place among the numbers of a text."""

    place: int


class _Decimal(float):
    """Other number that knows its place among the numbers of a text."""

    place: int


class PlacedJson:
    """JSON `document`, as of `read_json`, whose numbers can be replaced in its text."""

    def __init__(self, text: str) -> None:
        self._spans = [found.span() for found in _TOKEN.finditer(text) if found[0][0] != '"']
        self._count = 0
        self.document = read_json(text.replace("\ufeff", " ", 1) if text.startswith("\ufeff") else text, self._decode)

    def edits(self, node: Any, values: Iterable[float], decimals: int, names: str = "xyz") -> Iterator[NumberEdit]:
        """Yield edits of the numbers of a list of the document, or of an object with these keys."""
        items = [node.get(name) for name in names] if isinstance(node, dict) else node
        for item, value in zip(items if isinstance(items, list) else [], values):
            if isinstance(item, _Whole | _Decimal):
                yield NumberEdit(*self._spans[item.place], float(value), decimals)

    def _decode(self, text: str) -> Any:
        before, whole, decimal = self._count, partial(self._placed, _Whole), partial(self._placed, _Decimal)
        try:
            return json.loads(text, parse_int=whole, parse_float=decimal)
        except (ValueError, RecursionError):
            self._count = before
            raise

    def _placed(self, kind: type[_Whole | _Decimal], word: str) -> _Whole | _Decimal:
        found = kind(word)
        found.place, self._count = self._count, self._count + 1
        return found


def keys_of(document: Any) -> str:
    """Describe the content of a document, for messages."""
    if isinstance(document, dict):
        names = [str(key)[:24] for key in document]
        more = ", …" if len(names) > SHOWN_KEYS else ""
        return f"an object with {', '.join(names[:SHOWN_KEYS]) or 'nothing'}{more}"
    if isinstance(document, list):
        return f"a list of {len(document)}, the first {keys_of(document[0])}" if document else "an empty list"
    return repr(document)[:40]
