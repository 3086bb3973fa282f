"""`hhsim bench paper`."""

import math
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from .. import options
from ..console import announce_compilation, print_json, print_table, progress
from ..name_list import names

if TYPE_CHECKING:
    from hhsim.bench.paper.table import PaperRow

SCALES = {"s": (1e6, "µs"), "m": (1e6, "µm"), "%": (1.0, "%"), "1": (1.0, "")}


@click.command()
@names("--method", "methods", "Methods. Default: paper,progressive,coupled.")
@names("--object", "objects", "Only these objects. Default: all ten.")
@click.option("--quick", is_flag=True, help="Every row, from coarse spheres, 3 instances and one repetition.")
@click.option(
    "--instances", type=click.IntRange(1), metavar="N", help="Instances of each case of Fig. 15. Default: 100."
)
@click.option("--repetitions", type=click.IntRange(1), metavar="N", help="Repetitions of every run. Default: 3.")
@click.option(
    "--plot",
    type=click.Path(path_type=Path),
    metavar="FOLDER",
    help="Draw the scenes and curves in the manner of the paper's Figs. 11 to 15 into a folder.",
)
@options.seed
@options.out
@options.json
@options.quiet
def command(
    methods: tuple[str, ...] | None,
    objects: tuple[str, ...] | None,
    quick: bool,
    instances: int | None,
    repetitions: int | None,
    plot: Path | None,
    seed: int,
    out: Path | None,
    as_json: bool,
    quiet: bool,
) -> int:
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
    from hhsim.bench.paper.bench import PaperOptions, measure
    from hhsim.bench.paper.table import ROW_COLUMNS, SCENE_COLUMNS, missed, paper_rows, scene_rows
    from hhsim.bench.table import check_table_path, csv_path, write_table
    from hhsim.system.output_path import dated_output_path

    named = {"methods": methods, "objects": objects, "instances": instances, "repetitions": repetitions}
    usual = PaperOptions.quick() if quick else PaperOptions()
    run = replace(usual, seed=seed, **{name: value for name, value in named.items() if value is not None})  # type: ignore[arg-type]
    output_path = out or dated_output_path("bench-paper")
    scenes = output_path.with_name(f"{output_path.stem}-scenes{output_path.suffix}")
    for path in (output_path, scenes):
        check_table_path(path)
    if plot is not None:
        from hhsim.render.paper_figures import check_folder

        check_folder(plot)
    announce_compilation(quiet=quiet)
    with progress(quiet=quiet) as report:
        runs = measure(run, report)
        rows, played = paper_rows(runs, run), scene_rows(runs)
        write_table(output_path, "paper", ROW_COLUMNS, [row.to_json() for row in rows], asdict(run))
        write_table(scenes, "paper", SCENE_COLUMNS, played, asdict(run))
        pictures: list[Path] = []
        if plot is not None:
            from hhsim.render.paper_figures import draw_all

            pictures = draw_all(plot, runs, report)
    failed = missed(rows)
    if as_json:
        print_json(
            {
                "table": str(output_path),
                "csv": str(csv_path(output_path)),
                "scenes_table": str(scenes),
                "pictures": [str(picture) for picture in pictures],
                "options": asdict(run),
                "units": {column.name: column.unit for column in SCENE_COLUMNS},
                "passed": not failed,
                "missed": [row.to_json() for row in failed],
                "rows": [row.to_json() for row in rows],
                "scenes": played,
            }
        )
    elif not quiet:
        _print_rows(rows, run.methods)
        _print_cases(played)
        for row in failed:
            print(f"missed: {row.label}, {row.method}: {_shown(row.ours, row.unit)}, bar {_shown(row.bar, row.unit)}")
        if not failed:
            print("every bar is kept by the methods that promise to")
        print(f"the tables are in {output_path}, {scenes} and .csv files beside them")
        if pictures:
            print(f"{len(pictures)} pictures are in {plot}")
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
    numbers = [heading for method in methods for heading in (method, "×")]
    print_table(
        ("figure", "what", "the paper", *numbers, "our bar"),
        cells,
        title="The paper's figures and ours, and how many times (×) ours is below; times are CPU times of one thread",
        numbers=(*numbers, "our bar"),
    )
    print()
    last = rows[-1].method
    print_table(
        ("what", "how it was measured"),
        [(row.label, row.note) for row in rows if row.method == last],
        title=f"How ({last})",
    )
    print()


def _print_cases(played: list[dict[str, Any]]) -> None:
    numbers = ("instances", "contacts", "detection [µs]", "response [µs]", "total, CPU [µs]", "p99 [µs]")
    cells = [
        (
            row["object"],
            row["case"],
            row["method"],
            f"{row['instances']}",
            f"{row['contacts_mean']:,.0f}",
            *(f"{1e6 * row[name]:.1f}" for name in ("detection", "response", "cpu_mean", "cpu_p99")),
        )
        for row in played
        if row["figure"] == "15"
    ]
    if cells:
        title = "Fig. 15: a tick in contact, mean; its parts by the clock on the wall, where nothing interrupted it"
        print_table(("object", "case", "method", *numbers), cells, title=title, numbers=numbers)
        print()


def _shown(value: float, unit: str) -> str:
    if math.isnan(value):
        return "—"
    scale, name = SCALES[unit]
    digits = 0 if unit == "1" else 1 if unit == "s" else 3
    return f"{round(scale * value, digits) + 0.0:,.{digits}f} {name}".rstrip()
