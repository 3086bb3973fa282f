"""An option that takes a fixed count of numbers, written with commas."""

import math
from typing import Any

import click


class NumberList(click.ParamType):
    """Numbers that are at least 0, such as 1000,5,0.5.

    Args:
        meanings: what each number is, with its unit.
        positive: refuse 0 too.
    """

    name = "numbers"

    def __init__(self, *meanings: str, positive: bool = False) -> None:
        self.meanings = meanings
        self.positive = positive

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[float, ...]:
        """Read the numbers."""
        if isinstance(value, tuple):
            return value
        try:
            numbers = tuple(float(part) for part in str(value).split(","))
        except ValueError:
            numbers = ()
        right = all(
            math.isfinite(number) and (number > 0.0 or (number == 0.0 and not self.positive)) for number in numbers
        )
        if len(numbers) != len(self.meanings) or not right:
            sign = "positive" if self.positive else "not negative"
            wanted = f"{len(self.meanings)} numbers, {sign}, with commas between them"
            self.fail(f"'{value}' is not {', '.join(self.meanings)}: {wanted}", param, ctx)
        return numbers
