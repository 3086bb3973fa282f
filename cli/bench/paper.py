"""`hhsim bench paper`."""

import math
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from hhsim.system.counted import counted
from hhsim.table.table import MISSING, Table, number, shown, unit_size, words

from ..arguments import options
from ..arguments.comma_list import names
from ..arguments.option_group import OptionGroup, option, shared
from ..arguments.options import COUNT
from ..console import print_json, print_line, print_table, progress
from .suite import SuiteTable, quick_note, suite_options

if TYPE_CHECKING:
    from hhsim.bench.paper.table import PaperRow

SHOWN_UNITS = {"s": ("µs", 1), "m": ("µm", 3), "%": ("%", 3), "1": ("", 0)}
"""Unit and digits that are printed, by the stored unit of a figure."""


UNJUDGED = (
    "index force and named touches have no bar here: scenes are placed on the paper's tree levels, and medians are of "
    "the holds of all objects"
)


class PaperSettings(OptionGroup):
    """Methods, objects and repetitions."""

    methods: tuple[str, ...] | None = names("--method", "Methods. Default: paper,progressive,coupled.")
    objects: tuple[str, ...] | None = names("--object", "Only these objects. Default: all ten.")
    quick: bool = option(is_flag=True, help="Every row, from coarse spheres, 3 instances and one repetition.")
    instances: int | None = option(type=COUNT, metavar="N", help="Instances of each case of Fig. 15. Default: 100.")
    repetitions: int | None = option(type=COUNT, metavar="N", help="Repetitions of every run. Default: 3.")
    threads: int | None = option(
        type=click.IntRange(1, 5), metavar="N", help="Threads that share a tick of progressive. Default: 1."
    )
    seed: int = shared(options.seed)


@click.command(cls=options.Command)
@PaperSettings.argument("settings")
@click.option(
    "--plot",
    type=options.OUTPUT,
    metavar="FOLDER",
    help="Draw the scenes and curves in the manner of the paper's Figs. 11 to 15 into a folder, as PNG, PDF and SVG.",
)
@options.Output.argument("output")
def command(settings: PaperSettings, plot: Path | None, output: options.Output) -> int:
    """Run the paper's whole evaluation, its figures beside ours.

    All scenes of Figs. 11 to 15 by every method: one finger, two, five and the palm on five simple objects; fingers
    that come and go; sliding; five complex objects from several sides, such as the thumb in the cup's handle; 100
    instances of each case of Fig. 15. A row that misses one of our own bars is named, and the exit code is 1; the
    method paper is the baseline and has none, and with --quick or --object only those of time and depth hold. A
    second table, -scenes, has a line for every scene.

    \b
    Examples:
      hhsim bench paper
      hhsim bench paper --plot figures --out paper.h5
      hhsim bench paper --quick --method coupled
    """
    from hhsim.bench.paper.bench import QUICK, PaperOptions, measure
    from hhsim.bench.paper.table import ROW_COLUMNS, SCENE_COLUMNS, missed, paper_rows
    from hhsim.bench.table import check_table_path, table_document, write_table

    run = suite_options(PaperOptions, "quick", QUICK, settings)
    table = SuiteTable(output, "paper", ROW_COLUMNS, asdict(run))
    scenes = table.path.with_name(f"{table.path.stem}-scenes{table.path.suffix}")
    check_table_path(scenes)
    if plot is not None:
        from hhsim.render.paper_figures import check_folder

        check_folder(plot)
    with progress(quiet=output.quiet) as report:
        runs = measure(run, report)
        rows, played = paper_rows(runs, run), Table(SCENE_COLUMNS, runs.scenes).records
        table.write(Table(ROW_COLUMNS, rows).records)
        write_table(scenes, "paper", SCENE_COLUMNS, played, asdict(run))
        pictures: list[Path] = []
        if plot is not None:
            from hhsim.render.paper_figures import draw_all

            pictures = draw_all(plot, runs, report, quick_note(settings))
    failed = missed(rows)
    if output.as_json:
        written = {"scenes_table": str(scenes), "pictures": [str(picture) for picture in pictures]}
        document = table_document(table.path, SCENE_COLUMNS, asdict(run), **written)
        missing, whole = (Table(ROW_COLUMNS, some).records for some in (failed, rows))
        print_json({**document, "passed": not failed, "missed": missing, "rows": whole, "scenes": played})
    elif not output.quiet:
        _print_rows(rows, run.methods)
        _print_cases(played)
        for row in failed:
            print(f"missed: {row.label}, {row.method}: {_shown(row.ours, row.unit)}, bar {_shown(row.bar, row.unit)}")
        if not failed:
            print("every bar is kept by the methods that promise to")
            if not run.whole:
                print_line(UNJUDGED)
        print(f"the tables are in {table.path}, {scenes} and .csv files beside them")
        if pictures:
            print(f"{counted(len(pictures), 'picture')} written to {plot}")
    return 1 if failed else 0


def _print_rows(rows: "list[PaperRow]", methods: tuple[str, ...]) -> None:
    """One line a figure; for each method the figure, and how many times it is below the paper's."""
    names = list(dict.fromkeys(row.name for row in rows))
    cells = []
    for name in names:
        same = {row.method: row for row in rows if row.name == name}
        first = next(iter(same.values()))
        line = [first.figure, first.label, first.paper_text]
        for method in methods:
            row = same[method]
            ratio = "" if not math.isfinite(row.ratio) or row.unit == "1" else f"{row.ratio:,.1f}"
            line += [_shown(row.ours, row.unit), ratio]
        bar = next((row.bar for row in same.values() if not math.isnan(row.bar)), math.nan)
        cells.append((*line, "" if math.isnan(bar) else _shown(bar, first.unit)))
    numbers = [*(heading for method in methods for heading in (method, "×")), "our bar"]
    title = "The paper's figures and ours, and how many times (×) ours is below; times are CPU times of one thread"
    print_table(Table.of_cells(("figure", "what", "printed in the paper", *numbers), cells, title, numbers=numbers))
    print_line("our bar: the most that ends with exit code 0; blank where we set none, or not for these options")
    print()
    last = rows[-1].method
    how = words("what", "label"), words("how it was measured", "note")
    print_table(Table(how, [row for row in rows if row.method == last], f"How ({last})"))
    print()


def _print_cases(played: list[dict[str, Any]]) -> None:
    columns = (
        *map(words, ("object", "case", "method")),
        number("instances"),
        number("pairs", "contacts_mean"),
        number("detection", "detection", "µs", 1),
        number("response", "response", "µs", 1),
        number("total, CPU", "cpu_mean", "µs", 1),
        number("p99", "cpu_p99", "µs", 1),
    )
    rows = [row for row in played if row["figure"] == "15"]
    if rows:
        title = (
            "Fig. 15: a tick in contact, mean; its parts by the clock on the wall, where nothing interrupted it. SF: "
            "single finger, TF: two fingers, FF: five fingers, WH: whole hand"
        )
        print_table(Table(columns, rows, title))
        print()


def _shown(value: float, unit: str) -> str:
    name, digits = SHOWN_UNITS[unit]
    return f"{shown(value / unit_size(name), digits)} {name}".rstrip() if value == value else MISSING
