"""`hhsim bench stress`."""

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click

from hhsim.table.table import Table, number, words

from ..arguments import options
from ..arguments.object_argument import MeshSize, complete_object
from ..arguments.option_group import OptionGroup, option
from ..arguments.solver_options import Linearising
from ..console import print_table, progress
from .suite import Solvers, SuiteTable

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hhsim.bench.robustness.stress import StressFigures

SHOWN = (
    *map(words, ("object", "method", "surface")),
    number("ticks"),
    number("deepest", "penetration", "µm", 3),
    number("palm", "penetration_palm", "µm", 3),
    number("fingers", "penetration_finger", "µm", 3),
    number("> 1 µm", "penetrating"),
    number("> 10 µm", "penetrating_deep"),
    number("not finite", "not_finite"),
    number("stuck"),
    number("no cause", "unexplained"),
    number("lag", lambda row: 100.0 * row.lagging / row.ticks, "%", 1),
    number("force/coupling", "force_ratio", digits=2),
    number("p50", "cpu_p50", "µs"),
    number("p99", "cpu_p99", "µs"),
    number("max", "cpu_max", "µs"),
)


class Targets(OptionGroup):
    """Random targets of the hand."""

    ticks: int = option(type=options.COUNT, default=20_000, metavar="N", help="Ticks of each object by each method.")
    wild: bool = option(
        is_flag=True,
        help="Add what broken devices do: jumps, NaN, zero quaternions, late samples, angles beyond every limit.",
    )


@click.command(cls=options.Command)
@click.argument("objects", metavar="[OBJECT]...", nargs=-1, shell_complete=complete_object)
@Solvers.argument("solvers")
@Targets.argument("targets")
@options.tree_level
@Linearising.argument("linearising")
@click.option("--jobs", type=options.JOBS, default=1, metavar="N", help="Processes to share the work.")
@click.option(
    "--keep",
    type=options.OUTPUT,
    metavar="FOLDER",
    help="Keep the failures of every method here, shrunk. Default: those of the safe methods, in results/.",
)
@MeshSize.argument("mesh_size")
@options.seed
@options.Output.argument("output")
def command(
    objects: tuple[str, ...],
    solvers: Solvers,
    targets: Targets,
    level: int | None,
    linearising: Linearising,
    jobs: int,
    keep: Path | None,
    mesh_size: MeshSize,
    seed: int,
    output: options.Output,
) -> int:
    """Run the hand to random targets around OBJECTs, by every method, and look for penetration at every tick.

    OBJECT is a name (hhsim objects) or a mesh file; without one, all of the catalogue are run. Penetration is
    recomputed from the hand that each tick shows. The exit code is 1 where coupled or progressive penetrates by more
    than 1 µm, is not finite, or is stuck although there was a way.

    \b
    Examples:
      hhsim bench stress
      hhsim bench stress cup --method coupled --ticks 100000 --wild
      hhsim bench stress --method paper --keep failures
      hhsim bench stress bunny --surface spheres,mesh --method coupled
    """
    from hhsim.bench.robustness.random_targets import StressOptions
    from hhsim.bench.robustness.stress import COLUMNS, StressCase, run_stress
    from hhsim.hand.model import HandModel
    from hhsim.mesh.catalogue import object_names
    from hhsim.solver.method import METHODS, never_penetrates
    from hhsim.system.output_path import RESULTS
    from hhsim.trees.cache import cached_sphere_tree
    from hhsim.trees.options import TreeOptions

    changed = linearising.given()
    if linearising.margin is not None:
        changed["margin"] = 1e-3 * linearising.margin
    chosen = solvers.options(tuple(METHODS), **changed)
    stress = StressOptions(wild=targets.wild)
    by_name = (("--level", level), ("--unit", mesh_size.unit), ("--size", mesh_size.size))
    shown = {name: f"{value:g}" if isinstance(value, float) else value for name, value in by_name if value is not None}
    meshes = {name: mesh_size.read(name) for name in objects or object_names()}
    described = {
        "objects": list(meshes),
        "unit": mesh_size.unit,
        "size_mm": mesh_size.size,
        "level": level,
        "ticks": targets.ticks,
        "seed": seed,
        "stress": asdict(stress),
        "solver": [solver.to_json() for solver in chosen],
    }
    table = SuiteTable(output, "stress", COLUMNS, described)
    hand = HandModel.default()
    with progress(quiet=output.quiet) as report:
        cases = []
        for name, (mesh, usual) in meshes.items():
            tree = cached_sphere_tree(mesh, TreeOptions(level=level or usual), report)
            for solver in chosen:
                kept = RESULTS / "failures" if keep is None and never_penetrates(solver.method) else keep
                cases.append(
                    StressCase(
                        object=name,
                        object_options=" ".join(f"{name} {value}" for name, value in shown.items()),
                        tree=tree,
                        mesh=mesh,
                        hand=hand,
                        solver=solver,
                        stress=stress,
                        seed=seed,
                        ticks=targets.ticks,
                        keep=kept,
                    )
                )
        figures = list(run_stress(cases, jobs=jobs, progress=report))
    records = Table(COLUMNS, figures).records
    table.write(records)
    missed = any(row.missed for row in figures)
    failures = ([asdict(failure) for failure in row.failures] for row in figures)
    if table.is_for_people(missed=missed, rows=[{**row, "failures": kept} for row, kept in zip(records, failures)]):
        _print(figures)
        table.print_paths()
    return int(missed)


def _print(figures: "Sequence[StressFigures]") -> None:
    from hhsim.bench.robustness.stress import total
    from hhsim.solver.method import never_penetrates

    chosen = list(dict.fromkeys((row.method, row.surface) for row in figures))
    totals = [total([row for row in figures if (row.method, row.surface) == which]) for which in chosen]
    rows = [*figures, *(totals if len(figures) > len(chosen) else [])]
    print_table(Table(SHOWN, rows, "stress: a new random hand every few ticks"))
    for row in figures:
        for failure in row.failures:
            what = f"{failure.kind} at tick {failure.tick:,}, shrunk to {failure.ticks} ticks"
            print(f"{row.object}, {row.method}: {what}: {failure.command}")
    for row in totals:
        if never_penetrates(row.method):
            on = "" if row.surface == "spheres" else f" on the {row.surface}"
            print(f"{row.method}{on}: {'no limit missed' if row.safe else 'LIMIT MISSED'}")
