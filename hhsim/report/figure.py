"""Style of a report's charts, one below another over one x axis, and a figure with its texts as a page has it.

Colours are Okabe and Ito's for the colour-blind ("Color Universal Design", 2008).
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, cast

from hhsim.render.figure import png_bytes

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ORANGE, SKY, GREEN = "#e69f00", "#56b4e9", "#009e73"
BLUE, VERMILLION, PURPLE = "#0072b2", "#d55e00", "#cc79a7"

INK = "#24292f"
SOFT = "#57606a"
"""Colour of secondary text; its contrast on white meets WCAG AA."""
GRID = "#e4e7eb"
LIMIT = "#b00020"
"""Colour of the line of 1 ms."""
FINGER_COLORS = (VERMILLION, BLUE, GREEN, ORANGE, PURPLE)
"""Colours of the fingers, thumb to little finger."""
RUN_STYLES = (
    *zip((BLUE, VERMILLION, GREEN, PURPLE, ORANGE, SKY), ("-", "--") * 3),
    *zip((BLUE, VERMILLION, GREEN, PURPLE, ORANGE, SKY), ("--", "-") * 3),
)
"""Colour and dashes of each result in turn; the dashes of a second curve show a first one below it."""

BUDGET = 1e-3
"""Time of a tick at 1 kHz [s]."""

LEAST_TIME = 1e-7
"""Shorter ticks are drawn at it [s]: a logarithm has no zero."""
PAGE_INCHES = 7.0
"""Width of the text of an A4 page."""
ACROSS = PAGE_INCHES - 0.7
"""Width of a panel without the labels of its axis [inches]."""
DPI = 200
TEXT = 9.0
"""Size of the smallest text [pt]."""
LETTER, SIGN = 0.075, 0.36
"""Width of a letter and of a sign in a legend [inches]."""
HEAD, FOOT = 0.42, 0.45
"""Height of the title and legend of a panel, and of the axis below all panels [inches]."""
LEGEND: Any = {"borderaxespad": 0.1, "borderpad": 0.1, "handlelength": 1.4, "handletextpad": 0.4, "columnspacing": 0.9}


@dataclass(frozen=True)
class ReportFigure:
    """One picture of a report."""

    name: str  # name of its file and anchor: lower case, digits and hyphens
    title: str
    caption: str  # what is drawn and how to read it, plain text
    alt: str  # alternative text
    png: bytes = field(repr=False)
    width_px: int
    height_px: int

    def _repr_png_(self) -> bytes:
        """Return what a notebook shows."""
        return self.png


@dataclass(frozen=True)
class Panel:
    """One panel of a chart: title with unit, height [inches], what draws it, and names of its legend, if any."""

    title: str
    height: float
    draw: "Callable[[Axes], None]"
    names: Sequence[str] = ()


def run_style(number: int) -> tuple[str, str]:
    """Return colour and dashes of a result by its number from 0."""
    return RUN_STYLES[number % len(RUN_STYLES)]


def page_figure(name: str, title: str, caption: str, alt: str, figure: "Figure") -> ReportFigure:
    """Return a drawn figure with its texts, which are those of `ReportFigure`."""
    width, height = (round(float(side) * figure.dpi) for side in figure.get_size_inches())
    return ReportFigure(name, title, caption, alt, png_bytes(figure), width, height)


@contextmanager
def new_figure(width: float, height: float, layout: str | None = None) -> "Iterator[Figure]":
    """Make a figure of this size [inches] in the report's style, whatever the user's matplotlibrc says.

    `layout` is matplotlib's, None for axes that are placed by hand.
    """
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    settings: dict[str, Any] = {
        **dict.fromkeys(("font.size", "axes.labelsize", "axes.titlesize", "legend.fontsize"), TEXT),
        **dict.fromkeys(("xtick.labelsize", "ytick.labelsize"), TEXT),
        **dict.fromkeys(("text.color", "axes.labelcolor", "xtick.color", "ytick.color"), INK),
        **dict.fromkeys(("axes.linewidth", "xtick.major.width", "ytick.major.width", "grid.linewidth"), 0.6),
        **dict.fromkeys(("axes.spines.top", "axes.spines.right", "legend.frameon"), False),
        "axes.edgecolor": SOFT,
        "axes.axisbelow": True,
        "axes.titleweight": "bold",
        "axes.titlelocation": "left",
        "grid.color": GRID,
        "agg.path.chunksize": 20_000,
    }
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        parameters: Any = matplotlib.rcParams
        parameters.update(settings)
        figure = Figure(figsize=(width, height), dpi=DPI, facecolor="white", layout=cast(Any, layout))
        FigureCanvasAgg(figure)
        yield figure


@contextmanager
def chart(panels: Sequence[Panel], over_all: "Callable[[Sequence[Axes]], None]") -> "Iterator[Figure]":
    """Draw panels one below another over one x axis, each below its title and legend, then what is over all panels."""
    height = sum(panel.height + HEAD for panel in panels) + FOOT
    with new_figure(PAGE_INCHES, height, "constrained") as figure:
        heights = [panel.height for panel in panels]
        grid = figure.subplots(len(panels), sharex=True, squeeze=False, height_ratios=heights)
        drawn: list[Axes] = grid[:, 0].tolist()
        for panel, axes in zip(panels, drawn):
            axes.grid(axis="y")
            axes.tick_params(length=3.0)
            panel.draw(axes)
            handles = axes.get_legend_handles_labels()[0] if panel.names else []
            # Below the title, and above the panel.
            axes.set_title(panel.title, pad=18.0 if handles else 4.0)
            if handles:
                labels, most = list(panel.names), max(2, int((ACROSS / len(handles) - SIGN) / LETTER))
                if sum(SIGN + LETTER * len(label) for label in labels) > ACROSS:
                    labels = [label if len(label) <= most else f"{label[: most - 1]}…" for label in labels]
                axes.legend(handles, labels, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=len(labels), **LEGEND)
        over_all(drawn)
        yield figure


def inches(axes: "Axes") -> float:
    """Return how wide a panel is [inches]."""
    figure = axes.get_figure(root=True)
    assert figure is not None
    return axes.get_position().width * float(figure.get_figwidth())


def note(axes: "Axes", text: str) -> None:
    """Write in the middle of a panel why it is empty."""
    axes.text(0.5, 0.5, text, transform=axes.transAxes, ha="center", va="center", color=SOFT)


def time_text(seconds: float) -> str:
    """Return a duration with the unit that suits it: "310 µs", "1.2 ms"."""
    if seconds < 1e-6:
        return f"{1e9 * seconds:.0f} ns"
    if seconds < BUDGET:
        # Rounded to nanoseconds: a tie is rounded alike whatever unit the time came in.
        micro = round(1e6 * seconds, 3)
        return f"{micro:.0f} µs" if micro >= 100.0 else f"{micro:.1f} µs"
    if seconds < 1.0:
        return f"{1e3 * seconds:.3g} ms"
    return f"{seconds:.3g} s" if seconds < 1000.0 else f"{seconds:,.0f} s"
