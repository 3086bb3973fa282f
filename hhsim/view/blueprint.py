"""Arrangement of a rerun viewer: the scene and the phases on the left, the plots on the right."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from hhsim.render.hand_picture import View
from hhsim.view.plots import GLOVE, Plot

if TYPE_CHECKING:
    import rerun.blueprint as rrb

VIEW = View(95.0, 10.0)
DISTANCE = 1.2
"""Distance of the viewer from the middle of the scene, in extents of the scene."""
BACKGROUND = (222, 226, 231)
LIVE_WINDOW = 10.0
"""Time that the plots of a live session show [s]."""


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
    """Arrange the views of a scene of this middle [m], world, shape (3,), and extent [m], plots from top to bottom.

    Entities of `hidden` are hidden at first; `tops` are upper ends of plots' axes from 0 at first, instead of their
    largest values. `live` follows the newest tick and shows the last `LIVE_WINDOW` seconds, and plays none.
    """
    import rerun.blueprint as rrb

    edge = rrb.TimeRangeBoundary.cursor_relative
    ranges = [rrb.VisibleTimeRange("time", start=edge(seconds=-LIVE_WINDOW), end=edge())] if live else None
    scene = scene_view("world", title, look_at, extent, hidden)
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
    left = rrb.Vertical(
        rrb.Tabs(scene, *(log if GLOVE in plots else ()), about, active_tab=0),
        rrb.StateTimelineView(origin="states", name="phases and state", time_ranges=ranges),
        row_shares=[5, 1],
    )
    right = rrb.Vertical(*lines, row_shares=[plot.height for plot in plots])
    return whole_blueprint(rrb.Horizontal(left, right, column_shares=[3, 2]), live=live)


def scene_view(origin: str, name: str, middle: ArrayLike, extent: float, hidden: Sequence[str]) -> "rrb.Spatial3DView":
    """Return the view of a scene, seen from `DISTANCE` of its extent [m]; `hidden` entities are not shown at first."""
    import rerun.blueprint as rrb

    target = np.asarray(middle, np.float64)
    eye = target + DISTANCE * extent * VIEW.towards
    return rrb.Spatial3DView(
        origin=origin,
        name=name,
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital, position=eye, look_target=target, eye_up=(0.0, 0.0, 1.0)
        ),
        line_grid=rrb.LineGrid3D(visible=False),
        background=BACKGROUND,
        overrides={path: rrb.EntityBehavior(visible=False) for path in hidden},
    )


def whole_blueprint(content: "rrb.Horizontal | rrb.Grid", *, live: bool = False) -> "rrb.Blueprint":
    """Return a blueprint whose panels are collapsed; it plays a recording in a loop, or follows a live session."""
    import rerun.blueprint as rrb

    return rrb.Blueprint(
        content,
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(
            state="collapsed",
            timeline="time",
            play_state="following" if live else "playing",
            loop_mode=None if live else "all",
        ),
    )
