"""JSON of any maker, one document or one a line; numbers that are none are missing."""

import json
from collections.abc import Iterator
from typing import Any

from hhsim.errors import TrajectoryError
from hhsim.recordings.recording import MOST_SAMPLES

MOST = 1e20
"""Numbers beyond this are no readings: not even nanoseconds since 1970."""
SHOWN_KEYS = 6


def read_json(text: str) -> Any:
    """The document, or a list of the documents of its lines.

    Raises:
        TrajectoryError: Neither; the message says where.
    """
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        lines = [line for line in text.splitlines() if line.strip()]
        if 1 < len(lines) < MOST_SAMPLES and lines[0].lstrip().startswith("{") and _is_object(lines[0]):
            return [_line(number, line) for number, line in enumerate(lines, start=1)]
        raise TrajectoryError(f"not JSON: {str(error)[:120]}; was the file cut short?") from None


def number(value: Any) -> float:
    """A number, NaN for anything else."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return float("nan")
    # Beyond that it is damage, and what is computed from it overflows.
    return float(value) if -MOST <= value <= MOST else float("nan")


def vector(value: Any, names: str = "xyz") -> list[float]:
    """Numbers of a list of so many, or of an object with these names; NaN where there are none."""
    if isinstance(value, dict):
        return [number(value.get(name)) for name in names]
    if not isinstance(value, list) or len(value) != len(names):
        return [float("nan")] * len(names)
    return [number(item) for item in value]


def objects(node: Any) -> Iterator[dict[str, Any]]:
    """The objects of a list; none of anything else."""
    if isinstance(node, list):
        yield from (item for item in node if isinstance(item, dict))


def keys_of(document: Any) -> str:
    """What a document holds, for messages."""
    if isinstance(document, dict):
        names = [str(key)[:24] for key in document]
        return f"an object with {', '.join(names[:SHOWN_KEYS]) or 'nothing'}" + (
            ", …" if len(names) > SHOWN_KEYS else ""
        )
    if isinstance(document, list):
        return f"a list of {len(document)}, the first {keys_of(document[0])}" if document else "an empty list"
    return repr(document)[:40]


def _is_object(line: str) -> bool:
    try:
        return isinstance(json.loads(line), dict)
    except (ValueError, RecursionError):
        return False


def _line(place: int, line: str) -> Any:
    try:
        return json.loads(line)
    except (ValueError, RecursionError) as error:
        raise TrajectoryError(f"line {place} is not JSON: {str(error)[:120]}") from None
