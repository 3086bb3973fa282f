"""HTML page of the repair of one recording: verdict, figures before and after, curves and pictures."""

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
    from matplotlib.figure import Figure

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
    panels: list[tuple[str, list[tuple[str, FloatArray, str]]]] = [
        ("Depth in the object [mm]", [("recorded", depth[0], style.VERMILLION), ("repaired", depth[1], style.BLUE)]),
        ("Largest move of a joint [mm]", [("repaired", moved, style.BLUE)]),
    ]

    def draw(figure: "Figure", narrow: bool) -> None:
        for k, (title, curves) in enumerate(panels):
            size = figure.get_size_inches()[0] - style.LEFT - style.RIGHT, PANEL
            axes = style.add_panel(
                figure,
                style.LEFT,
                style.TOP + style.LEGEND_LINE + style.TITLE + k * (style.TITLE + PANEL + style.BOTTOM),
                size,
            )
            lines = [axes.plot(time, values, color=color, linewidth=1.0)[0] for _, values, color in curves]
            style.gridded(axes)
            axes.set_xlim(time[0], time[-1])
            axes.set_ylim(bottom=0.0)
            style.panel_title(axes, title, 12.0 if len(lines) > 1 else 3.0)
            if len(lines) > 1:
                style.fitted_legend([name for name, _, _ in curves], size[0]).draw(axes, lines)
        axes.set_xlabel("time [s]")

    drawing = style.Drawing(
        draw, lambda width, narrow: style.TOP + style.LEGEND_LINE + 2 * (style.TITLE + PANEL + style.BOTTOM)
    )
    largest = f"recorded {depth[0].max():.1f} mm, repaired {depth[1].max():.3f} mm"
    alt = f"Depth over time; largest: {largest}; largest move of a joint {moved.max():.1f} mm"
    return style.drawn_figure("depth", "Depth and correction.", f"Largest depth: {largest}.", alt, drawing)
