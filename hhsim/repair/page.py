"""HTML page of the repair of one recording: verdict, figures before and after, curves and pictures."""

from collections.abc import Iterable, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from hhsim import __version__
from hhsim.arrays import FloatArray
from hhsim.metrics.field.hands import FieldHands
from hhsim.repair.request import RepairOutcome
from hhsim.report import figure as style
from hhsim.system.counted import counted
from hhsim.table.html import render

if TYPE_CHECKING:
    from matplotlib.axes import Axes

GENERATOR = "hhsim repair"
PANEL = 1.4
"""Height of a panel [inches]."""
MOST_LISTED = 20
"""Number of marked frames that are listed by their numbers."""


def repair_page(outcome: RepairOutcome, before: FieldHands, after: FieldHands, worst: bytes = b"") -> str:
    """Return the page of a repair; `worst` is a PNG of its deepest frames."""
    table = outcome.table
    assert table is not None
    return render(
        "repair/repair.html",
        title=table.title,
        generator=GENERATOR,
        version=__version__,
        verdict=outcome.verdict,
        missed=not outcome.ok,
        marked=_marked(outcome),
        figures=table,
        curve=depth_figure(before, after),
        worst=worst,
        findings=outcome.findings,
    )


def _marked(outcome: RepairOutcome) -> str:
    if not outcome.marked:
        return f"Each of {counted(outcome.frames, 'frame')} has a repair within the limit."
    listed = ", ".join(map(str, outcome.marked[:MOST_LISTED])) + (", …" if len(outcome.marked) > MOST_LISTED else "")
    share = f"{len(outcome.marked)} of {counted(outcome.frames, 'frame')}"
    return f"Marked are {share}, in which a joint moves by more than the limit or no free hand was found: {listed}."


def depth_figure(before: FieldHands, after: FieldHands) -> style.ReportFigure:
    """Draw the depth of the hand before and after, and the largest move of a joint, over time."""
    time = before.time
    depth = [1e3 * np.maximum(-hand.distance, 0.0) for hand in (before, after)]
    moved = 1e3 * np.linalg.norm(after.joints - before.joints, axis=2).max(axis=1)
    curves = ("recorded", depth[0], style.VERMILLION), ("repaired", depth[1], style.BLUE)

    def draw(curves: Iterable[tuple[str, FloatArray, str]], axes: "Axes") -> None:
        for name, values, color in curves:
            axes.plot(time, values, color=color, linewidth=1.0, label=name)
        axes.set_ylim(bottom=0.0)

    def over_all(axes: "Sequence[Axes]") -> None:
        axes[-1].set(xlim=(time[0], time[-1]), xlabel="time [s]")

    panels = (
        style.Panel("Depth in the object [mm]", PANEL, partial(draw, curves), [name for name, *_ in curves]),
        style.Panel("Largest move of a joint [mm]", PANEL, partial(draw, [("", moved, style.BLUE)])),
    )
    largest = f"recorded {depth[0].max():.1f} mm, repaired {depth[1].max():.3f} mm"
    alt = f"Depth over time; largest: {largest}; largest move of a joint {moved.max():.1f} mm"
    with style.chart(panels, over_all) as figure:
        return style.page_figure("depth", "Depth and correction.", f"Largest depth: {largest}.", alt, figure)
