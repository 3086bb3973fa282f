"""Labelled variables, values with named axes and a unit, as a data set of xarray or a table of pandas."""

import itertools
import math
from collections.abc import Iterator, Mapping
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any, NamedTuple

from hhsim.arrays import AnyArray
from hhsim.errors import InputError

if TYPE_CHECKING:
    import pandas
    import xarray

Labels = Mapping[str, Any]
"""Label of each place along an axis, by the axis's name."""


class Variable(NamedTuple):
    """Values by axes, the first of which has the rows; SI unit, `1` for none; and a description for people."""

    axes: tuple[str, ...]
    values: AnyArray
    units: str = "1"
    long_name: str = ""

    def curves(self, labels: Labels) -> Iterator[tuple[tuple[str, ...], AnyArray]]:
        """Yield each column of the rows, shape (T,), after the labels of its place along the other axes."""
        shape = self.values.shape
        flat = self.values.reshape(shape[0], math.prod(shape[1:]))
        for column, place in enumerate(itertools.product(*map(range, shape[1:]))):
            yield (
                tuple(str(labels[axis][k] if axis in labels else k) for axis, k in zip(self.axes[1:], place)),
                flat[:, column],
            )


def as_dataset(
    variables: Mapping[str, Variable], coordinates: Mapping[str, Any], attributes: Mapping[str, Any]
) -> "xarray.Dataset":
    """Return an xarray Dataset, units and descriptions as attributes; InputError without xarray.

    Args:
        variables: By name.
        coordinates: Variables, or labels along the axis of their name, as xarray takes them; axes of no variable are
            left out.
        attributes: Of the data set.
    """
    used = {axis for variable in variables.values() for axis in variable.axes}

    def taken(value: Any) -> Any:
        if not isinstance(value, Variable):
            return value
        stated = {"units": value.units, "long_name": value.long_name}
        return value.axes, value.values, {name: text for name, text in stated.items() if text}

    kept = {
        name: taken(value)
        for name, value in coordinates.items()
        if set(value.axes if isinstance(value, Variable) else () if isinstance(value, str) else (name,)) <= used
    }
    made = {name: taken(variable) for name, variable in variables.items()}
    found: xarray.Dataset = imported("xarray").Dataset(made, kept, dict(attributes))
    return found


def as_frame(variables: Mapping[str, Variable], labels: Labels, index: Variable | None) -> "pandas.DataFrame":
    """Return a pandas DataFrame, a column for each element, such as `force/total[x]`; InputError without pandas.

    `attrs["units"]` has the unit of each column. The index is the rows' numbers without another.
    """
    library = imported("pandas")
    columns: dict[str, AnyArray] = {}
    units: dict[str, str] = {}
    for name, variable in variables.items():
        for place, values in variable.curves(labels):
            heading = f"{name}[{','.join(place)}]" if place else name
            columns[heading], units[heading] = values, variable.units
    row = next(variable.axes[0] for variable in variables.values())
    named = library.RangeIndex(len(next(iter(columns.values()))), name=row)
    found: pandas.DataFrame = library.DataFrame(
        columns, index=named if index is None else library.Index(index.values, name=row)
    )
    found.attrs["units"] = units
    return found


def imported(package: str) -> ModuleType:
    """Import a package of an extra of the same name; InputError without it."""
    try:
        return import_module(package)
    except ImportError:
        raise InputError(f"{package} is not installed: pip install 'hhsim[{package}]'") from None
