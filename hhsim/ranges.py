"""Ranges of the numbers of a run, the same for options, files and the library's functions."""

from numbers import Integral, Real
from typing import Any, NamedTuple

from hhsim.errors import InputError


class Range(NamedTuple):
    """Least and greatest value of a number, its unit, and the reason."""

    least: float
    greatest: float
    unit: str = ""
    reason: str = ""


_STIFFNESS = "rounding leaves nothing of a hand's motion beyond"
RANGES = {
    "mass": Range(1e-9, 1e9, "kg"),
    "density": Range(1e-3, 1e6, "kg/m³"),
    "friction": Range(0.0, 100.0),
    "table_friction": Range(0.0, 100.0),
    "torsion": Range(0.0, 10.0, "m"),
    "table": Range(-100.0, 100.0, "m"),
    "hinge_friction": Range(0.0, 1e6, "N·m"),
    "slider_friction": Range(0.0, 1e6, "N"),
    "damping": Range(0.0, 1e6, "1/s"),
    "gravity": Range(-1e4, 1e4, "m/s²"),
    "velocity": Range(-1e4, 1e4, "m/s"),
    "angular_velocity": Range(-1e5, 1e5, "rad/s"),
    "size": Range(0.001, 20.0, "m", "a hand is to touch it"),
    "stiffness translation": Range(1e-9, 1e12, "N/m", _STIFFNESS),
    "stiffness rotation": Range(1e-9, 1e12, "N·m/rad", _STIFFNESS),
    "stiffness flexion": Range(1e-9, 1e12, "N·m/rad", _STIFFNESS),
    "stiffness contact": Range(1e-9, 1e12, "N/m", _STIFFNESS),
    "stiffness penalty": Range(1e-9, 1e12, "N/m", _STIFFNESS),
    "linearisations": Range(1, 1_000_000),
    "budget": Range(1, 2**62, "work units"),
    "threads": Range(1, 5, reason="a tick has the programs of five fingers"),
    "tolerance": Range(1e-12, 1e-6, "of the margin", "rounding begins below, and steps end inside above"),
    "margin": Range(1e-9, 100.0, "m"),
    "skin": Range(1e-9, 100.0, "m"),
    "offset": Range(1e-12, 100.0, "m"),
    "step_tolerance": Range(1e-12, 100.0, "m"),
    "snap_speed": Range(1e-6, 1e6, "m/s"),
    "touch": Range(1e-12, 100.0, "m"),
    "period": Range(1e-6, 1e3, "s"),
    "response": Range(1e-9, 1e3, "s"),
    "contact_response": Range(0.0, 1e3, "s"),
}
"""Range of each number by its name, in SI units."""


def check_range(name: str, value: Any) -> Any:
    """Return a number as int or float, like the range of that name in `RANGES`.

    InputError for no number, a fraction where a whole number is expected, or one outside of the range.
    """
    least, greatest, unit, reason = RANGES[name]
    kind: Any = Integral if isinstance(greatest, int) else Real
    if isinstance(value, kind) and not isinstance(value, bool) and least <= value <= greatest:
        return type(greatest)(value)
    # A whole number may have more digits than a float or a line can hold.
    shown = f"{value:g}" if isinstance(value, float) else repr(value)[:40]
    if unit and isinstance(value, Real):
        shown += f" {unit}"
    raise InputError(f"{name} is {shown}: expected {least:g} to {greatest:g}{reason and f'; {reason}'}")
