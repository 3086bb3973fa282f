"""Registries: packages whose modules declare one record each.

A record's name is its module's, with hyphens for underscores. Listing names imports no module. A module `registry` in
the package declares none. Installed packages may declare more as entry points of a group.
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
    """Records that the modules of a package declare, by name.

    Args:
        package: Dotted name of the package.
        attribute: Name of the record in each module.
        kind: Noun for a record, in the message for an unknown name.
        first: Names that are listed first; the others follow by the alphabet.
        group: Group of entry points with records of installed packages; the package's own names win. "" for none.
    """

    def __init__(self, package: str, attribute: str, kind: str, first: tuple[str, ...] = (), group: str = "") -> None:
        self.package = package
        self.attribute = attribute
        self.kind = kind
        self.first = first
        self.group = group

    def _own(self) -> set[str]:
        return {name.replace("_", "-") for name in _modules(tuple(import_module(self.package).__path__)) - {"registry"}}

    def names(self) -> list[str]:
        """Return every name, without importing a record."""
        found = self._own() | declared(self.group).keys()
        return [name for name in self.first if name in found] + sorted(found - set(self.first))

    def __getitem__(self, name: str) -> T:
        """Import a record; raise UnknownNameError for an unknown name, InputError for an entry point that fails."""
        if name not in self.names():
            raise UnknownNameError(self.kind, name, self.names())
        if name not in self._own():
            entry = declared(self.group)[name]
            try:
                return cast(T, entry.load())
            except Exception as error:
                said = " ".join(f"{type(error).__name__}: {error}".split())
                raise InputError(f"{self.kind} '{name}' cannot be imported from {entry.value}: {said}") from error
        return cast(T, getattr(import_module(f"{self.package}.{name.replace('-', '_')}"), self.attribute))

    def __iter__(self) -> Iterator[str]:
        return iter(self.names())

    def __len__(self) -> int:
        return len(self.names())

    def __contains__(self, name: object) -> bool:
        return name in self.names()
