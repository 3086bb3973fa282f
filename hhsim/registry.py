"""Registries of records by name, most of which the modules of a package declare, one each.

Such a record's name is its module's, with hyphens for underscores. Listing names imports no module. A module `registry`
in the package declares none. Installed packages may declare more as entry points of a group.
"""

import pkgutil
from collections.abc import Iterator, Mapping
from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING, Generic, TypeVar, cast

from hhsim.errors import InputError, UnknownNameError

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

T = TypeVar("T")


@cache
def declared(group: str) -> "dict[str, EntryPoint]":
    """Return the entry points of a group that installed packages declare, by name."""
    from importlib.metadata import entry_points

    return {entry.name: entry for entry in entry_points(group=group)} if group else {}


@cache
def _modules(folders: tuple[str, ...]) -> frozenset[str]:
    return frozenset(module.name for module in pkgutil.iter_modules(folders))


class Registry(Mapping[str, T], Generic[T]):
    """Records by name, those of installed packages included.

    Args:
        own: Dotted name of a package whose modules declare one each, or the records by name.
        attribute: Name of the record in each module.
        kind: Noun for a record, in the message for an unknown name.
        first: Names that are listed first; the others follow by the alphabet.
        group: Group of entry points with records of installed packages; hhsim's own names win. "" for none.
    """

    def __init__(
        self,
        own: str | Mapping[str, T],
        attribute: str = "",
        kind: str = "record",
        first: tuple[str, ...] = (),
        group: str = "",
    ) -> None:
        self._own, self._attribute, self._first = own, attribute, first
        self.kind, self.group = kind, group

    def _own_names(self) -> set[str]:
        if not isinstance(self._own, str):
            return set(self._own)
        return {name.replace("_", "-") for name in _modules(tuple(import_module(self._own).__path__)) - {"registry"}}

    def names(self) -> list[str]:
        """Return every name, without importing a record."""
        found = self._own_names() | declared(self.group).keys()
        return [name for name in self._first if name in found] + sorted(found - set(self._first))

    def __getitem__(self, name: str) -> T:
        """Import a record; raise UnknownNameError for an unknown name, InputError for an entry point that fails."""
        if name not in self.names():
            raise UnknownNameError(self.kind, name, self.names())
        if name in self._own_names():
            if not isinstance(self._own, str):
                return self._own[name]
            return cast(T, getattr(import_module(f"{self._own}.{name.replace('-', '_')}"), self._attribute))
        entry = declared(self.group)[name]
        try:
            return cast(T, entry.load())
        except Exception as error:
            said = " ".join(f"{type(error).__name__}: {error}".split())
            raise InputError(f"{self.kind} '{name}' cannot be imported from {entry.value}: {said}") from error

    def __iter__(self) -> Iterator[str]:
        return iter(self.names())

    def __len__(self) -> int:
        return len(self.names())

    def __contains__(self, name: object) -> bool:
        return name in self.names()
