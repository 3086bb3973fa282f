"""Panels of cost against error, on logarithmic axes with a line for an error of nothing."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from hhsim.report import figure as style

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MARKS = ("o", "s", "D", "^", "v", "P", "X")
"""Markers, one more than colours: no two results of a page share both."""
PAPER_RANGE = (310e-6, 480e-6)
"""Mean times of a tick that the paper states, for the five simple objects of its Fig. 11, on its own machine [s]."""
ROUNDING = 1e-6
"""Smaller errors, in the unit of their axis, are drawn as 0."""
TIME_LABEL = 0.44
"""Width of a time label with the gap to the next one [inches]."""


@dataclass(frozen=True)
class Mark:
    """One mark of a panel."""

    cost: float  # cost, such as the median CPU time of a tick [s]; NaN where undefined
    error: float  # error in the unit of the panel; NaN where undefined
    color: str
    shape: str
    until: float | None = None  # cost at which a line from the mark ends; None for no line
    filled: bool = True  # False for a mark with a white face
    best: bool = False  # True if a line joins it to the others that are best

    @property
    def known(self) -> bool:
        """True if cost and error are defined."""
        return bool(np.isfinite(self.cost) and np.isfinite(self.error))


@dataclass(frozen=True)
class TradeOff:
    """One panel."""

    title: str
    marks: Sequence[Mark]
    least: float  # a tenth of the lowest decade that is shown, in the unit of the errors
    # Error that the paper states, drawn over its mean times for simple objects; NaN for these alone, None for neither.
    paper: float | None = None
    axis: str = "CPU time of a tick in contact"  # label of the axis below
    budget: float | None = style.BUDGET  # limit of a time, drawn as a line [s]; None for none
    spelled: Callable[[float], str] = style.time_text  # text of a number on the axis below


def trade_off_drawing(
    panels: Sequence[TradeOff], names: Mapping[str, tuple[str, str]], size: tuple[float, float]
) -> style.Drawing:
    """Return the drawing of panels, whose least width with labels, and height, are `size` [inches].

    `names` has colour and mark by label in the legend.
    """
    drawn = [style.Panel(panel.title, size[1], partial(_draw_panel, panel=panel)) for panel in panels]
    return style.chart(drawn, names=names, least=size[0])


def _draw_panel(axes: "Axes", panel: TradeOff) -> None:
    errors = [0.0 if abs(mark.error) < ROUNDING else mark.error for mark in panel.marks if np.isfinite(mark.error)]
    some = [error for error in errors if error > 0.0]
    paper = panel.paper if panel.paper is not None and np.isfinite(panel.paper) else None
    low = 10.0 ** np.floor(np.log10(min([*some, panel.least * 10.0])))
    high = 10.0 ** np.ceil(np.log10(max([*some, *([paper] if paper else []), 10.0 * low])) + 0.1)
    # A logarithm has no zero: 0 stands below the lowest decade, where an error is nothing.
    decades = float(np.log10(high / low))
    zero = low * 10.0 ** (-0.12 * decades)
    has_zero = len(some) < max(1, len(errors))
    axes.set(xscale="log", yscale="log", ylim=(zero * 10.0 ** (-0.1 * decades) if has_zero else low, high))
    axes.axhline(low, color=style.SOFT, linewidth=0.5, linestyle=":")
    _draw_axis(axes, panel)
    if paper is not None:
        axes.plot(PAPER_RANGE, [paper] * 2, color=style.SOFT, linewidth=3.0, solid_capstyle="round")
        axes.annotate(
            "the paper", (PAPER_RANGE[1], paper), (-4.0, 3.0), textcoords="offset points", ha="right", va="bottom",
            color=style.SOFT,
        )  # fmt: skip
    elif panel.paper is not None:
        axes.axvspan(*PAPER_RANGE, color=style.SOFT, alpha=0.1, linewidth=0)
    heights = [mark.error if mark.error >= ROUNDING else zero for mark in panel.marks]
    known = [(mark, height) for mark, height in zip(panel.marks, heights) if mark.known]
    for mark, height in known:
        face = mark.color if mark.filled else "white"
        axes.plot(
            mark.cost,
            height,
            mark.shape,
            color=mark.color,
            markerfacecolor=face,
            markersize=6.0,
            zorder=4,
            clip_on=False,
        )
        if mark.until is not None:
            axes.plot([mark.cost, mark.until], [height, height], color=mark.color, linewidth=1.2)
            axes.plot(mark.until, height, "|", color=mark.color, markersize=7.0)
    if best := sorted((mark.cost, height) for mark, height in known if mark.best):
        # Steps, down to the cheapest and on to the right of the best.
        costs, steps = [best[0][0], *(cost for cost, _ in best), 1e9], [1e9, *(off for _, off in best), best[-1][1]]
        axes.plot(costs, steps, color=style.SOFT, linewidth=0.9, drawstyle="steps-post", zorder=2)
    if not errors:
        style.note(axes, "not measured")
    powers = [10.0**k for k in range(round(np.log10(low)), round(np.log10(high)) + 1)]
    powers = powers[:: 1 + len(powers) // 7]
    # An energy may be below the optimum; a depth is not below 0.
    least = "≤ 0" if any(error < 0.0 for error in errors) else "0"
    zeros = {zero: least} if has_zero else {}
    axes.set_yticks(
        [*zeros, *powers], [*zeros.values(), *(f"{power:,.{max(0, -round(np.log10(power)))}f}" for power in powers)]
    )
    axes.minorticks_off()


def _draw_axis(axes: "Axes", panel: TradeOff) -> None:
    """Draw the axis below with the line of the budget; the panel's width decides how many labels fit."""
    ends = [end for mark in panel.marks for end in (mark.cost, mark.until) if end is not None]
    costs = [end for end in ends if np.isfinite(end) and end > 0.0]
    costs += [] if panel.budget is None else [1e-5, panel.budget]
    low, high = 0.5 * min(costs, default=1.0), 2.0 * max(costs, default=1.0)
    axes.set_xlim(low, high)
    if panel.budget is not None:
        axes.axvline(panel.budget, color=style.LIMIT, linewidth=1.2)
    decade = style.inches(axes) / float(np.log10(high / low))
    step = int(np.ceil(TIME_LABEL / decade))
    powers = [k for k in range(-8, 8) if low <= 10.0**k <= high]
    # Counted from 1 ms, which always has its label; a label near the right end would be cut.
    fits = [
        (k + 3) % step == 0 and decade * np.log10(high / 10.0**k) > 0.5 * TIME_LABEL - 2.0 * style.RIGHT for k in powers
    ]
    labels = [panel.spelled(10.0**k).replace(".0 ", " ") if fit else "" for k, fit in zip(powers, fits)]
    axes.set_xticks([10.0**k for k in powers], labels)
    axes.set_xlabel(panel.axis)
