"""`hhsim bench hard`."""

from typing import TYPE_CHECKING

import click
from click.shell_completion import CompletionItem

from hhsim.table.table import Table, number, words

from ..arguments import options
from ..console import print_json, print_table, progress
from .suite import Solvers, SuiteTable

if TYPE_CHECKING:
    from hhsim.bench.robustness.case import Figure
    from hhsim.bench.robustness.hard import CaseResult


def complete_case(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Offer the names of the cases."""
    from hhsim.bench.robustness.hard import hard_cases

    return [CompletionItem(case.name) for case in hard_cases(surfaces=("mesh",)) if case.name.startswith(incomplete)]


@click.command(cls=options.Command)
@click.argument("cases", metavar="[CASE]...", nargs=-1, shell_complete=complete_case)
@Solvers.argument("solvers")
@click.option(
    "--ticks",
    type=click.IntRange(8_000, 36_000_000),
    default=20_000,
    metavar="N",
    help="Ticks of the case endurance; 600000 are ten minutes at 1 kHz.",
)
@click.option("--list", "only_list", is_flag=True, help="List the cases and run none.")
@options.seed
@options.Output.argument("output")
def command(
    cases: tuple[str, ...], solvers: Solvers, ticks: int, only_list: bool, seed: int, output: options.Output
) -> int:
    """Put every method through the scenes that break methods.

    Each CASE is a named scene with a bar of its own; besides, in all of them: penetration at most 1 µm at every tick,
    recomputed from the poses; finite numbers; joints within their limits; and no stuck tick from where a hand could
    have moved. All cases run where none is named. With --surface mesh the hand touches the triangles of the objects,
    but for those that are spheres alone, and there are cases of triangles besides. The exit code is 1 where coupled or
    progressive misses a bar; the other methods promise nothing, and are measured to show by how much they miss.

    \b
    Examples:
      hhsim bench hard
      hhsim bench hard fast-swipe narrow-handle --method coupled,paper
      hhsim bench hard endurance --ticks 600000 --out endurance.h5
      hhsim bench hard --surface mesh --method coupled,progressive
    """
    from hhsim.bench.robustness.hard import COLUMNS, bench_hard, hard_cases, missed, table_rows
    from hhsim.solver.method import METHODS

    chosen = hard_cases(cases, ticks, solvers.surfaces or ("spheres",))
    if only_list:
        if output.as_json:
            print_json({"cases": [{"name": case.name, "description": case.description} for case in chosen]})
        else:
            print_table(Table((words("case", "name"), words("what it is", "description")), chosen))
        return 0
    named = solvers.options(tuple(METHODS))
    settings = {
        "cases": [case.name for case in chosen],
        "methods": list(dict.fromkeys(options.method for options in named)),
        "surfaces": list(dict.fromkeys(options.surface for options in named)),
        "seed": seed,
        "ticks": ticks,
    }
    table = SuiteTable(output, "hard", COLUMNS, settings)
    with progress(quiet=output.quiet) as report:
        results = bench_hard(chosen, named, seed, report)
    rows, failed = table_rows(results), missed(results)
    table.write(rows)
    if table.is_for_people(passed=not failed, rows=rows):
        _print(results, failed)
        table.print_paths()
    return 1 if failed else 0


def _print(results: "list[CaseResult]", failed: "list[CaseResult]") -> None:
    print_table(Table(SHOWN, results))
    for result in results:
        if result.reason:
            print(f"{result.case}, {result.method}: {result.reason}")
        for figure in result.figures:
            if not figure.passed:
                print(f"{result.case}, {result.method}: {figure.name} {_value(figure)}, bar {_bar(figure)}")
    kept = list(dict.fromkeys(result.case for result in results if result.surface == "spheres"))
    if kept and any("mesh" in result.surface for result in results):
        print(f"on spheres, since their objects are nothing else: {', '.join(kept)}")
    passed = {method: [r.passed for r in results if r.method == method] for method in {r.method: 0 for r in results}}
    print("passed: " + ", ".join(f"{method} {sum(kept)} of {len(kept)}" for method, kept in passed.items()))
    if failed:
        print(f"missed by a method that promises to pass: {', '.join(f'{r.case} ({r.method})' for r in failed)}")


def _value(figure: "Figure") -> str:
    return _shown(figure.value, figure.unit)


def _bar(figure: "Figure") -> str:
    return ("≥ " if figure.at_least else "≤ ") + _shown(figure.bar, figure.unit)


def _shown(value: float, unit: str) -> str:
    factor, name = {"m": (1e3, " mm"), "B": (1e-6, " MB"), "rad": (1.0, " rad")}.get(unit, (1.0, ""))
    if unit == "m" and 0.0 < abs(value) < 1e-5:
        factor, name = 1e6, " µm"
    return f"{factor * value:.3g}{name}"


SHOWN = (
    *map(words, ("case", "method", "surface")),
    words(
        "verdict", lambda result: "FAIL" if not result.passed else "refuses, as it may" if result.refused else "pass"
    ),
    number("penetration", "penetration", "µm", 3, missing=""),
    words("nearest to its bar", lambda result: result.deciding.name if result.deciding else ""),
    number("value", lambda result: _value(result.deciding) if result.deciding else ""),
    number("bar", lambda result: _bar(result.deciding) if result.deciding else ""),
    number("stuck", "safety.stuck"),
    number("lag", "safety.lag", "mm", 1),
)
