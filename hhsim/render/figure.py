"""A matplotlib figure that is drawn without a screen, the style of its axes, and its file."""

import io
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from hhsim.errors import InputError
from hhsim.system.atomic_write import write_atomically

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


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


def halo(width: float) -> dict[str, Any]:
    """Return the options of a text with a white rim of this width [pt]."""
    from matplotlib.patheffects import withStroke

    return {"path_effects": [withStroke(linewidth=width, foreground="white")]}


def png_bytes(figure: "Figure", colors: int | None = None) -> bytes:
    """Return the figure as PNG, without a date or a version in it, in true colour or a palette of so many colours."""
    from PIL import Image

    canvas: Any = figure.canvas
    canvas.draw()
    buffer = io.BytesIO()
    # The highest compression takes five times as long and saves 4 %.
    image = Image.fromarray(np.ascontiguousarray(np.asarray(canvas.buffer_rgba())[:, :, :3]))
    if colors is not None:
        image = image.quantize(colors, method=Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
    image.save(buffer, format="PNG", compress_level=6, dpi=(figure.dpi, figure.dpi))
    return buffer.getvalue()


def save_figure(figure: "Figure", path: Path, colors: int | None = None) -> None:
    """Write a figure in the format of the file's ending; OutputError if it cannot be, InputError for another format.

    A PDF and an SVG have the file's name as their title; `colors` are of a PNG's palette.
    """
    import matplotlib

    kind, buffer = path.suffix.lower()[1:], io.BytesIO()
    if kind == "png":
        write_atomically(path, png_bytes(figure, colors))
        return
    # No date: the same figure gives the same bytes. Journals ask for letters that a reader of PDF can tell apart;
    # without a salt the SVG's clipping paths have random names.
    date = {"pdf": "CreationDate", "svg": "Date"}.get(kind)
    about = {"Title": path.stem, "Creator": "hhsim report", date: None} if date else None
    try:
        with matplotlib.rc_context(cast(Any, {"pdf.fonttype": 42, "svg.hashsalt": "hhsim report"})):
            figure.savefig(buffer, format=kind, metadata=cast(Any, about))
        write_atomically(path, buffer.getvalue())
    except ValueError as error:
        raise InputError(f"{path}: {error}") from error
