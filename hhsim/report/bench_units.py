"""Units in which people read the columns of a table of `hhsim bench`, which holds SI units."""

import math

from hhsim.bench.table import BenchTable
from hhsim.table.table import unit_size

SMALLER = {"s": ("s", "ms", "µs", "ns"), "m": ("m", "mm", "µm")}
"""Units that may stand for an SI unit."""


def shown_unit(found: BenchTable, name: str) -> str:
    """Return the unit of a column that keeps its largest number at 1 or more; its own where there is none."""
    own = next(column.unit for column in found.columns if column.name == name)
    sizes = [abs(float(row[name])) for row in found.rows if isinstance(row[name], int | float)]
    largest = max((size for size in sizes if math.isfinite(size)), default=0.0)
    return next((unit for unit in SMALLER.get(own, ()) if largest >= unit_size(unit)), own)
