"""`hhsim replay RESULT`: the ticks of a result or a session once more, and whether its arrays are the same."""

import math
from pathlib import Path
from typing import TYPE_CHECKING

import click
from click.core import ParameterSource

from hhsim.table.table import Table

from .console import print_json, print_line, print_notes, print_table, progress

if TYPE_CHECKING:
    from hhsim.replay.repeat import RunAgain

TAKEN = ("object_", "as_json", "quiet", "trust")
"""Parameters of `hhsim replay` that a second run may have."""


def names_a_result(name: str | Path) -> bool:
    """Return whether an argument is a result, and not an object, a suite or a baseline."""
    from hhsim.result.schema import SUFFIXES

    return Path(name).suffix.lower() in SUFFIXES


def run_again(context: click.Context, path: Path, *, as_json: bool, quiet: bool, trust: bool) -> int:
    """Run the ticks of a result again and print the comparison; return 1 where something differs beyond rounding."""
    for parameter in context.command.params:
        name = parameter.name or ""
        if name in TAKEN or context.get_parameter_source(name) in (ParameterSource.DEFAULT, None):
            continue
        if isinstance(parameter, click.Argument):
            raise click.UsageError(f"{path} runs again with the motion that it holds: it takes no TRAJECTORY")
        if name == "rerun":
            raise click.UsageError(f"{path} holds its ticks already: hhsim view {path} shows them")
        raise click.UsageError(
            f"{path} runs again as it was, so {parameter.opts[0]} has no place here; to replay its motion otherwise, "
            f"give an object first: hhsim replay OBJECT {path}"
        )
    from hhsim.replay.repeat import run_again as run
    from hhsim.result.reader import load_result

    with progress(quiet=quiet) as report:
        again = run(load_result(path), trust=trust, progress=report)
    if as_json:
        print_json(again.to_json())
    elif not quiet:
        _print(again)
    elif not again.identical:
        print_notes([f"{again.path} is run again: {again.sentence}"], prefix="note" if again.same else "missed")
    return 0 if again.same else 1


def _print(again: "RunAgain") -> None:
    same = sum(array.identical for array in again.arrays)
    title = f"{again.path}: {again.ticks:,} ticks run again, {same} of {len(again.arrays)} arrays identical"
    columns = ("array", "is", "ticks that differ", "first", "largest difference", "bound", "unit")
    numbers = ("ticks that differ", "first", "largest difference", "bound")
    rows = []
    for array in again.arrays:
        found = ("", "", "")
        if not array.identical:
            found = (f"{array.ticks:,}", f"{array.first_tick:,}", f"{array.largest:.3g}")
        bound = "none" if math.isinf(array.bound) else f"{array.bound:g}"
        rows.append((array.name, array.word, *found, bound, array.units))
    print_table(Table.of_cells(columns, rows, title, numbers=numbers))
    for note in again.notes:
        print_line(f"note: {note}")
    print_line(again.sentence)
