"""`hhsim board`."""

from dataclasses import asdict
from pathlib import Path

import click

from .arguments import options
from .console import print_json, print_line, print_rows, progress


@click.command()
@click.argument("folders", metavar="FOLDER...", nargs=-1, required=True, type=options.FILE)
@click.option(
    "--out",
    "outputs",
    type=options.FILE,
    multiple=True,
    metavar="FILE",
    help="Write the board too, by the name's ending: .html, a page that sorts and filters; .csv or .parquet, each run "
    "a row with every figure; .md; .tex, a tabular to \\input. May be given several times.",
)
@click.option("--all", "whole", is_flag=True, help="Print each run as well.")
@options.json
@options.quiet
def command(folders: tuple[Path, ...], outputs: tuple[Path, ...], whole: bool, as_json: bool, quiet: bool) -> None:
    """Set results of sweeps and machines side by side, in one table.

    FOLDER is one of hhsim sweep, or any that holds results, of replays or submissions. Runs of the same object, motion,
    method, surface and options are one line for each machine, the last one of several. Marked are those that no faster
    one equals in every error.

    \b
    Examples:
      hhsim board results/first
      hhsim board results/first /media/other/first --out board.html --out board.csv
    """
    from hhsim.board.collect import collect
    from hhsim.board.shown import LEGEND, WORDS, entry_cells, said_of, standing_cells
    from hhsim.board.standings import standings
    from hhsim.board.table_file import check_board_path, content_of, rows_of
    from hhsim.system.atomic_write import write_atomically

    for path in outputs:
        check_board_path(path)
    with progress(quiet=quiet) as report:
        board = collect(folders, report)
        found = standings(board)
        for path in outputs:
            write_atomically(path, content_of(path, board, found))
    if as_json:
        print_json(
            {
                "standings": [{**asdict(one), "machine": board.machines[one.machine]} for one in found],
                "runs": rows_of(board),
                "notes": list(board.notes),
            }
        )
        return
    if quiet:
        return
    thin = ("stuck", "over optimum [%]", "p99 [µs]", "machine", "touched")
    print_rows(standing_cells(board), found, words=WORDS, optional=thin)
    if whole:
        print()
        print_rows(entry_cells(board), [*board.entries, *board.failed], words=WORDS, optional=("force [N]", *thin))
    print()
    print_line(LEGEND)
    for said in said_of(board):
        print_line(said)
    for path in outputs:
        print_line(f"written: {path}")
