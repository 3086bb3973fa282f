"""Plots of a viewer, and their arrangement: the scene and the phases on the left, the plots on the right."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import AnyArray, FloatArray, IntArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.fingers import FINGERS
from hhsim.motion.trajectory import RigidMotion
from hhsim.render.viewpoint import View

if TYPE_CHECKING:
    import rerun.blueprint as rrb

Color = tuple[int, int, int]

VIEW = View(95.0, 10.0)
DISTANCE = 1.2
"""Distance of the viewer from the middle of the scene, in extents of the scene."""
BACKGROUND = (222, 226, 231)
LIVE_WINDOW = 10.0
"""Time that the plots of a live session show [s]."""

RED: Color = (225, 87, 89)
FINGER_COLORS: tuple[Color, ...] = ((78, 121, 167), (242, 142, 43), (89, 161, 79), (176, 122, 161), (118, 183, 178))
BROWN: Color = (156, 117, 95)
PER_FINGER = dict(zip(FINGERS, FINGER_COLORS))


@dataclass(frozen=True, eq=False)
class Plot:
    """One plot of a viewer."""

    path: str  # its entity
    title: str
    series: Mapping[str, Color]  # names and colours of its lines
    worst: bool = True  # True if a thinned plot shows the largest value of the ticks that each shown one stands for
    legend: bool = True  # True if it names its lines
    height: float = 1.0  # height relative to the other plots

    def thinned(self, values: FloatArray, shown: IntArray, starts: IntArray) -> FloatArray:
        """Return the values that are shown, shape (N, series); arguments as in `hhsim.view.plots`."""
        if not self.worst or len(shown) == len(values):
            return values[shown]
        # NaN is no value: fmax passes it over.
        return np.fmax.reduceat(values, starts, axis=0)


FORCE = Plot("plots/force", "force on the hand [N]", {"all": RED, **PER_FINGER, "palm": BROWN}, worst=False, height=1.7)
DEPTH = Plot("plots/depth", "depth [µm]", {"deepest": RED, **PER_FINGER, "palm": BROWN}, legend=False, height=0.75)
VARIATION = Plot("plots/variation", "force change in a tick [%]", {"all": RED, **PER_FINGER}, legend=False, height=0.9)
TIME = Plot(
    "plots/time",
    "time of a tick [µs]",
    # The whole last: what comes last is drawn over the others.
    {**dict(zip(("detection", "palm or hand", "fingers", "forces"), FINGER_COLORS)), "whole": RED},
    height=1.4,
)
CONTACTS = Plot("plots/contacts", "pairs", {"candidates": FINGER_COLORS[0], "touching": RED}, height=0.8)

GLOVE = Plot("plots/glove", "stiffness told to the glove", PER_FINGER, worst=False, legend=False, height=0.75)
LOOP = Plot(
    "plots/loop",
    "wake-up after the deadline; sample to command [µs]",
    {"wake-up": FINGER_COLORS[0], "sample to command": RED},
    height=0.8,
)

DEPTHS = ("penetration_depth", "penetration_finger", "penetration_palm")
VARIATIONS = ("force_variation_rate", "force_variation_finger")
DURATIONS = tuple(f"duration/{name}" for name in ("detect", "palm", "fingers", "force", "total"))
PAIRS = ("contacts/candidates", "contacts/touching")
SHOWN_COLUMNS = (
    *("time", "graphic/joints", "force/phalanx", "force/total"),
    *(f"{whose}/{name}" for whose in ("haptic", "graphic") for name in HandConfiguration._fields),
    *(*DEPTHS, *VARIATIONS, *DURATIONS, *PAIRS),
)
"""Datasets of /tick that `shown_ticks` takes."""

RESULT_PLOTS = (FORCE, DEPTH, VARIATION, TIME, CONTACTS)
LIVE_PLOTS = (FORCE, GLOVE, DEPTH, TIME, LOOP, CONTACTS)


def force_values(phalanx: FloatArray, total: FloatArray) -> FloatArray:
    """Return `FORCE` [N] from phalanx forces (T, 5, 3, 3) and total (T, 3)."""
    palm = body_forces(phalanx, total)[:, 15:]
    return np.concatenate([sizes(part) for part in (total[:, None], np.einsum("tfpi->tfi", phalanx), palm)], axis=1)


def body_forces(phalanx: FloatArray, total: FloatArray) -> FloatArray:
    """Return the contact forces on all phalanges and the palm [N], shape (T, 16, 3); arguments as of `force_values`."""
    palm = total - np.einsum("tfpi->ti", phalanx)
    return np.concatenate([phalanx.reshape(-1, 15, 3), palm[:, None]], axis=1)


def sizes(vectors: FloatArray) -> FloatArray:
    """Return the norms of vectors, shape (…, 3), several times as fast as numpy's norm."""
    return np.asarray(np.sqrt(np.einsum("...i,...i->...", vectors, vectors)))


def loop_values(wakeup: AnyArray, latency: AnyArray) -> FloatArray:
    """Return `LOOP` [µs] from times [ns], shape (T,); a latency of -1 stands for none."""
    return 1e-3 * np.column_stack([wakeup, np.where(latency < 0, np.nan, latency)])


@dataclass(frozen=True)
class ShownTicks:
    """T ticks as a viewer gets them."""

    tick: IntArray  # their numbers, shape (T,)
    time: FloatArray  # [s], shape (T,)
    haptic: HandConfiguration
    graphic: HandConfiguration
    joints: FloatArray  # joints of the graphic hand [m], shape (T, 5, 4, 3)
    phalanx: FloatArray  # contact force on each phalanx [N], shape (T, 5, 3, 3)
    total: FloatArray  # sum of all contact forces [N], shape (T, 3)
    touching: IntArray  # ticks in which something may touch, indices from 0
    plots: Mapping[Plot, FloatArray]  # values of each plot, shape (T, its series)
    # Motion of the object since the first tick, or of each part from its own frame; empty without motion.
    moved: tuple[RigidMotion, ...] = ()


def shown_ticks(
    column: Callable[[str], AnyArray],
    tick: ArrayLike,
    shown: ArrayLike,
    starts: ArrayLike,
    more: Mapping[Plot, FloatArray] | None = None,
    moved: Sequence[RigidMotion] = (),
) -> ShownTicks:
    """Return what a viewer gets of N ticks, of which `column` returns any of `SHOWN_COLUMNS` by its name.

    `shown` are the indices of the ticks that are shown, shape (T,), `starts` the first of those that each stands for,
    shape (T,); `more` has further plots and their values, shape (N, series).
    """
    kept, begins = np.asarray(shown), np.asarray(starts)
    haptic, graphic = (
        HandConfiguration(*(column(f"{whose}/{name}")[kept] for name in HandConfiguration._fields))
        for whose in ("haptic", "graphic")
    )
    phalanx, total, touching = column("force/phalanx"), column("force/total"), column("contacts/touching")

    def stacked(names: Sequence[str]) -> FloatArray:
        return np.column_stack([column(name) for name in names])

    plots = {
        FORCE: force_values(phalanx, total),
        DEPTH: 1e6 * stacked(DEPTHS),
        VARIATION: stacked(VARIATIONS),
        TIME: 1e-3 * stacked(DURATIONS),
        CONTACTS: stacked(PAIRS).astype(np.float64),
        **(more or {}),
    }
    return ShownTicks(
        tick=np.asarray(tick)[kept],
        time=column("time")[kept],
        haptic=haptic,
        graphic=graphic,
        joints=column("graphic/joints")[kept],
        phalanx=phalanx[kept],
        total=total[kept],
        touching=np.flatnonzero(touching[kept]),
        plots={plot: plot.thinned(values, kept, begins) for plot, values in plots.items()},
        moved=tuple(RigidMotion(one.turn[kept], one.shift[kept]) for one in moved),
    )


def blueprint(
    look_at: ArrayLike,
    extent: float,
    title: str,
    plots: Sequence[Plot],
    *,
    hidden: Sequence[str] = (),
    tops: Mapping[Plot, float] | None = None,
    hands: Mapping[str, str] | None = None,
    live: bool = False,
) -> "rrb.Blueprint":
    """Arrange the views of a scene of this middle [m], world, shape (3,), and extent [m], plots from top to bottom.

    Entities of `hidden` are hidden at first; `tops` are upper ends of plots' axes from 0 at first, instead of their
    largest values. `hands` are the names of hands by the beginning of their entities' names. `live` follows the newest
    tick and shows the last `LIVE_WINDOW` seconds, and plays none.
    """
    import rerun.blueprint as rrb

    edge = rrb.TimeRangeBoundary.cursor_relative
    ranges = [rrb.VisibleTimeRange("time", start=edge(seconds=-LIVE_WINDOW), end=edge())] if live else None
    target, ends, roots = np.asarray(look_at, np.float64), tops or {}, hands or {"": ""}
    first = next(iter(roots))
    scene = rrb.Spatial3DView(
        origin="world" if len(roots) == 1 else "/",
        name=title,
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=target + DISTANCE * extent * VIEW.towards,
            look_target=target,
            eye_up=(0.0, 0.0, 1.0),
        ),
        line_grid=rrb.LineGrid3D(visible=False),
        background=BACKGROUND,
        overrides={path: rrb.EntityBehavior(visible=False) for path in hidden},
    )
    columns = [
        rrb.Vertical(
            *(
                rrb.TimeSeriesView(
                    origin=f"{root}{plot.path}",
                    name=plot.title,
                    plot_legend=rrb.PlotLegend(corner=rrb.Corner2D.LeftTop, visible=plot.legend),
                    axis_y=rrb.ScalarAxis(range=(0.0, ends[plot])) if plot in ends else None,
                    time_ranges=ranges,
                )
                for plot in plots
            ),
            row_shares=[plot.height for plot in plots],
            name=name or None,
        )
        for root, name in roots.items()
    ]
    about = rrb.TextDocumentView(origin=f"{first}run", name="what was run")
    log = (rrb.TextLogView(origin=f"{first}log", name="what happened"),)
    left = rrb.Vertical(
        rrb.Tabs(scene, *(log if GLOVE in plots else ()), about, active_tab=0),
        rrb.StateTimelineView(origin=f"{first}states", name="phases and state", time_ranges=ranges),
        row_shares=[5, 1],
    )
    right = columns[0] if len(columns) == 1 else rrb.Tabs(*columns)
    # Panels are collapsed; a recording plays in a loop.
    return rrb.Blueprint(
        rrb.Horizontal(left, right, column_shares=[3, 2]),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(
            state="collapsed",
            timeline="time",
            play_state="following" if live else "playing",
            loop_mode=None if live else "all",
        ),
    )
