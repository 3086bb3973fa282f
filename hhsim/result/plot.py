"""Curves of a result's datasets over time, for notebooks."""

from typing import TYPE_CHECKING

from hhsim.errors import InputError
from hhsim.result.variables import LABELS, variables

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from hhsim.result.reader import Result

FORCE = ("force/size", "force/finger")
"""Datasets drawn for `force`."""
SOFT = "0.6"
"""Grey of the phases."""


def plot_curves(result: "Result", name: str, axes: "Axes | None" = None) -> "Axes":
    """Draw every element of a dataset, or of a group of one unit, over time, phases marked; return the axes.

    Args:
        result: Complete or not.
        name: Dataset or group; `force` is the size of the total force and those of the fingers'.
        axes: Where to draw; None for a figure of pyplot's.

    Raises:
        UnknownNameError: No such dataset or group.
        InputError: A group of several units, or rows that are not of the ticks.
    """
    found = variables(result, FORCE if name == "force" else [name])
    units = sorted({variable.units for variable in found.values()})
    rows = {variable.axes[0] for variable in found.values()}
    if len(units) > 1 or rows != {"time"}:
        raise InputError(
            f"{name} has rows along {', '.join(rows)} in units of {', '.join(units)}: "
            "expected datasets of the ticks in one unit"
        )
    if axes is None:
        from matplotlib import pyplot

        axes = pyplot.subplots(layout="constrained")[1]
    labels = {**LABELS, "hand": list(result.hands)}
    count = 0
    for dataset, variable in found.items():
        for place, values in variable.curves(labels):
            axes.plot(
                result["time"], values, label=" ".join(place) if len(found) == 1 or place else dataset, linewidth=1.0
            )
            count += 1
    for phase in result.phases:
        start = float(result["time"][phase.first_tick])
        axes.axvline(start, color=SOFT, linewidth=0.6, linestyle=":", zorder=0)
        axes.annotate(
            phase.name, (start, 1.0), (2.0, -2.0), xycoords=("data", "axes fraction"), textcoords="offset points",
            va="top", color=SOFT, fontsize="small",
        )  # fmt: skip
    unit = "" if units == ["1"] else f" [{units[0]}]"
    axes.set_xlabel("time [s]")
    axes.set_ylabel(f"{name}{unit}")
    if count > 1:
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize="small", frameon=False)
    return axes
