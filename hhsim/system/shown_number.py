"""Numbers as people read them in tables, on pages and in terminals."""

import math


def number(value: float | None, digits: int, scale: float = 1.0, missing: str = "—") -> str:
    """Return a figure with its digits behind the point, times a scale; `missing` stands for None and NaN."""
    if value is None or math.isnan(value):
        return missing
    # Rounded first: what rounds to nothing has no sign.
    return f"{round(scale * float(value), digits) + 0.0:,.{digits}f}"
