"""The standings as a LaTeX table that a paper takes in by `\\input`; it needs no package."""

import re
from collections.abc import Sequence

from hhsim.board.collect import Board
from hhsim.board.shown import MARK, WORDS, shown_standings
from hhsim.board.standings import Standing

LETTERS = str.maketrans(
    {
        **{letter: f"\\{letter}" for letter in "{}$&#_%"},
        # After a line's end a star or a bracket would belong to it.
        **{letter: f"{{{letter}}}" for letter in "*["},
        "\\": r"\textbackslash{}",
        "~": r"\textasciitilde{}",
        "^": r"\textasciicircum{}",
        "<": r"\textless{}",
        ">": r"\textgreater{}",
        "|": r"\textbar{}",
        '"': "''",
        "µ": r"$\mu$",
        "±": r"$\pm$",
        "—": r"\textemdash{}",
        MARK: r"$\bullet$",
    }
)


def escaped(text: str) -> str:
    """A text that LaTeX prints letter by letter."""
    # Hyphens that follow each other would become a dash.
    return re.sub("-(?=-)", "-{}", " ".join(text.split()).translate(LETTERS))


def latex_text(board: Board, standings: Sequence[Standing]) -> str:
    r"""The standings as a tabular with \hline; what there is to say of it stands above as comments, for a caption."""
    headings, rows, notes = shown_standings(board, standings)
    columns = "".join("l" if heading in WORDS else "r" for heading in headings)
    lines = [f"% {' '.join(note.split())}" for note in notes]
    lines += [f"\\begin{{tabular}}{{{columns}}}", r"\hline", _line(headings), r"\hline"]
    return "\n".join([*lines, *(_line(row) for row in rows), r"\hline", r"\end{tabular}", ""])


def _line(cells: Sequence[str]) -> str:
    # A number's hyphen is a minus.
    return " & ".join(re.sub(r"^-(?=\d)", "$-$", escaped(cell)) for cell in cells) + r" \\"
