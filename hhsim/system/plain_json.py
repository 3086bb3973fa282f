"""Values for JSON documents, which have no NaN and no infinity."""

import math
from collections.abc import Callable, Mapping
from typing import Any


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def plain_json(value: Any, number: Callable[[float], Any] = _finite) -> Any:
    """Return a value with lists for tuples, text keys and `number` of each float: null for NaN and infinity."""
    if isinstance(value, Mapping):
        return {str(key): plain_json(item, number) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain_json(item, number) for item in value]
    return number(value) if isinstance(value, float) else value
