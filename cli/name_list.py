"""Options that take names or whole numbers, written with commas."""

import click


def read_names(context: click.Context, parameter: click.Parameter, value: str | None) -> tuple[str, ...] | None:
    """Callback of an option such as --object bunny,cube: the names, each once, in their order; None if not given."""
    if value is None:
        return None
    names = [part.strip() for part in value.split(",")]
    if not all(names):
        raise click.BadParameter(f"'{value}', expected names with commas between", context, parameter)
    return tuple(dict.fromkeys(names))


def read_counts(context: click.Context, parameter: click.Parameter, value: str | None) -> tuple[int, ...] | None:
    """Callback of an option such as --level 3,4: whole numbers from 1 on, each once; None if not given."""
    if value is None:
        return None
    parts = [part.strip() for part in value.split(",")]
    if not all(part.isdecimal() and int(part) >= 1 for part in parts):
        raise click.BadParameter(f"'{value}', expected whole numbers from 1 on with commas between", context, parameter)
    return tuple(dict.fromkeys(int(part) for part in parts))
