"""What several tests use in turn, made anew after one that failed: no test fails since the one before it did."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack
from typing import Generic, Self, TypeVar

import pytest

Shared = TypeVar("Shared")
FAILED = pytest.StashKey[bool]()
"""Of a test: whether a phase of it has failed so far (`conftest.pytest_runtest_makereport`)."""


class Renewed(Generic[Shared]):
    """Holds one thing at a time; a context that lets go of the last one.

    Args:
        make: Makes one, in a context.
        sound: Whether one can be used by another test.
    """

    def __init__(self, make: Callable[[], AbstractContextManager[Shared]], sound: Callable[[Shared], bool]) -> None:
        self._make, self._sound = make, sound
        self._stack = ExitStack()
        self._held: Shared | None = None

    def use(self, test: pytest.Item) -> Iterator[Shared]:
        """For a test, as a fixture yields it."""
        if self._held is None or not self._sound(self._held):
            self._drop()
            self._held = self._stack.enter_context(self._make())
        yield self._held
        if test.stash.get(FAILED, False):
            self._drop()

    def _drop(self) -> None:
        self._held = None
        self._stack.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self._drop()
