"""`hhsim compare`."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Literal

from hhsim.table.table import Table

from .arguments.command import argument, make_command, option
from .arguments.options import JSON, Part, show


@make_command
def command(
    *,
    base: Path = argument("A"),
    head: Path = argument("B"),
    whole: bool = option(
        "Compare every figure; without it those that matter, and what is over a limit.", None, "--all"
    ),
    sides: Literal["right", "left", "right,left", "left,right"] | None = option(
        "Which hand of results of two; with a comma that of A and that of B.", None, "--hand"
    ),
    as_json: bool = JSON,
) -> None:
    """Set the figures of two results side by side.

    A and B are files that hhsim replay or hhsim live wrote. First stands what differs in input and options; figures of
    two scenes are shown, but not called better or worse. Differences as large as between equal runs are within noise
    (of hhsim replay --repeat: two standard deviations), and times of two machines are not compared.

    \b
    Examples:
      hhsim compare coupled.h5 progressive.h5
      hhsim compare before.h5 after.h5 --all
    """
    from hhsim.replay.compare import compare, compared
    from hhsim.replay.summary import stored_times
    from hhsim.replay.summary_table import short_table, whole_table
    from hhsim.replay.verdict import result_rows, verdict
    from hhsim.result.reader import load_hand

    of_a, _, of_b = (sides or "").partition(",")
    results = [load_hand(base, of_a), load_hand(head, of_b or of_a)]
    found = compare(*results)
    tables = [result_rows(result) for result in results]
    verdicts = [verdict(result, rows) for result, rows in zip(results, tables)]
    ours = {row.name: row for row in tables[0]}
    # A figure of one result alone is a difference too.
    either = {row.name for table in tables for row in whole_table(table)}
    shared = [row for row in tables[1] if row.name in ours and row.name in either]
    rows = [(ours[row.name], row, compared(ours[row.name], row, found)) for row in shared]
    lines = (f"{letter}: {path}: {each.line}" for letter, path, each in zip("AB", (base, head), verdicts))
    parts: list[Part] = [*lines, found.sentence()]
    for letter, result, table in zip("AB", results, tables):
        if result.repeated:
            kept = {row.name for row in short_table(table)}
            stored = [one for one in stored_times(result.repeated, table) if whole or one.row.name in kept]
            times = "; ".join(f"{one.row.label} {one.shown} {one.row.unit}" for one in stored)
            parts.append(f"times of {letter}, mean ± σ of {result.repeated['runs']} runs: {times}")
    for what, differences in (("run otherwise", found.how), ("around it", found.around)):
        if differences:
            parts.append(f"{what}: {'; '.join(differences)}")
    kept = {row.name for table, each in zip(tables, verdicts) for row in short_table(table, each.missed)}
    cells = [
        (one.label, one.shown, other.shown, one.unit, "" if math.isnan(its.ratio) else f"{its.ratio:.3g}", its.word)
        for one, other, its in rows
        if whole or other.name in kept
    ]
    headings = ("", "A", "B", "unit", "B/A", "B is")
    show(
        {
            "base": str(base),
            "head": str(head),
            "verdicts": [each.word for each in verdicts],
            "comparable": found.comparable,
            **{name: list(getattr(found, name)) for name in ("scene", "how", "around")},
            "figures": {
                one.name: {"base": one.value, "head": other.value, "ratio": its.ratio, "word": its.word or None}
                for one, other, its in rows
            },
        },
        *parts,
        "",
        replace(Table.of_cells(headings, cells, numbers=("A", "B", "B/A")), optional=("B/A",)),
        as_json=as_json,
    )
