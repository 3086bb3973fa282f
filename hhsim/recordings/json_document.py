"""JSON of any maker, one document or one a line; values that are no numbers become NaN."""

import json
from collections.abc import Iterator
from typing import Any

from hhsim.errors import TrajectoryError

MOST = 1e20
"""Largest magnitude of a reading: nanoseconds since 1970 are less."""
SHOWN_KEYS = 6


def read_json(text: str) -> Any:
    """Return the document, or a list of the documents of its lines; raise TrajectoryError with the place of a fault."""
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        reason = str(error)
    documents = []
    for place, line in enumerate((line for line in text.splitlines() if line.strip()), start=1):
        try:
            documents.append(json.loads(line))
        except (ValueError, RecursionError) as error:
            # Of a text whose first line alone is none, the whole is one document.
            where, reason = (f"line {place} is ", str(error)) if place > 1 else ("", reason)
            raise TrajectoryError(f"{where}not JSON: {reason[:120]}; was the file cut short?") from None
    return documents


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


def keys_of(document: Any) -> str:
    """Describe the content of a document, for messages."""
    if isinstance(document, dict):
        names = [str(key)[:24] for key in document]
        return f"an object with {', '.join(names[:SHOWN_KEYS]) or 'nothing'}" + (
            ", …" if len(names) > SHOWN_KEYS else ""
        )
    if isinstance(document, list):
        return f"a list of {len(document)}, the first {keys_of(document[0])}" if document else "an empty list"
    return repr(document)[:40]
