"""The figures of `hhsim report`: what one is, and the style that all share.

Sizes are those on paper: a figure is as wide as the text of an A4 page, its text at least 9 pt there. Colours are told
apart by the colour-blind too (Okabe and Ito, "Color Universal Design", 2008). The same results give the same bytes.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from hhsim.result import Result


@dataclass(frozen=True)
class ReportFigure:
    """One picture of a report.

    Attributes:
        name: for files and anchors: lower case, digits and hyphens.
        title: a few words.
        caption: what is drawn and how to read it, plain text, a few sentences.
        alt: what the picture says, for those who do not see it, plain text.
        png: the picture.
        width_px: its columns [pixels].
        height_px: its rows [pixels].
    """

    name: str
    title: str
    caption: str
    alt: str
    png: bytes
    width_px: int
    height_px: int


def run_labels(results: Sequence[Result], labels: Sequence[str] = ()) -> tuple[str, ...]:
    """A name for each result: those given, or else the files' stems."""
    return tuple(labels) if labels else tuple(result.path.stem for result in results)
