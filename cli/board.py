"""`hhsim board`."""

from dataclasses import asdict
from pathlib import Path

import click

from .arguments import options
from .console import print_json, print_line, print_table, progress


@click.command(cls=options.Command)
@click.argument("folders", metavar="FOLDER...", nargs=-1, required=True, type=options.FILE)
@click.option(
    "--out",
    "outputs",
    type=options.OUTPUT,
    multiple=True,
    metavar="FILE",
    help="Also write the board, by the name's ending: .html, .csv, .md or .tex; may be given several times.",
)
@click.option("--all", "whole", is_flag=True, help="Also print each run.")
@options.Printing.argument("printing")
def command(folders: tuple[Path, ...], outputs: tuple[Path, ...], whole: bool, printing: options.Printing) -> None:
    """Set results of sweeps and machines side by side, in one table.

    FOLDER is one of hhsim sweep, or any that holds results, of replays or submissions. Runs of the same object, motion,
    method, surface and options are one line for each machine, the last one of several. Marked are those that no faster
    one equals in every error.

    \b
    Examples:
      hhsim board results/first
      hhsim board results/first /media/other/first --out board.html --out board.csv
    """
    from hhsim.board.entry import collect
    from hhsim.board.standings import standings
    from hhsim.board.table_file import check_board_path, content_of, entry_table, run_table, standing_table
    from hhsim.system.atomic_write import write_atomically

    for path in outputs:
        check_board_path(path)
    with progress(quiet=printing.quiet) as report:
        board = collect(folders, report)
        found = standings(board)
        for path in outputs:
            write_atomically(path, content_of(path, board, found))
    if printing.as_json:
        print_json(
            {
                "standings": [{**asdict(one), "machine": board.machines[one.machine]} for one in found],
                "runs": run_table(board).records,
                "notes": list(board.notes),
            }
        )
        return
    if printing.quiet:
        return
    thin = ("stuck", "over optimum [%]", "p99 [µs]", "machine", "touched")
    shown = standing_table(board, found)
    print_table(shown, optional=thin)
    if whole:
        print()
        print_table(entry_table(board), optional=("force [N]", *thin))
    print()
    for note in shown.notes:
        print_line(note)
    for path in outputs:
        print_line(f"written: {path}")
