"""The pictures of a report: each on the page, and as a file beside it."""

from hhsim.report.figure import ReportFigure
from hhsim.report.html import Html, figure, picture


class Album:
    """Keeps what it shows."""

    pictures: dict[str, bytes]
    """PNGs by name, in the order of the page."""

    def __init__(self) -> None:
        """Nothing is shown yet."""
        self.pictures = {}

    def shown(self, what: ReportFigure, prefix: str = "", label: str = "") -> Html:
        """A figure of the page; `prefix` goes before its name, `label` before its title."""
        name = prefix + what.name
        self.pictures[name] = what.png
        image = picture(what.png, what.alt, what.width_px, what.height_px, what.phone_png)
        return figure(f"figure-{name}", image, f"{label}: {what.title}" if label else what.title, what.caption)
