"""Lengths that are typed with their unit."""

import re

import click

LEAST_ERROR = 1e-6
"""Least --max-error [m]."""
METRES = {"": 1e-3, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "m": 1.0}


def read_length(context: click.Context, parameter: click.Parameter, value: str | None) -> float | None:
    """Read a length such as 0.3mm or 300um, or a number in mm; return metres."""
    if value is None:
        return None
    found = re.fullmatch(r"([0-9.]+(?:e-?[0-9]+)?) ?(|mm|um|µm|m)", value)
    try:
        length = float(found[1]) * METRES[found[2]] if found else 0.0
    except ValueError:
        length = 0.0
    if not LEAST_ERROR <= length < 1.0:
        raise click.BadParameter(f"'{value}', expected a length such as 0.3mm, from 1um to 1m", context, parameter)
    return length
