"""Figures of `hhsim report` and the style that they share.

Sizes are those on paper: a figure is as wide as the text of an A4 page, its text at least 9 pt, and it is drawn a
second time for a phone. Colours are Okabe and Ito's for the colour-blind ("Color Universal Design", 2008).
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

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
LEFT = 0.6
"""Width of the labels of the y axes [inches]."""
PAGE_INCHES = 7.0
"""Width of the text of an A4 page."""
PHONE_INCHES = 3.6
DPI = 200
TEXT = 9.0
"""Size of the smallest text [pt]."""
LETTER, SIGN, LEGEND_LINE = 0.075, 0.36, 0.17
"""Width of a letter and of a sign in a legend, and height of its lines [inches]."""
TITLE, TOP, BOTTOM, RIGHT = 0.27, 0.02, 0.45, 0.1
"""Space for the title of a panel, above all panels, below them for the axis, and right of them [inches]."""
LEGEND: Any = {
    "bbox_to_anchor": (0.0, 1.0),
    "borderaxespad": 0.15,
    "borderpad": 0.1,
    "labelspacing": 0.2,
    "handlelength": 1.4,
    "handletextpad": 0.4,
    "columnspacing": 0.9,
}


@dataclass(frozen=True)
class Drawing:
    """A figure at any width [inches]: what draws it and gives its height, laid out narrow where the flag is set."""

    draw: "Callable[[Figure, bool], None]"
    height: Callable[[float, bool], float]


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
    phone_png: bytes | None = field(default=None, repr=False)  # the figure for a narrow page; None where `png` will do
    drawing: Drawing | None = field(
        default=None, compare=False, repr=False
    )  # draws it again; None for a rendered picture

    def _repr_png_(self) -> bytes:
        """Return what a notebook shows."""
        return self.png


@dataclass(frozen=True)
class PageFigure:
    """A figure as a page has it; `title` replaces its own title and caption, `aside` stands beside another figure."""

    name: str
    figure: ReportFigure
    title: str
    aside: bool


@dataclass(frozen=True)
class Album:
    """Figures of a page: PNGs by name in its order, for the files beside it."""

    pictures: dict[str, bytes] = field(default_factory=dict)

    def shown(self, what: ReportFigure, prefix: str = "", title: str = "", *, aside: bool = False) -> PageFigure:
        """Keep a figure under its name after `prefix`, and return it as the page has it."""
        name = prefix + what.name
        self.pictures[name] = what.png
        return PageFigure(name, what, title, aside)


def run_style(number: int) -> tuple[str, str]:
    """Return colour and dashes of a result by its number from 0."""
    return RUN_STYLES[number % len(RUN_STYLES)]


def drawn_figure(name: str, title: str, caption: str, alt: str, drawing: Drawing) -> ReportFigure:
    """Draw a figure for the page and again for a phone; the texts are those of `ReportFigure`."""
    pictures = []
    for narrow, width in ((False, PAGE_INCHES), (True, PHONE_INCHES)):
        with new_figure(width, drawing.height(width, narrow)) as figure:
            drawing.draw(figure, narrow)
            pictures.append(png_bytes(figure))
    size = round(PAGE_INCHES * DPI), round(drawing.height(PAGE_INCHES, False) * DPI)
    return ReportFigure(name, title, caption, alt, pictures[0], *size, phone_png=pictures[1], drawing=drawing)


@contextmanager
def new_figure(width: float, height: float) -> "Iterator[Figure]":
    """Make a figure of this size [inches] in the report's style, whatever the user's matplotlibrc says."""
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
        "grid.color": GRID,
        "agg.path.chunksize": 20_000,
    }
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        parameters: Any = matplotlib.rcParams
        parameters.update(settings)
        figure = Figure(figsize=(width, height), dpi=DPI, facecolor="white")
        FigureCanvasAgg(figure)
        yield figure


@dataclass(frozen=True)
class Panel:
    """One panel of a chart: title with unit, height [inches], what draws it, and names of its legend, if any."""

    title: str
    height: float
    draw: "Callable[[Axes], None]"
    names: Sequence[str] = ()


def chart(
    panels: Sequence[Panel],
    over_all: "Callable[[Sequence[Axes], bool], None] | None" = None,
    names: Mapping[str, tuple[str, str]] | None = None,
    least: float = 0.0,
) -> Drawing:
    """Return the drawing of panels, each below its title and its legend.

    Args:
        panels: In their order.
        over_all: What draws over all panels, laid out narrow or not, once they are drawn: they stand one below another
            over one x axis. None for panels with axes of their own, beside one another.
        names: Colour and mark by label, in a legend above all panels.
        least: Least width of a panel with its labels [inches].
    """

    def legend(labels: Sequence[str], width: float) -> tuple[list[str], int, float]:
        """Return labels cut to fit this width [inches], how many stand in a line, and the height of all lines."""
        most = max(2, int((width - SIGN) / LETTER))
        cut = [label if len(label) <= most else f"{label[: most - 1]}…" for label in labels]
        widths = [SIGN + LETTER * len(label) for label in cut] or [width]
        across = len(cut) if sum(widths) <= width else max(1, int(width / max(widths)))
        return cut, across, LEGEND_LINE * -(-len(cut) // max(across, 1))

    def placed(width: float, narrow: bool) -> tuple[list[tuple[float, float, float, float]], float]:
        """Return each panel's place: left, down, width and height of its legend; and the height of the whole."""
        across = 1 if over_all or narrow else max(1, min(len(panels), int(width / least)))
        share, below = width / across, 0.0 if over_all else BOTTOM
        down, places = TOP + legend(list(names or ()), width)[2], []
        for row in (panels[start : start + across] for start in range(0, len(panels), across)):
            heights = [legend(panel.names, share - LEFT)[2] for panel in row]
            down += TITLE + max(heights)
            places += [(k * share + LEFT, down, share - LEFT - RIGHT, height) for k, height in enumerate(heights)]
            down += max(panel.height for panel in row) + below
        return places, down + BOTTOM - below

    def draw(figure: "Figure", narrow: bool) -> None:
        from matplotlib.lines import Line2D

        width, height = (float(side) for side in figure.get_size_inches())
        drawn: list[Axes] = []
        for panel, (left, down, across, above) in zip(panels, placed(width, narrow)[0]):
            box = (left / width, 1.0 - (down + panel.height) / height, across / width, panel.height / height)
            axes = figure.add_axes(box, sharex=drawn[0] if over_all and drawn else None)
            drawn.append(axes)
            axes.grid(axis="y")
            axes.tick_params(length=3.0)
            axes.annotate(
                panel.title, (0.0, 1.0), (-72 * (LEFT - 0.06), 4 + 72 * above), xycoords="axes fraction",
                textcoords="offset points", fontweight="bold", va="bottom",
            )  # fmt: skip
            panel.draw(axes)
            if panel.names and (handles := axes.get_legend_handles_labels()[0]):
                of_all, columns, _ = legend(panel.names, across + RIGHT)
                axes.legend(handles, of_all, loc="lower left", ncols=columns, **LEGEND)
        if names:
            labels, columns, _ = legend(list(names), width)
            signs = [Line2D([], [], color=color, marker=mark, linewidth=1.2) for color, mark in names.values()]
            figure.legend(signs, labels, loc="upper left", ncols=columns, **LEGEND)
        if over_all:
            for axes in drawn[:-1]:
                axes.tick_params(labelbottom=False)
            over_all(drawn, narrow)

    return Drawing(draw, lambda width, narrow: placed(width, narrow)[1])


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
