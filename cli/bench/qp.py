"""`hhsim bench qp`."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from .. import options
from ..console import announce_compilation, print_json, print_notes, print_table, progress
from ..name_list import names

if TYPE_CHECKING:
    from hhsim.bench.qp.bench import QpBench


@click.command()
@click.option(
    "--problems",
    type=click.IntRange(1),
    default=100_000,
    show_default=True,
    metavar="N",
    help="Programs of real ticks to take.",
)
@click.option(
    "--per-set",
    type=click.IntRange(1),
    default=200,
    show_default=True,
    metavar="N",
    help="Programs of each degenerate set and number of variables.",
)
@click.option(
    "--per-size",
    type=click.IntRange(1),
    default=100,
    show_default=True,
    metavar="N",
    help="Programs of each size that is timed.",
)
@names("--object", "objects", "Objects of the ticks. Default: sphere,cube,rock,cup,teapot,bunny.")
@names(
    "--motion",
    "motions",
    "Motions of the ticks; random: random targets. Default: grasp,pinch,whole-hand,slide,random.",
)
@names("--qp", "backends", "QP solvers beside ours. Default: all that are installed.")
@click.option(
    "--patience",
    type=click.FloatRange(0.0),
    default=5.0,
    show_default=True,
    metavar="S",
    help="Seconds that another solver may spend on a set or a size; the rest it skips.",
)
@options.seed
@options.out
@options.json
@options.quiet
def command(
    problems: int,
    per_set: int,
    per_size: int,
    objects: tuple[str, ...] | None,
    motions: tuple[str, ...] | None,
    backends: tuple[str, ...] | None,
    patience: float,
    seed: int,
    out: Path | None,
    as_json: bool,
    quiet: bool,
) -> int:
    """Solve the programs of real ticks, and degenerate ones, by every solver at hand.

    First our solver on programs taken from replays and random targets, every answer checked from the program alone;
    then every solver on the sets that are known to hurt; then all of them side by side on the same programs, each by
    its best native call. More solvers: pip install 'hhsim[solvers]'. The exit code is 1 where ours fails a program.

    \b
    Examples:
      hhsim bench qp
      hhsim bench qp --problems 2000 --qp daqp,quadprog --out qp.h5
    """
    from dataclasses import asdict

    from hhsim.bench.qp.bench import COLUMNS, QpBenchOptions, bench_qp, check_names
    from hhsim.bench.qp.recorded_problems import MOTIONS, OBJECTS
    from hhsim.bench.table import check_table_path, write_table
    from hhsim.system.output_path import dated_output_path

    chosen = QpBenchOptions(
        problems=problems,
        per_set=per_set,
        per_size=per_size,
        objects=objects or OBJECTS,
        motions=motions or MOTIONS,
        backends=backends,
        patience=patience,
        seed=seed,
    )
    check_names(chosen)
    output_path = out or dated_output_path("bench-qp")
    check_table_path(output_path)
    announce_compilation(quiet=quiet)
    with progress(quiet=quiet) as report:
        bench = bench_qp(chosen, report)
    write_table(output_path, "qp", COLUMNS, bench.rows, asdict(chosen))
    if as_json:
        print_json(
            {
                "options": asdict(chosen),
                "rows": bench.rows,
                "harvest": bench.harvested,
                "nearest": bench.nearest,
                "versions": bench.versions,
                "absent": bench.absent,
                "failures": bench.failures,
                "path": str(output_path),
            }
        )
    elif not quiet:
        _print(bench)
        print(f"all of it is in {output_path} and beside it as CSV")
    print_notes(bench.failures, prefix="missed")
    return 1 if bench.failures else 0


def _print(bench: "QpBench") -> None:
    harvested = [row for row in bench.rows if row["part"] == "harvest"]
    headings = ("program", "solver", "programs", "rows", "solved", "proved infeasible", "missed", "KKT p99", "KKT max")
    print_table(
        (*headings, "iterations"),
        [
            (
                row["case"],
                row["backend"],
                f"{row['problems']:,}",
                f"{row['rows']:.0f}",
                f"{row['solved']:,}",
                f"{row['refused']:,}",
                f"{row['problems'] - row['solved'] - row['refused']:,}",
                _residual(row["residual_p99"]),
                _residual(row["residual_max"]),
                f"{row['iterations']:.1f}",
            )
            for row in harvested
        ],
        title="programs of real ticks",
        numbers=(*headings[2:], "iterations"),
    )
    _print_harvest(bench.harvested)
    print()
    _print_degenerate([row for row in bench.rows if row["part"] == "degenerate"])
    print()
    _print_times([row for row in bench.rows if row["part"] == "time"])
    _print_nearest(bench)


def _print_harvest(harvested: dict[str, Any]) -> None:
    print(
        "KKT residuals are in sizes of the program; "
        f"{harvested['proved_infeasible']:,} programs are proved to contradict themselves, "
        f"{harvested['linear_programs']:,} of them looked at by a linear program too, "
        f"{harvested['linear_program_denies']:,} denied"
    )
    if harvested["compared"]:
        print(
            f"objective against {harvested['reference']}: {harvested['compared']:,} programs, "
            f"largest difference {harvested['objective_difference']:.0e} of size²"
        )


def _print_degenerate(rows: list[dict[str, Any]]) -> None:
    cases = list(dict.fromkeys(row["case"] for row in rows))
    backends = list(dict.fromkeys(row["backend"] for row in rows))
    cells = []
    for case in cases:
        line = [case]
        for backend in backends:
            own = [row for row in rows if row["case"] == case and row["backend"] == backend]
            right = sum(row["solved"] + row["refused"] for row in own)
            given = sum(row["problems"] for row in own)
            worst = max(row["violation"] for row in own)
            line.append("all" if right == given else f"{right}/{given}" + (f", {worst:.0e}" if worst > 1e-6 else ""))
        cells.append(line)
    print_table(
        ("set", *backends),
        cells,
        title="degenerate sets: solved or rightly refused, of how many; largest violation in any answer",
        numbers=backends,
    )


def _print_times(rows: list[dict[str, Any]]) -> None:
    headings = ("size", "solver", "solved", "call p50 [µs]", "call p99 [µs]", "native p50 [µs]", "native p99 [µs]")
    shown = sorted(
        (row for row in rows if row["native_p50"] is not None),
        key=lambda row: (list(dict.fromkeys(r["case"] for r in rows)).index(row["case"]), row["native_p50"]),
    )
    print_table(
        (*headings, "KKT max"),
        [
            (
                row["case"],
                row["backend"],
                f"{row['solved'] + row['refused']}/{row['problems']}",
                *(f"{1e6 * row[name]:.2f}" for name in ("call_p50", "call_p99", "native_p50", "native_p99")),
                _residual(row["residual_max"]),
            )
            for row in shown
        ],
        title="side by side: wall time of a call from Python, and without Python's share",
        numbers=(*headings[2:], "KKT max"),
    )


def _print_nearest(bench: "QpBench") -> None:
    for entry in bench.nearest:
        ratio = entry["ratio"]
        verdict = f"{ratio:.2f} times as fast as" if ratio >= 1.0 else f"behind ({ratio:.2f}):"
        print(f"{entry['case']}: {entry['backend']} is {verdict} the next, {entry['nearest']}")
    print(f"installed: {', '.join(f'{name} {version}'.strip() for name, version in bench.versions.items())}")
    print(f"not installed: {', '.join(bench.absent)}")


def _residual(value: float | None) -> str:
    return "" if value is None else f"{value:.1e}"
