"""A matplotlib figure that is drawn without a screen, the look that its axes share, and its file."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from hhsim.errors import InputError, OutputError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def new_figure(width: float, height: float, **options: Any) -> "Figure":
    """An empty white figure of this size [inches], 100 pixels to the inch; `options` are matplotlib's."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=100, facecolor="white", **options)
    FigureCanvasAgg(figure)
    return figure


def tidy(axes: "Axes") -> None:
    """Faint grid lines behind what is drawn, and no frame above and on the right."""
    axes.grid(color="0.92", linewidth=0.8)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def save_figure(figure: "Figure", path: Path) -> None:
    """Write a matplotlib figure.

    Raises:
        OutputError: The picture cannot be written.
        InputError: matplotlib has no such picture format.
    """
    try:
        figure.savefig(path)
    except OSError as error:
        raise OutputError(f"{path}: cannot write the picture: {error.strerror or error}") from error
    except ValueError as error:
        raise InputError(f"{path}: {error}") from error
