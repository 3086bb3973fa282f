"""`hhsim bench manipulation`."""

from collections.abc import Callable, Mapping
from typing import Any

import click

from hhsim.system.counted import counted
from hhsim.table.table import Table, number, words

from ..arguments.comma_list import names
from ..arguments.option_group import OptionGroup, option
from ..arguments.options import Command, Output
from ..console import print_notes, print_table, progress
from .suite import SuiteTable, suite_options

Row = Mapping[str, Any]


class ManipulationSettings(OptionGroup):
    """Cases, and how long they last."""

    cases: tuple[str, ...] | None = names(
        "--case", "Cases: slope, rolling, flight, tipping, thresholds, torsion, held, rest, pinch. Default: all."
    )
    quick: bool = option(is_flag=True, help="A rest of 10 s and holds of 5 s, instead of 600 s and 60 s.")


@click.command(cls=Command)
@ManipulationSettings.argument("settings")
@Output.argument("output")
def command(settings: ManipulationSettings, output: Output) -> int:
    """Play free objects with friction whose answers are known: slopes, rolling, tipping, pinches, rest.

    Each line says what is exact and what was measured; exit code 1 where a figure of ours is off by more than 1 %, or
    than stated where the answer is 0. Pinch and rest are also played in MuJoCo, as it comes and tuned, where it is
    installed.

    \b
    Examples:
      hhsim bench manipulation --quick
      hhsim bench manipulation --case slope,thresholds
      hhsim bench manipulation --out manipulation.h5 --json
    """
    from hhsim.bench.manipulation.answers import COLUMNS, QUICK, ManipulationOptions, measure, missed, remarks

    run = suite_options(ManipulationOptions, "quick", QUICK, settings)
    table = SuiteTable(output, "manipulation", COLUMNS, run)
    with progress(quiet=output.quiet) as report:
        rows = measure(run, report)
    table.write(rows)
    wrong, notes = missed(rows), remarks()
    if table.is_for_people(rows=rows, missed=len(wrong), notes=notes):
        print_table(Table(SHOWN, rows))
        print()
        print(f"off by more than allowed: {counted(len(wrong), 'figure')}" if wrong else "every figure of ours holds")
        print_notes(notes)
        table.print_paths()
    return 1 if wrong else 0


def _figure(name: str) -> Callable[[Row], str]:
    def shown(row: Row) -> str:
        value, unit = float(row[name]), "" if row["unit"] == "1" else f" {row['unit']}"
        return "" if value != value else f"{value:.4g}{unit}"

    return shown


def _off(row: Row) -> str:
    if row["off"] != row["off"]:
        return "—"
    return f"{100.0 * row['off'] / row['exact']:+.2f} %" if row["exact"] else _figure("off")(row)


SHOWN = (
    *map(words, ("case", "method", "figure")),
    number("exact", _figure("exact")),
    number("measured", _figure("measured")),
    number("off by", _off),
    words("holds", lambda row: {1: "yes", 0: "NO"}.get(row["holds"], "")),
)
