"""How a rerun viewer is arranged when it opens: the scene and the phases on the left, the plots on the right."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from hhsim.render.viewpoint import View
from hhsim.view.plots import GLOVE, Plot

if TYPE_CHECKING:
    import rerun.blueprint as rrb

VIEW = View(95.0, 10.0)
DISTANCE = 1.2
"""Of the viewer from the middle of the scene, in extents of the scene."""
BACKGROUND = (222, 226, 231)
LIVE_WINDOW = 10.0
"""What the plots of a live session show [s]."""


def blueprint(
    look_at: ArrayLike,
    extent: float,
    title: str,
    plots: Sequence[Plot],
    *,
    hidden: Sequence[str] = (),
    tops: Mapping[Plot, float] | None = None,
    live: bool = False,
) -> "rrb.Blueprint":
    """Arrange the views.

    Args:
        look_at: Middle of what is shown [m], world, shape (3,).
        extent: Of what is shown [m].
        plots: From top to bottom.
        hidden: Entities of the scene that are not seen at first.
        tops: Where a plot's axis ends at first, from 0 on, instead of at its largest value.
        live: Follow the newest tick and show the last `LIVE_WINDOW` seconds, instead of playing a recording.
    """
    import rerun.blueprint as rrb

    middle = np.asarray(look_at, np.float64)
    eye = middle + DISTANCE * extent * VIEW.towards
    window = [
        rrb.VisibleTimeRange(
            "time",
            start=rrb.TimeRangeBoundary.cursor_relative(seconds=-LIVE_WINDOW),
            end=rrb.TimeRangeBoundary.cursor_relative(),
        )
    ]
    ranges = window if live else None
    scene = rrb.Spatial3DView(
        origin="world",
        name=title,
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital, position=eye, look_target=middle, eye_up=(0.0, 0.0, 1.0)
        ),
        line_grid=rrb.LineGrid3D(visible=False),
        background=BACKGROUND,
        overrides={path: rrb.EntityBehavior(visible=False) for path in hidden},
    )
    ends = tops or {}
    lines = [
        rrb.TimeSeriesView(
            origin=plot.path,
            name=plot.title,
            plot_legend=rrb.PlotLegend(corner=rrb.Corner2D.LeftTop, visible=plot.legend),
            axis_y=rrb.ScalarAxis(range=(0.0, ends[plot])) if plot in ends else None,
            time_ranges=ranges,
        )
        for plot in plots
    ]
    about = rrb.TextDocumentView(origin="run", name="what was run")
    log = (rrb.TextLogView(origin="log", name="what happened"),)
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(
                rrb.Tabs(scene, *(log if GLOVE in plots else ()), about, active_tab=0),
                rrb.StateTimelineView(origin="states", name="phases and state", time_ranges=ranges),
                row_shares=[5, 1],
            ),
            rrb.Vertical(*lines, row_shares=[plot.height for plot in plots]),
            column_shares=[3, 2],
        ),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(
            state="collapsed",
            timeline="time",
            play_state="following" if live else "playing",
            loop_mode=None if live else "all",
        ),
    )
