"""Ticks of a result as a CSV table: a line a tick, units in the heading."""

import csv
import itertools
from collections.abc import Sequence
from pathlib import Path

from hhsim.errors import OutputError, UnknownNameError
from hhsim.result.labelled import SIZES, sizes, tick_columns
from hhsim.result.reader import CHUNK_TICKS, Result
from hhsim.system.atomic_write import partial_file
from hhsim.system.output_path import begins_with, check_output_path
from hhsim.system.progress import Progress, silent

USUAL = (
    *("time", "input_seq", "haptic/position", "graphic/position", "force/total", "force/size", "force/finger"),
    "force_variation_rate",
    *("penetration_depth", "contacts/candidates", "contacts/touching"),
    *("duration/total_cpu", "duration/total", "status", "lag"),
)
"""Datasets written by default."""
ALL = "all"
SUFFIX = ".csv"


def export_ticks(
    result: Result, path: Path, columns: Sequence[str] | None = None, progress: Progress = silent
) -> tuple[str, ...]:
    """Write datasets of every tick and return the headings, each with index and unit.

    Args:
        result: Complete or not.
        path: The table; an existing one is replaced when the new one is complete.
        columns: Names of datasets of the hand at the ticks, of `SIZES`, of live/tick of a session, of bodies at the
            ticks; or `all`. None for the usual ones.

    Raises:
        UnknownNameError: No such dataset.
        OutputError: It cannot be written there, the name does not end in .csv, or another file is there.
    """
    if path.suffix.lower() != SUFFIX:
        raise OutputError(f"{path} is no name for a table: it has to end in {SUFFIX}")
    check_output_path(path, "table of ticks", begins_with(b"tick,"))
    known = tick_columns(result)
    wanted = tuple(known) if columns and ALL in columns else tuple(columns or USUAL)
    for name in wanted:
        if name not in known:
            raise UnknownNameError("dataset", name, known)
        headings: list[str] = []
    for column in (known[name] for name in wanted):
        unit = "" if column.units in ("", "1") else f" [{column.units}]"
        for index in itertools.product(*(range(size) for size in column.shape)):
            place = f"[{','.join(map(str, index))}]" if index else ""
            headings.append(f"{column.name}{place}{unit}")
    try:
        with partial_file(path) as partial, partial.open("w", encoding="utf-8", newline="") as file:
            table = csv.writer(file, lineterminator="\n")
            table.writerow(("tick", *headings))
            first = 0
            needed = tuple(dict.fromkeys(SIZES[name][1] if name in SIZES else name for name in wanted))
            for block in result.blocks(needed, CHUNK_TICKS):
                progress("ticks", first, result.ticks)
                # As Python's numbers: they are written with as many digits as give the same number back.
                values = [sizes(block[SIZES[name][1]]) if name in SIZES else block[name] for name in wanted]
                flat = [each.reshape(len(each), -1).tolist() for each in values]
                table.writerows([tick, *itertools.chain(*row)] for tick, row in enumerate(zip(*flat), start=first))
                first += len(flat[0])
    except OSError as error:
        raise OutputError(f"cannot write {path}: {error.strerror or error}") from error
    return tuple(headings)
