"""Picture of speed against error: each result a point, by what its file says."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from hhsim.arrays import IntArray
from hhsim.bench.run_errors import sampled
from hhsim.errors import HhsimError
from hhsim.hand.forward_kinematics import PlacedHand
from hhsim.kernels.mesh.bvh import build_mesh_bvh
from hhsim.metrics.contact_points import find_contact_points
from hhsim.metrics.mesh_penetration import contact_error, mesh_clearance
from hhsim.metrics.run.registry import tick_figures
from hhsim.metrics.run_ticks import result_ticks
from hhsim.render.speed_error_figure import PAPER_RANGE
from hhsim.report.figure import (
    BUDGET,
    LEFT,
    LIMIT,
    SOFT,
    Drawing,
    ReportFigure,
    drawn_figure,
    gridded,
    legend_names,
    panel_title,
    run_style,
    time_text,
)
from hhsim.result.reader import Result
from hhsim.scene.motion_catalogue import of_the_paper
from hhsim.view.viewer import shown_scene

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SAMPLES = 20
"""Ticks in contact whose hand is compared with the mesh: exact, and slow."""
PAPER_DEPTH = 1e-4
"""Deepest penetration that the paper states, about [m]."""
MARKS = ("o", "s", "D", "^", "v", "P", "X")
"""Markers, one more than colours: no two results of a page share both."""
ROUNDING = 1e-6
"""Smaller values, in the unit of their axis, are drawn as 0."""
PANEL, TITLE, LINE, BOTTOM = 2.0, 0.27, 0.16, 0.45
"""Height [inches] of a panel, its title, a line of the legend, and the axis below."""
RIGHT, TIME_LABEL = 0.08, 0.44
"""Width [inches] right of a panel, and of a time label with the gap to the next one."""


@dataclass(frozen=True)
class SpeedError:
    """One result as a point; NaN where a figure is undefined.

    Attributes:
        p50, p99: CPU time of a tick in contact [s].
        depth: Deepest penetration of the touched surface, leaf spheres or mesh, of all ticks [m].
        mesh: Deepest penetration of the mesh, or largest distance of a contact point from it, of sampled ticks [m].
        excess: Coupling energy above the optimum, mean of the hold [%].
        of_paper: True if the scene is one of the paper's.
    """

    label: str
    p50: float
    p99: float
    depth: float
    mesh: float
    excess: float
    of_paper: bool = False


@dataclass(frozen=True)
class Axis:
    """One panel: field of `SpeedError`, title with unit, scale to that unit, and a tenth of the lowest decade shown."""

    field: str
    title: str
    scale: float
    least: float


AXES = (
    Axis("depth", "deep in what is touched [µm]", 1e6, 1e-3),
    Axis("mesh", "off the true mesh [mm]", 1e3, 1e-2),
    Axis("excess", "over the optimum [%]", 1.0, 1e-3),
)


def speed_error_figure(results: Mapping[str, Result]) -> ReportFigure:
    """Draw each result by its label as a point: CPU time of a tick in contact, p50 to p99, against three errors."""
    points = [_measured(label, result) for label, result in results.items()]

    def draw(figure: "Figure", narrow: bool) -> None:
        width, height = (float(size) for size in figure.get_size_inches())
        lines = LINE * _legend(points, width)[2]
        columns = 1 if narrow else 3
        share = (width - RIGHT) / columns
        for number, axis in enumerate(AXES):
            across, down = (0, number) if narrow else (number, 0)
            bottom = height - lines - (down + 1) * (TITLE + PANEL) - down * BOTTOM
            inside = share - LEFT - RIGHT
            axes = figure.add_axes(((across * share + LEFT) / width, bottom / height, inside / width, PANEL / height))
            _draw_panel(axes, axis, points, inside)
        _draw_names(figure, points)

    def height(width: float, narrow: bool) -> float:
        return LINE * _legend(points, width)[2] + (3 if narrow else 1) * (TITLE + PANEL + BOTTOM) + 0.05

    return drawn_figure("speed-error", "Speed against error", _caption(points), _alt(points), Drawing(draw, height))


def _measured(label: str, result: Result) -> SpeedError:
    result = result.seen_from_object
    ticks = result_ticks(result)
    figures = tick_figures(ticks)
    return SpeedError(
        label,
        figures["tick_cpu_p50"],
        figures["tick_cpu_p99"],
        figures["penetration_max"] if result.ticks else np.nan,
        _off_the_mesh(result, np.flatnonzero(ticks.contact)),
        float(result.summary.get("tracking_excess", np.nan)),
        of_the_paper(result.scene),
    )


def _off_the_mesh(result: Result, contact: IntArray) -> float:
    """Return `SpeedError.mesh` at sampled ticks in contact; NaN without one, or where the scene is not known."""
    try:
        scene = shown_scene(result)
        bvh = build_mesh_bvh(scene.mesh.vertices, scene.mesh.faces)
    except HhsimError:
        # The hand, tree or mesh is not that of the run.
        return np.nan
    chosen = sampled(contact, SAMPLES)
    ticks = [result.at(int(tick), ("graphic/joints", "graphic/position", "graphic/orientation")) for tick in chosen]
    if not ticks:
        return np.nan
    placed = PlacedHand(*(np.array([tick[name] for tick in ticks]) for name in ticks[0]))
    off = contact_error(bvh, find_contact_points(scene.surface_arrays, scene.shape, placed, scene.touch).point)
    deepest = float(np.max(np.maximum(0.0, -mesh_clearance(bvh, scene.shape, placed))))
    return float(np.maximum(deepest, off.max())) if len(off) else np.nan


def _draw_panel(axes: "Axes", axis: Axis, points: Sequence[SpeedError], width: float) -> None:
    gridded(axes)
    panel_title(axes, axis.title, 6, LEFT - 0.16)
    scaled = [axis.scale * float(getattr(point, axis.field)) for point in points]
    values = [0.0 if abs(value) < ROUNDING else value for value in scaled]
    known = [value for value in values if np.isfinite(value)]
    some = [value for value in known if value > 0.0]
    paper = axis.field == "depth" and any(point.of_paper for point in points)
    low = 10.0 ** np.floor(np.log10(min([*some, axis.least * 10.0])))
    high = 10.0 ** np.ceil(np.log10(max([*some, *([axis.scale * PAPER_DEPTH] if paper else []), 10.0 * low])) + 0.1)
    # A logarithm has no zero: 0 stands below the lowest decade.
    decades = float(np.log10(high / low))
    zero = low * 10.0 ** (-0.12 * decades)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_ylim(zero * 10.0 ** (-0.1 * decades), high)
    axes.axhline(low, color=SOFT, linewidth=0.5, linestyle=":")
    _draw_times(axes, points, width)
    if paper:
        times = np.array(PAPER_RANGE) * 1e-6
        axes.plot(times, [axis.scale * PAPER_DEPTH] * 2, color=SOFT, linewidth=3.0, solid_capstyle="round")
        axes.annotate(
            "the paper", (float(times[1]), axis.scale * PAPER_DEPTH), (-4.0, 3.0), textcoords="offset points",
            ha="right", va="bottom", color=SOFT,
        )  # fmt: skip
    for number, (point, value) in enumerate(zip(points, values)):
        if not np.isfinite(value) or not np.isfinite(point.p50):
            continue
        color, height = run_style(number)[0], value if value > 0.0 else zero
        axes.plot([point.p50, point.p99], [height, height], color=color, linewidth=1.2)
        axes.plot(point.p50, height, MARKS[number % len(MARKS)], color=color, markersize=6.0, zorder=4)
        axes.plot(point.p99, height, "|", color=color, markersize=7.0)
    if not known:
        axes.text(0.5, 0.5, "not measured", transform=axes.transAxes, ha="center", va="center", color=SOFT)
    powers = [10.0**k for k in range(round(np.log10(low)), round(np.log10(high)) + 1)]
    powers = powers[:: 1 + len(powers) // 7]
    # An energy may be below the optimum; a depth is not below 0.
    least = "≤ 0" if any(value < 0.0 for value in known) else "0"
    axes.set_yticks([zero, *powers], [least, *(f"{power:,.10g}" for power in powers)])
    axes.minorticks_off()


def _draw_times(axes: "Axes", points: Sequence[SpeedError], width: float) -> None:
    """Draw the axis of the CPU time with the line of 1 ms; its panel's width [inches] decides how many labels fit."""
    times = [time for point in points for time in (point.p50, point.p99) if np.isfinite(time) and time > 0.0]
    low, high = 0.5 * min([*times, 1e-5]), 2.0 * max([*times, BUDGET])
    axes.set_xlim(low, high)
    axes.axvline(BUDGET, color=LIMIT, linewidth=1.2)
    decade = width / float(np.log10(high / low))
    step = int(np.ceil(TIME_LABEL / decade))
    powers = [k for k in range(-8, 3) if low <= 10.0**k <= high]
    # Counted from 1 ms, which always has its label; a label near the right end would be cut.
    fits = [(k + 3) % step == 0 and decade * np.log10(high / 10.0**k) > 0.5 * TIME_LABEL - 2.0 * RIGHT for k in powers]
    labels = [time_text(10.0**k).replace(".0 ", " ") if fit else "" for k, fit in zip(powers, fits)]
    axes.set_xticks([10.0**k for k in powers], labels)
    axes.set_xlabel("CPU time of a tick in contact")


def _legend(points: Sequence[SpeedError], width: float) -> tuple[list[str], int, int]:
    """Return names, columns and lines of the legend in a figure `width` inches wide."""
    names, columns = legend_names([point.label for point in points], width)
    return names, columns, -(-len(points) // columns)


def _draw_names(figure: "Figure", points: Sequence[SpeedError]) -> None:
    from matplotlib.lines import Line2D

    names, columns, _ = _legend(points, float(figure.get_figwidth()))
    handles = [
        Line2D([], [], marker=MARKS[n % len(MARKS)], color=run_style(n)[0], linewidth=1.2, label=name)
        for n, name in enumerate(names)
    ]
    figure.legend(
        handles=handles, loc="upper left", bbox_to_anchor=(0.0, 1.0), ncols=columns, borderaxespad=0.1, borderpad=0.1,
        handlelength=1.8, labelspacing=0.25,
    )  # fmt: skip


def _caption(points: Sequence[SpeedError]) -> str:
    text = (
        "Mark: p50 of the CPU time of ticks in contact; the line from it ends at p99. Further left is faster, further "
        "down is nearer to the truth; the axes are logarithmic, with a line of its own for 0 and less. First the "
        "deepest penetration of what is touched, the spheres or the mesh. Then how far the hand is in the true mesh or "
        f"a contact point off it, the larger, at up to {SAMPLES} ticks in contact: it holds the error of the sphere "
        "tree too. Last the coupling energy over that of the local optimum, mean of the hold, as the table has it. "
        "Red: 1 ms."
    )
    if any(point.of_paper for point in points):
        text += " Grey: what the paper states for its own machine."
    missing = [point.label for point in points if not np.isfinite(point.p50)]
    return text + (f" Not in contact, so without a point: {', '.join(missing)}." if missing else "")


def _alt(points: Sequence[SpeedError]) -> str:
    sentences = ["CPU time against three errors."]
    for point in points:
        if not np.isfinite(point.p50):
            sentences.append(f"{point.label}: no tick in contact.")
            continue
        off = f"{1e3 * point.mesh:.3g} mm off the mesh" if np.isfinite(point.mesh) else "off the mesh not measured"
        over = (
            f"{round(point.excess, 6) + 0.0:.3g} % over the optimum"
            if np.isfinite(point.excess)
            else "no optimum computed"
        )
        sentences.append(
            f"{point.label}: {time_text(point.p50)} to {time_text(point.p99)}, {1e6 * point.depth:.3g} µm deep in "
            f"what it touches, {off}, {over}."
        )
    return " ".join(sentences)
