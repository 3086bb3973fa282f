"""Cases of which `make test` takes a few and `make soak` all: their promise is the same, only repeated."""

from collections.abc import Callable, Iterable
from typing import Any

import pytest


def sampled(cases: Iterable[Any], keep: Callable[[int, Any], bool]) -> list[Any]:
    """The cases for `pytest.mark.parametrize`; those that `keep(place, case)` does not name are marked soak."""
    return [
        case
        if keep(place, case)
        else pytest.param(*(case if isinstance(case, tuple) else (case,)), marks=pytest.mark.soak)
        for place, case in enumerate(cases)
    ]
