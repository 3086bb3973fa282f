"""The figures of `hhsim report`: what one is, and the style that all share.

Sizes are those on paper: a figure is as wide as the text of an A4 page, its text at least 9 pt there. Where a figure
has fine text, it is drawn a second time for a phone. Colours are told apart by the colour-blind too (Okabe and Ito,
"Color Universal Design", 2008). The same results give the same bytes.
"""

import io
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ORANGE, SKY, GREEN = "#e69f00", "#56b4e9", "#009e73"
BLUE, VERMILLION, PURPLE = "#0072b2", "#d55e00", "#cc79a7"

INK = "#24292f"
SOFT = "#57606a"
"""Of text beside the point; as dark as AA asks for on white."""
GRID = "#e4e7eb"
LIMIT = "#b00020"
"""Of the line of 1 ms."""
FINGER_COLORS = (VERMILLION, BLUE, GREEN, ORANGE, PURPLE)
"""Thumb to little finger."""
RUN_STYLES = (
    *zip((BLUE, VERMILLION, GREEN, PURPLE, ORANGE, SKY), ("-", "--") * 3),
    *zip((BLUE, VERMILLION, GREEN, PURPLE, ORANGE, SKY), ("--", "-") * 3),
)
"""Colour and dashes of the first, second, … result; then they begin anew. Where two coincide, the dashes of the second
show the first."""

BUDGET = 1e-3
"""Of a tick at 1 kHz [s]."""

LEAST_TIME = 1e-7
"""Shorter ticks are drawn at it [s]: a logarithm has no zero."""
LEFT = 0.6
"""Room [inches] for the labels of the y axes."""
PAGE_INCHES = 7.0
"""Of the text of an A4 page, across."""
PHONE_INCHES = 3.6
DPI = 200
TEXT = 9.0
"""Size of the smallest text [pt]."""
LETTER, SIGN = 0.075, 0.5
"""Room [inches] for a letter of a legend, and for a sign of it."""


@dataclass(frozen=True)
class Drawing:
    """How a figure is drawn at any width.

    Attributes:
        draw: Draws into a figure; told whether it is laid out narrow.
        height: Of a figure so many inches wide, laid out narrow or not [inches].
    """

    draw: "Callable[[Figure, bool], None]"
    height: Callable[[float, bool], float]


@dataclass(frozen=True, repr=False)
class ReportFigure:
    """One picture of a report.

    Attributes:
        name: For files and anchors: lower case, digits and hyphens.
        title: A few words.
        caption: What is drawn and how to read it, plain text, a few sentences.
        alt: What the picture says, for those who do not see it, plain text.
        width_px: Its columns [pixels].
        height_px: Its rows [pixels].
        phone_png: The same for a page that is narrow; None where `png` will do.
        drawing: How it is drawn again; None where it is a picture alone.
    """

    name: str
    title: str
    caption: str
    alt: str
    png: bytes
    width_px: int
    height_px: int
    phone_png: bytes | None = None
    drawing: Drawing | None = field(default=None, compare=False)

    def __repr__(self) -> str:
        return f"ReportFigure({self.name}, {self.width_px} x {self.height_px} pixels: {self.alt})"

    def _repr_png_(self) -> bytes:
        """What a notebook shows."""
        return self.png


@dataclass(frozen=True)
class PageFigure:
    """A figure as a page has it.

    Attributes:
        name: Of its anchor and its file.
        title: In the place of its own, without a caption; "" for its own with its caption.
        aside: Whether it stands beside another one, where the screen is wide.
    """

    name: str
    figure: ReportFigure
    title: str
    aside: bool


class Album:
    """The figures of a page: keeps what it shows, for the files beside it."""

    pictures: dict[str, bytes]
    """PNGs by name, in the order of the page."""

    def __init__(self) -> None:
        """Nothing is shown yet."""
        self.pictures = {}

    def shown(self, what: ReportFigure, prefix: str = "", title: str = "", *, aside: bool = False) -> PageFigure:
        """Keep a figure, and return it as the page has it; `prefix` goes before its name."""
        name = prefix + what.name
        self.pictures[name] = what.png
        return PageFigure(name, what, title, aside)


def run_style(number: int) -> tuple[str, str]:
    """Colour and dashes of a result by its number from 0."""
    return RUN_STYLES[number % len(RUN_STYLES)]


def drawn_figure(name: str, title: str, caption: str, alt: str, drawing: Drawing) -> ReportFigure:
    """A figure that is drawn for the page and again for a phone.

    Args:
        name, title, caption, alt: As of `ReportFigure`.
    """
    pictures = []
    for narrow, width in ((False, PAGE_INCHES), (True, PHONE_INCHES)):
        with new_figure(width, drawing.height(width, narrow)) as figure:
            drawing.draw(figure, narrow)
            pictures.append(png_bytes(figure))
    size = round(PAGE_INCHES * DPI), round(drawing.height(PAGE_INCHES, False) * DPI)
    return ReportFigure(name, title, caption, alt, pictures[0], *size, phone_png=pictures[1], drawing=drawing)


@contextmanager
def new_figure(width: float, height: float) -> "Iterator[Figure]":
    """A figure of so many inches in the style of the report, whatever the user's matplotlibrc says."""
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    settings: dict[str, Any] = {
        "font.size": TEXT,
        "axes.labelsize": TEXT,
        "axes.titlesize": TEXT,
        "legend.fontsize": TEXT,
        "xtick.labelsize": TEXT,
        "ytick.labelsize": TEXT,
        "text.color": INK,
        "axes.labelcolor": INK,
        "xtick.color": INK,
        "ytick.color": INK,
        "axes.edgecolor": SOFT,
        "axes.linewidth": 0.6,
        "xtick.major.width": 0.6,
        "ytick.major.width": 0.6,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.axisbelow": True,
        "grid.color": GRID,
        "grid.linewidth": 0.6,
        "legend.frameon": False,
        "agg.path.chunksize": 20_000,
    }
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        parameters: Any = matplotlib.rcParams
        parameters.update(settings)
        figure = Figure(figsize=(width, height), dpi=DPI, facecolor="white")
        FigureCanvasAgg(figure)
        yield figure


def png_bytes(figure: "Figure") -> bytes:
    """The figure as PNG, without a date or a version in it."""
    import numpy as np
    from PIL import Image

    canvas: Any = figure.canvas
    canvas.draw()
    buffer = io.BytesIO()
    # The smallest file would take five times as long to pack, and be smaller by 4 %.
    Image.fromarray(np.ascontiguousarray(np.asarray(canvas.buffer_rgba())[:, :, :3])).save(
        buffer, format="PNG", compress_level=6, dpi=(figure.dpi, figure.dpi)
    )
    return buffer.getvalue()


def gridded(axes: "Axes") -> None:
    """Faint lines at the ticks of the y axis."""
    axes.grid(axis="y")
    axes.tick_params(length=3.0)


def legend_names(labels: Sequence[str], room: float) -> tuple[list[str], int]:
    """Names for a legend, cut where a line of it could not hold them, and how many stand in a line.

    Args:
        room: Its width [inches].
    """
    most = max(2, int((room - SIGN) / LETTER))
    names = [label if len(label) <= most else f"{label[: most - 1]}…" for label in labels]
    longest = max(map(len, names), default=1)
    return names, max(1, min(len(names), int(room / (SIGN + LETTER * longest))))


def panel_title(axes: "Axes", text: str, up: float, left: float = LEFT - 0.06) -> None:
    """A title above a panel, so many points up and so many inches left of its corner."""
    axes.annotate(
        text, (0.0, 1.0), (-72 * left, up), xycoords="axes fraction", textcoords="offset points", fontweight="bold",
        va="bottom",
    )  # fmt: skip


def time_text(seconds: float) -> str:
    """A duration with the unit that suits it: "310 µs", "1.2 ms"."""
    if seconds < 1e-6:
        return f"{1e9 * seconds:.0f} ns"
    if seconds < BUDGET:
        # Of the nanosecond, so that a tie is rounded alike whatever unit the time came in.
        micro = round(1e6 * seconds, 3)
        return f"{micro:.0f} µs" if micro >= 100.0 else f"{micro:.1f} µs"
    return f"{1e3 * seconds:.3g} ms" if seconds < 1.0 else f"{seconds:.3g} s"
