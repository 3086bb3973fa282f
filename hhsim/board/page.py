"""The board as one HTML page that asks nobody for anything: its tables sort at a click and filter by words."""

from collections.abc import Sequence
from pathlib import Path

from hhsim import __version__
from hhsim.board.collect import Board
from hhsim.board.shown import entry_table, standing_table
from hhsim.board.standings import Standing
from hhsim.system.counted import counted
from hhsim.table.html import render


def board_page(board: Board, standings: Sequence[Standing]) -> str:
    """Return the document: the standings, then each run."""
    return render(
        "board/board.html",
        title=f"Board of {counted(len(board.entries), 'run')}",
        generator="hhsim board",
        version=__version__,
        script=Path(__file__).with_name("board.js").read_text(encoding="utf-8"),
        standings=standing_table(board, standings),
        runs=entry_table(board),
    )
