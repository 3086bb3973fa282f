"""Options that take several names or whole numbers: with commas between, or the option given again."""

from collections.abc import Callable, Sequence
from typing import Any

import click

Decorator = Callable[[Any], Any]


def names(option: str, parameter: str, help: str, **more: Any) -> Decorator:
    """An option such as --object bunny,cube: a tuple of the names, each once, in their order; None if not given."""
    return click.option(option, parameter, callback=_read_names, multiple=True, metavar="NAMES", help=help, **more)


def counts(option: str, parameter: str, help: str) -> Decorator:
    """An option such as --level 3,4: a tuple of whole numbers from 1 on, each once; None if not given."""
    return click.option(option, parameter, callback=_read_counts, multiple=True, metavar="NUMBERS", help=help)


def _read_names(context: click.Context, parameter: click.Parameter, value: Sequence[str]) -> tuple[str, ...] | None:
    parts = _parts(value)
    if not all(parts):
        raise click.BadParameter(f"'{','.join(value)}', expected names with commas between", context, parameter)
    return tuple(dict.fromkeys(parts)) or None


def _read_counts(context: click.Context, parameter: click.Parameter, value: Sequence[str]) -> tuple[int, ...] | None:
    parts = _parts(value)
    if not all(part.isdecimal() and int(part) >= 1 for part in parts):
        wanted = "expected whole numbers from 1 on with commas between"
        raise click.BadParameter(f"'{','.join(value)}', {wanted}", context, parameter)
    return tuple(dict.fromkeys(int(part) for part in parts)) or None


def _parts(value: Sequence[str]) -> list[str]:
    return [part.strip() for given in value for part in given.split(",")]
