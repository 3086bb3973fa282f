"""An option that takes a fixed count of numbers, written with commas."""

import math
from collections.abc import Callable

import click

Reader = Callable[[click.Context, click.Parameter, str | None], tuple[float, ...] | None]


def number_list(*meanings: str, positive: bool = False, signed: bool = False) -> Reader:
    """Make the callback of an option such as --stiffness 1000,5,0.5.

    Args:
        meanings: What each number is, with its unit.
        positive: Refuse 0 too.
        signed: Take negative numbers, which are refused otherwise.
    """

    def read(context: click.Context, parameter: click.Parameter, value: str | None) -> tuple[float, ...] | None:
        if value is None:
            return None
        try:
            numbers = tuple(float(part) for part in value.split(","))
        except ValueError:
            numbers = ()
        in_range = all(
            math.isfinite(number) and (signed or number > 0.0 or (number == 0.0 and not positive)) for number in numbers
        )
        if len(numbers) != len(meanings) or not in_range:
            sign = "" if signed else " positive," if positive else " none of them negative,"
            wanted = f"{len(meanings)} numbers,{sign} with commas between: {', '.join(meanings)}"
            raise click.BadParameter(f"'{value}', expected {wanted}", context, parameter)
        return numbers

    return read
