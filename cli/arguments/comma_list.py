"""Options that take several names or numbers with commas between."""

from collections.abc import Callable, Sequence

import click

DIGITS = 20
"""Digits from which on a whole number is refused unread."""
Reader = Callable[[click.Context, click.Parameter, str | None], tuple[float, ...] | None]


def number_list(*meanings: str, ranges: Sequence[tuple[float, float]]) -> Reader:
    """Return the callback of an option such as --stiffness 1000,5,0.5: numbers by meanings with unit, and ranges."""

    def read(context: click.Context, parameter: click.Parameter, value: str | None) -> tuple[float, ...] | None:
        if value is None:
            return None
        numbers = _numbers(value)
        in_range = all(least <= number <= most for number, (least, most) in zip(numbers, ranges))
        if len(numbers) != len(meanings) or not in_range:
            each = [f"{meaning} {least:g} to {most:g}" for meaning, (least, most) in zip(meanings, ranges)]
            wanted = f"{len(meanings)} numbers with commas between: {', '.join(each)}"
            raise click.BadParameter(f"'{value}', expected {wanted}", context, parameter)
        return numbers

    return read


def one_or_five(context: click.Context, parameter: click.Parameter, value: str | None) -> tuple[float, ...] | None:
    """Read one number from 0 to 1 for all fingers, or five: the callback of an option."""
    if value is None:
        return None
    numbers = _numbers(value)
    numbers = numbers * 5 if len(numbers) == 1 else numbers
    if len(numbers) != 5 or not all(0.0 <= number <= 1.0 for number in numbers):
        raise click.BadParameter(f"'{value}', expected 0 (free) to 1, or five of that", context, parameter)
    return numbers


def _numbers(value: str) -> tuple[float, ...]:
    """Return the numbers; none where one of them is no number."""
    try:
        return tuple(float(part) for part in value.split(","))
    except ValueError:
        return ()


def read_names(context: click.Context, parameter: click.Parameter, value: Sequence[str]) -> tuple[str, ...] | None:
    """Read names with commas between: the callback of an option that may be given again."""
    parts = _parts(value)
    if not all(parts):
        raise click.BadParameter(f"'{','.join(value)}', expected names with commas between", context, parameter)
    return tuple(dict.fromkeys(parts)) or None


def read_counts(
    least: int, most: int, context: click.Context, parameter: click.Parameter, value: Sequence[str]
) -> tuple[int, ...] | None:
    """Read whole numbers with commas between, as `read_names`."""
    parts = _parts(value)
    if not all(part.isdecimal() and len(part) < DIGITS and least <= int(part) <= most for part in parts):
        wanted = f"expected whole numbers from {least} to {most} with commas between"
        raise click.BadParameter(f"'{','.join(value)}', {wanted}", context, parameter)
    return tuple(dict.fromkeys(int(part) for part in parts)) or None


def _parts(value: Sequence[str]) -> list[str]:
    return [part.strip() for given in value for part in given.split(",")]
