"""`hhsim bench stress`."""

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click

from .. import options
from ..console import announce_compilation, print_json, print_table, progress
from ..name_list import names
from ..object_argument import complete_object, read_object

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hhsim.bench.robustness.stress_metrics import StressFigures

HEADINGS = (
    "object",
    "method",
    "ticks",
    "deepest [µm]",
    "palm [µm]",
    "fingers [µm]",
    "> 1 µm",
    "> 10 µm",
    "not finite",
    "stuck",
    "no cause",
    "lag [%]",
    "force/coupling",
    "p50 [µs]",
    "p99 [µs]",
    "max [µs]",
)


@click.command(
    short_help="Random targets on any object, as long as you like; a failing motion is kept, shrunk to a few ticks."
)
@click.argument("objects", metavar="[OBJECT]...", nargs=-1, shell_complete=complete_object)
@names("--method", "methods", "Methods. Default: all.")
@click.option(
    "--ticks",
    type=click.IntRange(1),
    default=20_000,
    show_default=True,
    metavar="N",
    help="Ticks of each object by each method.",
)
@click.option(
    "--wild",
    is_flag=True,
    help="Add what broken devices do: jumps, NaN, zero quaternions, late samples, angles beyond every limit.",
)
@click.option(
    "--hold",
    type=click.IntRange(1),
    default=60,
    show_default=True,
    metavar="N",
    help="Ticks from one target to the next.",
)
@click.option(
    "--step",
    type=click.FloatRange(0.0, min_open=True),
    default=2.0,
    show_default=True,
    metavar="MM",
    help="How far the hand goes in a tick [mm].",
)
@click.option(
    "--bound",
    type=click.Choice(["palm", "hand", "none"]),
    default="palm",
    show_default=True,
    help="What --step bounds: the palm's way, that of every point of the hand, or nothing, so that the hand jumps.",
)
@options.tree_level
@options.linearisations
@options.margin
@click.option(
    "--jobs", type=click.IntRange(1), default=1, show_default=True, metavar="N", help="Processes to share the work."
)
@click.option(
    "--keep",
    type=click.Path(path_type=Path, file_okay=False),
    metavar="FOLDER",
    help="Keep the failures of every method here, shrunk. Default: those of the safe methods, in results/.",
)
@options.unit
@options.size
@options.seed
@options.out
@options.json
@options.quiet
def command(
    objects: tuple[str, ...],
    methods: tuple[str, ...] | None,
    ticks: int,
    wild: bool,
    hold: int,
    step: float,
    bound: Literal["palm", "hand", "none"],
    level: int | None,
    linearisations: int | None,
    margin: float | None,
    jobs: int,
    keep: Path | None,
    unit: str | None,
    size: float | None,
    seed: int,
    out: Path | None,
    as_json: bool,
    quiet: bool,
) -> int:
    """Run the hand to random targets around OBJECTs, by every method, and look for penetration at every tick.

    OBJECT is a name (hhsim objects) or a mesh file; without one, all ten of the catalogue are run. Penetration is
    recomputed from the hand that each tick shows. The exit code is 1 where coupled or progressive penetrates by more
    than 1 µm, is not finite, or is stuck although there was a way.

    \b
    Examples:
      hhsim bench stress
      hhsim bench stress cup --method coupled --ticks 100000 --wild
      hhsim bench stress --method paper --keep failures
    """
    from hhsim.bench.robustness.random_targets import StressOptions
    from hhsim.bench.robustness.stress import run_stress
    from hhsim.bench.robustness.stress_case import StressCase
    from hhsim.bench.robustness.stress_metrics import COLUMNS, table_row
    from hhsim.bench.table import check_table_path, write_table
    from hhsim.hand.model import HandModel
    from hhsim.mesh.catalogue import object_names
    from hhsim.solver.method import METHODS, never_penetrates
    from hhsim.solver.options import SolverOptions
    from hhsim.system.output_path import RESULTS, dated_output_path
    from hhsim.trees.cache import cached_sphere_tree
    from hhsim.trees.options import TreeOptions

    changed: dict[str, Any] = {"linearisations": linearisations, "margin": None if margin is None else 1e-3 * margin}
    changed = {name: value for name, value in changed.items() if value is not None}
    solvers = [SolverOptions(method=method, **changed) for method in methods or METHODS]
    stress = StressOptions(hold=hold, longest_step=1e-3 * step, bound=bound, wild=wild)
    announce_compilation(quiet=quiet)
    by_name = (("--level", level), ("--unit", unit), ("--size", size))
    described_by = [
        f"{name} {value:g}" if isinstance(value, float) else f"{name} {value}"
        for name, value in by_name
        if value is not None
    ]
    meshes = {name: read_object(name, unit, size) for name in objects or object_names()}
    output_path = out or dated_output_path("bench-stress")
    check_table_path(output_path)
    hand = HandModel.default()
    with progress(quiet=quiet) as report:
        cases = []
        for name, (mesh, usual) in meshes.items():
            tree = cached_sphere_tree(mesh, TreeOptions(level=level or usual), report)
            for solver in solvers:
                kept = RESULTS / "failures" if keep is None and never_penetrates(solver.method) else keep
                cases.append(
                    StressCase(
                        object=name,
                        object_options=" ".join(described_by),
                        tree=tree,
                        hand=hand,
                        solver=solver,
                        stress=stress,
                        seed=seed,
                        ticks=ticks,
                        keep=kept,
                    )
                )
        figures = list(run_stress(cases, jobs=jobs, progress=report))
    described = {
        "objects": list(meshes),
        "unit": unit,
        "size_mm": size,
        "level": level,
        "ticks": ticks,
        "seed": seed,
        "stress": stress.to_json(),
        "solver": [solver.to_json() for solver in solvers],
    }
    write_table(output_path, "stress", COLUMNS, [table_row(row) for row in figures], described)
    missed = any(row.missed for row in figures)
    if as_json:
        rows = [{**table_row(row), "failures": [asdict(failure) for failure in row.failures]} for row in figures]
        print_json({"suite": "stress", "missed": missed, "rows": rows, "options": described, "path": str(output_path)})
    elif not quiet:
        _print(figures)
        print(f"every figure is in {output_path}")
    return int(missed)


def _print(figures: "Sequence[StressFigures]") -> None:
    from hhsim.bench.robustness.stress_metrics import total
    from hhsim.solver.method import never_penetrates

    methods = list(dict.fromkeys(row.method for row in figures))
    totals = [total([row for row in figures if row.method == method]) for method in methods]
    rows = [_cells(row) for row in [*figures, *(totals if len(figures) > len(methods) else [])]]
    title = "stress: a new random hand every few ticks"
    print_table(HEADINGS, rows, title=title, numbers=HEADINGS[2:])
    for row in figures:
        for failure in row.failures:
            what = f"{failure.kind} at tick {failure.tick:,}, shrunk to {failure.ticks} ticks"
            what = what if failure.reproduced else f"{failure.kind} at tick {failure.tick:,}, only in the whole run"
            print(f"{row.object}, {row.method}: {what}: {failure.command}")
    for row in totals:
        if never_penetrates(row.method):
            print(f"{row.method}: {'no limit missed' if row.safe else 'LIMIT MISSED'}")


def _cells(row: "StressFigures") -> tuple[str, ...]:
    micro = (row.penetration, row.penetration_palm, row.penetration_finger)
    return (
        row.object,
        row.method,
        f"{row.ticks:,}",
        *(f"{1e6 * value:,.3f}" for value in micro),
        f"{row.penetrating:,}",
        f"{row.penetrating_deep:,}",
        f"{row.not_finite:,}",
        f"{row.stuck:,}",
        f"{row.unexplained:,}",
        f"{100.0 * row.lag / row.ticks:.1f}",
        f"{row.force_ratio:.2f}",
        f"{1e6 * row.cpu_p50:,.0f}",
        f"{1e6 * row.cpu_p99:,.0f}",
        f"{1e6 * row.cpu_max:,.0f}",
    )
