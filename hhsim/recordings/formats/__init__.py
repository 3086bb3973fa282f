"""Formats of recordings, one a module of the same name with its record `FORMAT`; there is no other list."""

import pkgutil


def format_names() -> list[str]:
    """Return the names of all formats in alphabetical order, without importing them."""
    return [module.name for module in pkgutil.iter_modules(__path__)]
