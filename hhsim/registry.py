"""Registries: packages whose modules declare one record each.

A record's name is its module's, with hyphens for underscores. Listing names imports no module. A module `registry` in
the package declares none.
"""

import pkgutil
from collections.abc import Iterator, Mapping
from importlib import import_module
from typing import Generic, TypeVar, cast

from hhsim.errors import UnknownNameError

T = TypeVar("T")


class Registry(Mapping[str, T], Generic[T]):
    """Records that the modules of a package declare, by name.

    Args:
        package: Dotted name of the package.
        attribute: Name of the record in each module.
        kind: Noun for a record, in the message for an unknown name.
        first: Names that are listed first; the others follow by the alphabet.
    """

    def __init__(self, package: str, attribute: str, kind: str, first: tuple[str, ...] = ()) -> None:
        self.package = package
        self.attribute = attribute
        self.kind = kind
        self.first = first

    def names(self) -> list[str]:
        """Return every name, without importing a record."""
        modules = {module.name for module in pkgutil.iter_modules(import_module(self.package).__path__)}
        found = {name.replace("_", "-") for name in modules - {"registry"}}
        return [name for name in self.first if name in found] + sorted(found - set(self.first))

    def __getitem__(self, name: str) -> T:
        """Import a record; raise UnknownNameError for an unknown name."""
        if name not in self.names():
            raise UnknownNameError(self.kind, name, self.names())
        return cast(T, getattr(import_module(f"{self.package}.{name.replace('-', '_')}"), self.attribute))

    def __iter__(self) -> Iterator[str]:
        return iter(self.names())

    def __len__(self) -> int:
        return len(self.names())

    def __contains__(self, name: object) -> bool:
        return name in self.names()
