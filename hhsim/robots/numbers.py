"""Numbers and words of text formats: every digit of a float, without an exponent, and checked spheres."""

import json
from collections.abc import Iterable
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import InputError

LARGEST = 1000.0
"""Largest coordinate or radius [m]: beyond it the file has another unit, or is damaged."""


def digits(value: float) -> str:
    """Return the shortest text that is this number, never with an exponent, which YAML 1.1 takes for a word."""
    return np.format_float_positional(float(value), trim="0")


def row(values: Iterable[float], between: str = " ") -> str:
    """Return the numbers of a vector in one text."""
    return between.join(map(digits, values))


def word(text: str) -> str:
    """Return a word in quotation marks, as JSON and YAML read it."""
    return json.dumps(text)


def checked_spheres(rows: Iterable[tuple[Any, Any]], link: str) -> FloatArray:
    """Return spheres of a file, pairs of centre and radius, as an array (n, 4) [m].

    Spheres whose radius is not positive are unused, as in cuRobo's files; InputError for what are no numbers.
    """
    found = []
    for center, radius in rows:
        try:
            values = np.array([*center, radius], np.float64)
        except (TypeError, ValueError):
            values = np.full(4, np.nan)
        if values.shape != (4,) or not (np.abs(values) <= LARGEST).all():
            raise InputError(
                f"link '{link}': a sphere of centre {center}, radius {radius}; expected numbers, in metres"
            )
        if values[3] > 0.0:
            found.append(values)
    return np.array(found).reshape(-1, 4)
