"""A matplotlib figure that is drawn without a screen, the style of its axes, and its file."""

import io
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from hhsim.errors import InputError, OutputError
from hhsim.system.atomic_write import write_atomically

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D


def new_figure(width: float, height: float, **options: Any) -> "Figure":
    """Make an empty white figure of this size [inches], 100 pixels to the inch; `options` are matplotlib's."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=100, facecolor="white", **options)
    FigureCanvasAgg(figure)
    return figure


def tidy(axes: "Axes") -> None:
    """Draw faint grid lines behind the data, and no frame above and on the right."""
    axes.grid(color="0.92", linewidth=0.8)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def legend_mark(label: str, marker: str, color: str, face: str | None = None, size: float = 8.0) -> "Line2D":
    """Return a marker alone, for a legend; filled with `face`, or else with its own colour."""
    from matplotlib.lines import Line2D

    return Line2D(
        [], [], marker=marker, color=color, markerfacecolor=face or color, linestyle="none", markersize=size,
        label=label,
    )  # fmt: skip


def halo(width: float) -> dict[str, Any]:
    """Return the options of a text with a white rim of this width [pt]."""
    from matplotlib.patheffects import withStroke

    return {"path_effects": [withStroke(linewidth=width, foreground="white")]}


Limits = tuple[float, float]


def logarithmic(axes: "Axes", across: Limits, up: Limits, ticks: Sequence[float], heights: Sequence[float]) -> None:
    """Make logarithmic axes with these limits, marked at those of `ticks` and `heights` within them."""
    axes.set(xscale="log", yscale="log", xlim=across, ylim=up)
    inside = [tick for tick in ticks if across[0] <= tick <= across[1]]
    axes.set_xticks(inside, [f"{tick:,g}" for tick in inside])
    inside = [height for height in heights if up[0] <= height <= up[1]]
    axes.set_yticks(inside, [f"{height:g}" for height in inside])
    axes.minorticks_off()
    tidy(axes)


def draw_frontier(axes: "Axes", points: Sequence[tuple[float, float]], color: str, width: float) -> None:
    """Draw the Pareto frontier of points as steps, down to the fastest and on to the right of the best."""
    if best := sorted(points):
        times = [best[0][0], *(time for time, _ in best), 1e5]
        heights = [1e3, *(off for _, off in best), best[-1][1]]
        axes.plot(times, heights, color=color, linewidth=width, drawstyle="steps-post", zorder=2)


VECTOR = {
    # Journals ask for outlines that a reader of PDF can tell apart as letters.
    "pdf.fonttype": 42,
    # Else the names of clipping paths are random.
    "svg.hashsalt": "hhsim report",
}


def vector_bytes(figure: "Figure", kind: str, title: str) -> bytes:
    """Return a figure as a `pdf` or `svg`, without the date: the same figure gives the same bytes."""
    import matplotlib

    dates: dict[str, Any] = {"CreationDate": None} if kind == "pdf" else {"Date": None}
    buffer = io.BytesIO()
    with matplotlib.rc_context(cast(Any, VECTOR)):
        figure.savefig(buffer, format=kind, metadata={"Title": title, "Creator": "hhsim report", **dates})
    return buffer.getvalue()


def save_figure(figure: "Figure", path: Path) -> None:
    """Write a figure in the format of the file's ending; OutputError if it cannot be, InputError for another format."""
    kind = path.suffix.lower()[1:]
    if kind in ("pdf", "svg"):
        write_atomically(path, vector_bytes(figure, kind, path.stem))
        return
    try:
        figure.savefig(path)
    except OSError as error:
        raise OutputError(f"{path}: cannot write the picture: {error.strerror or error}") from error
    except ValueError as error:
        raise InputError(f"{path}: {error}") from error
