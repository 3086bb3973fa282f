"""Formats of recordings, one a module of the same name, each with its record `FORMAT`.

A module that is put here is a format that `hhsim import` reads: `hhsim.recordings.registry` looks for no other list.
"""

import pkgutil


def format_names() -> list[str]:
    """Names of all formats in alphabetical order, found without importing them."""
    return [module.name for module in pkgutil.iter_modules(__path__)]
