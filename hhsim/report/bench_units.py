"""Units in which people read the columns of a table of `hhsim bench`, which holds SI units."""

import math
from typing import NamedTuple

from hhsim.bench.table import BenchTable

SMALLER = {"s": ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs"), (1e-9, "ns")), "m": ((1.0, "m"), (1e-3, "mm"), (1e-6, "µm"))}
"""Of an SI unit those that may stand for it, with their size in it."""


class Unit(NamedTuple):
    """A unit: its name, "" for plain numbers, and its size in the column's own."""

    name: str
    factor: float


def shown_unit(found: BenchTable, name: str) -> Unit:
    """The unit of a column that keeps its largest number at 1 or more; the column's own where it has no other."""
    column = next(column for column in found.columns if column.name == name)
    own = column.unit
    sizes = [abs(float(row[name])) for row in found.rows if isinstance(row[name], int | float)]
    largest = max((size for size in sizes if math.isfinite(size)), default=0.0)
    for factor, smaller in SMALLER.get(own, ()):
        if largest >= factor:
            return Unit(smaller, factor)
    return Unit(own, 1.0)
