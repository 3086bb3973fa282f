"""Cases of which `make test` takes a few and `make soak` all: their promise is the same, only repeated."""

from collections.abc import Callable, Iterable, Mapping
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


def first_of_each(found_by: Mapping[Any, str]) -> list[Any]:
    """The planted faults, by what finds them, of which `make test` takes the first that each claim finds."""
    first = {claim: fault for fault, claim in reversed(list(found_by.items()))}
    return sampled(found_by, lambda _, fault: first[found_by[fault]] is fault)
