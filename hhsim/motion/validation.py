"""Checks of a motion. Each raises one line: what is wrong, at which sample, what would be right."""

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import FloatArray, IntArray
from hhsim.errors import TrajectoryError
from hhsim.system.counted import counted

MIN_QUATERNION_NORM = 1e-6
"""Shortest quaternion that has a direction."""
UNIT_TOLERANCE = 4.0 * float(np.finfo(np.float64).eps)
"""Largest deviation from unit length that is kept, so that a file read back holds the same bytes."""


def as_numbers(label: str, given: ArrayLike, shape: tuple[int, ...] | None = None, expected: str = "") -> FloatArray:
    """Return a float64 copy, C-contiguous, of any shape by default; messages may name the right one as `expected`.

    Raises TrajectoryError for no array of numbers, or one of another shape.
    """
    try:
        values = np.array(given, dtype=np.float64, order="C")
    except (TypeError, ValueError):
        raise TrajectoryError(f"{label} does not hold numbers") from None
    if shape is not None and values.shape != shape:
        raise TrajectoryError(f"{label} has shape {values.shape}; expected {expected or shape}")
    return values


def check_finite(label: str, values: FloatArray, time: FloatArray | None = None) -> None:
    """Raise TrajectoryError for NaN and infinity."""
    bad = ~np.isfinite(values)
    if bad.any():
        place = _place(np.argwhere(bad)[0], time)
        bad_count = counted(int(bad.sum()), "NaN or infinite value")
        raise TrajectoryError(f"{label} has {bad_count}, first at {place}; expected finite numbers")


def check_increasing(time: FloatArray) -> None:
    """Raise TrajectoryError for stamps that repeat or go backwards."""
    bad = np.flatnonzero(np.diff(time) <= 0.0) + 1
    if bad.size:
        i = int(bad[0])
        kind = "repeats" if time[i] == time[i - 1] else "goes backwards"
        raise TrajectoryError(
            f"time {kind} at sample {i} ({time[i - 1]:.9g} s, then {time[i]:.9g} s), "
            f"{counted(bad.size, 'such place')}; expected increasing stamps"
        )


def check_magnitude(label: str, values: FloatArray, limit: float, unit: str, question: str, time: FloatArray) -> None:
    """Raise TrajectoryError for values beyond `limit`, which are in another unit; `question` says which."""
    bad = np.abs(values) > limit
    if bad.any():
        first = np.argwhere(bad)[0]
        place = f"{values[tuple(first)]:.6g} at {_place(first, time)}"
        raise TrajectoryError(f"{label} is {place}, beyond {limit:.4g} {unit}: {question}; expected [{unit}]")


def continuous_orientation(quaternions: FloatArray, time: FloatArray, label: str = "orientation") -> FloatArray:
    """Return unit quaternions without sign flips, shape (T, 4); TrajectoryError for one of length zero or infinity."""
    with np.errstate(over="ignore"):
        norm = np.linalg.norm(quaternions, axis=1)
    faults = {"zero quaternion": norm < MIN_QUATERNION_NORM, "infinitely long quaternion": norm == np.inf}
    for what, wrong in faults.items():
        none = np.flatnonzero(wrong)
        if none.size:
            first = f"{counted(none.size, what)}, first at {_place(none[:1], time)}"
            raise TrajectoryError(f"{label} has {first}; expected unit (w, x, y, z)")
    off = np.abs(norm - 1.0) > UNIT_TOLERANCE
    unit = np.where(off[:, None], quaternions / norm[:, None], quaternions)
    flips = np.where(np.sum(unit[1:] * unit[:-1], axis=1) < 0.0, -1.0, 1.0)
    sign = np.concatenate([[1.0], np.cumprod(flips)])
    return np.ascontiguousarray(unit * sign[:, None])


def _place(index: IntArray, time: FloatArray | None) -> str:
    sample = int(index[0])
    place = f"sample {sample}"
    if len(index) > 1:
        place += f", channel {', '.join(str(i) for i in index[1:])}"
    return place if time is None else f"{place} (t = {time[sample]:.6g} s)"
