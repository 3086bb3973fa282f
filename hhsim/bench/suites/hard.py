"""Every hard case, for every method: pass or fail, and the figure.

No case can end the bench.
Only the bit of a stuck tick is taken from the solver: penetration is recomputed from the recorded poses, and a stuck
tick is explained only if `hhsim.bench.robustness.safety` finds no step.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated, Any, NamedTuple

import numpy as np

from hhsim.bench.figures import placed_of
from hhsim.bench.robustness.case import DEEPEST, Figure, HardCase, HardRun, Outcome, own_figures
from hhsim.bench.robustness.contact_cases import CONTACT_CASES, TRIANGLE_CASES
from hhsim.bench.robustness.input_cases import INPUT_CASES, INVARIANCE_CASES, endurance_case
from hhsim.bench.robustness.safety import SafetyMeasure, pieces_of, recorded_penetration, solvers_of, summed
from hhsim.bench.suite import Row, Suite
from hhsim.errors import HhsimError, InputError, check_known
from hhsim.hand.configuration import HandConfiguration
from hhsim.kernels.tick.block import TickRecord
from hhsim.motion.analytic_motion import hold_readings
from hhsim.solver.method import methods_that
from hhsim.solver.options import SolverOptions
from hhsim.solver.solver import HandSolver
from hhsim.system.posix import used_memory
from hhsim.system.progress import Progress
from hhsim.system.settings_file import Names, between
from hhsim.table.table import Table, number, words
from hhsim.trees.contact_surface import contact_surface

STATED = ("ticks", "stuck", "unexplained", "lagging", "lag")
"""Figures of safety that each row repeats."""
LIMIT_TOLERANCE = 1e-9
"""Excess of a joint beyond its limit that is rounding [rad]."""


def hard_cases(
    names: Sequence[str] = (), ticks: int = 20_000, surfaces: Sequence[str] = ("spheres",)
) -> tuple[HardCase, ...]:
    """Return the cases of these names in the catalogue's order; without names all that the surfaces allow.

    `ticks` is the length of the case `endurance`. Without the surface `mesh` there are no cases of triangles alone.
    Raises UnknownNameError for no case of that name, InputError for one that needs the surface `mesh`.
    """
    cases = (*INPUT_CASES, *CONTACT_CASES, *INVARIANCE_CASES, endurance_case(ticks), *TRIANGLE_CASES)
    check_known("hard case", names, [case.name for case in cases])
    for case in cases:
        if case.name in names and case.mesh_only and "mesh" not in surfaces:
            raise InputError(f"hard case '{case.name}' is made of triangles alone: it takes --surface mesh")
    chosen = (case for case in cases if not names or case.name in names)
    return tuple(case for case in chosen if "mesh" in surfaces or not case.mesh_only)


class Cell(NamedTuple):
    """Case, solver and seed."""

    case: HardCase
    solver: SolverOptions
    seed: int


@dataclass(frozen=True, kw_only=True)
class Hard(Suite):
    """Cases, methods, surfaces."""

    cases: tuple[str, ...]
    methods: Names | None
    surfaces: Names
    ticks: Annotated[int, between(8_000, 36_000_000)]
    seed: int
    is_portable = True

    def check(self) -> None:
        """Raise InputError for an unknown name, or a case that needs the surface mesh."""
        self.chosen()
        solvers_of(self.methods, self.surfaces)

    def chosen(self) -> tuple[HardCase, ...]:
        """Return the cases that are run."""
        return hard_cases(self.cases, self.ticks, self.surfaces)

    def cells(self, progress: Progress) -> list[Cell]:
        """Return every case with every solver; cases of triangles alone with those on the mesh."""
        solvers = solvers_of(self.methods, self.surfaces)
        pairs = ((case, solver) for case in self.chosen() for solver in solvers)
        return [Cell(*pair, self.seed) for pair in pairs if pair[1].surface == "mesh" or not pair[0].mesh_only]

    def run(self, cell: Cell, before: None) -> list[Row]:
        """Run one case by one method and return a row for each figure; see `run_case`."""
        return run_case(cell)

    def named(self, cell: Cell) -> str:
        """Return the name of the case."""
        return cell.case.name

    def listed(self) -> Table:
        """Return the cases, each with a line."""
        return Table((words("case", "name"), words("what it is", "description")), self.chosen())

    def tables(self, rows: Sequence[Row], figures: Any) -> list[Table]:
        """Return a line for each case and method, with the figure, besides penetration, that is nearest to its bar."""
        lines = []
        for group in by_case(rows):
            head = group[0]
            verdict = "refuses, as it may" if head["reason"] else "pass"
            # The figure that is farthest beyond its bar or nearest to it; the last of equals.
            nearest = max(reversed(group[1:]), key=_strain, default={})
            told = (nearest["figure"], *_spelled(nearest)) if nearest else ("", "", "")
            shown = dict(zip(("nearest to its bar", "of it", "bar"), told))
            lines.append({**head, "verdict": verdict if head["case_passed"] else "FAIL", **shown})
        columns = (
            *map(words, ("case", "method", "surface", "verdict")),
            number("penetration", "value", "µm", 3, missing=""),
            words("nearest to its bar"),
            number("value", "of it"),
            number("bar"),
            number("stuck"),
            number("lag", unit="mm", digits=1),
        )
        return [Table(columns, lines)]

    def missed(self, rows: Sequence[Row]) -> list[str]:
        """Return the cases that a method which promises to pass did not."""
        heads = [group[0] for group in by_case(rows)]
        failed = [row for row in heads if row["method"] in methods_that("never_penetrates") and not row["case_passed"]]
        return [f"{row['case']} ({row['method']})" for row in failed]

    def lines(self, rows: Sequence[Row]) -> list[str]:
        """Say why cases ended, which bars are missed by whom, what was on spheres, and how many passed."""
        found, passed = list[str](), dict[str, list[bool]]()
        for group in by_case(rows):
            head = group[0]
            where = f"{head['case']}, {head['method']}"
            passed.setdefault(head["method"], []).append(head["case_passed"])
            found += [f"{where}: {head['reason']}"] if head["reason"] else []
            missing = ((row["figure"], *_spelled(row)) for row in group if row["figure"] and not row["passed"])
            found += [f"{where}: {figure} {value}, bar {bar}" for figure, value, bar in missing]
        on_spheres = list(dict.fromkeys(row["case"] for row in rows if row["surface"] == "spheres"))
        if on_spheres and any("mesh" in row["surface"] for row in rows):
            found.append(f"on spheres, since their objects are nothing else: {', '.join(on_spheres)}")
        each = (f"{method} {sum(kept)} of {len(kept)}" for method, kept in passed.items())
        return [*found, f"passed: {', '.join(each)}"]


def run_case(cell: Cell) -> list[Row]:
    """Run one case by one method and return a row for each figure; any exception becomes a failure that names it."""
    case, solver = cell.case, cell.solver
    figures: list[Figure] = []
    refusal, passed, surface = "", False, solver.surface
    safety: dict[str, Any] = dict.fromkeys(STATED, 0)
    try:
        outcomes = run_scenes(_scenes(case, cell.seed), solver)
        refusal = next((outcome.refusal for outcome in outcomes if outcome.refusal), "")
        sound = [outcome for outcome in outcomes if not outcome.refusal]
        figures += common_figures(sound) if sound else []
        figures += [] if refusal else own_figures(outcomes)
        passed = all(figure.passed for figure in figures) and (case.may_refuse if refusal else bool(figures))
        surface = " and ".join(sorted({outcome.options.surface for outcome in outcomes}))
        safety |= summed([one.safety for one in outcomes if one.safety] or [safety])
    except Exception as error:  # a scene that cannot be built is a fault of the bench, reported as one
        figures, passed, refusal = [], False, f"{type(error).__name__}: {error}"
    return [
        {
            "case": case.name,
            "method": solver.method,
            "surface": surface,
            "case_passed": bool(passed),
            "figure": figure.name,
            "value": float(figure.value),
            "bar": float(figure.bar),
            "at_least": figure.at_least,
            "unit": figure.unit or "1",
            "passed": bool(figure.passed),
            **{name: safety[name] for name in STATED},
            "reason": refusal,
        }
        for figure in figures or [Figure("", math.nan, math.nan)]
    ]


# The methods of a case share its scenes.
@lru_cache(1)
def _scenes(case: HardCase, seed: int) -> Sequence[HardRun]:
    return tuple(case.build(seed))


def run_scenes(runs: Iterable[HardRun], options: SolverOptions) -> list[Outcome]:
    """Run the scenes of a case, each from its first tick, and measure the common figures."""
    outcomes: list[Outcome] = []
    for run in runs:
        outcomes.append(_run_scene(run, run.solver(options), tuple(outcomes)))
    return outcomes


def _run_scene(run: HardRun, options: SolverOptions, before: Sequence[Outcome]) -> Outcome:
    surface = contact_surface(options.surface, run.mesh, run.tree).arrays
    solver = HandSolver(run.hand, surface, options)
    safety, excess = SafetyMeasure(run.hand, pieces_of(options.surface, run.mesh, run.tree), options), [0.0]
    marked, memory = [], []

    def measured(motion: HandConfiguration) -> TickRecord:
        record = solver.run(*motion)
        safety.add(hold_readings(motion), record, recorded_penetration(run.hand, surface, record).depth)
        bent = record.flexion
        beyond = np.maximum(run.hand.flexion_min - bent, bent - run.hand.flexion_max)
        excess.append(float(beyond.max()) if np.isfinite(bent).all() else math.nan)
        return record

    record: TickRecord | None = None
    refusal = ""
    try:
        if run.lead is not None:
            measured(run.lead)
        for _ in range(run.repeats):
            record = measured(run.motion)
            marked.append(placed_of(record).points[list(run.marks)])
            memory.append(used_memory()[0])
    except HhsimError as error:
        record, refusal = None, str(error)
    figures = safety.figures, float(np.max(excess)), np.array(marked), np.array(memory, dtype=np.float64)
    return Outcome(run, options, surface, before, record, refusal, *figures)


def common_figures(outcomes: Sequence[Outcome]) -> list[Figure]:
    """Return the figures of every case, over all of its runs that were not refused."""

    def sum_of(name: str) -> int:
        return sum(outcome.safety[name] for outcome in outcomes)

    penetration = float(np.max([outcome.safety["penetration"] / outcome.run.scale for outcome in outcomes]))
    return [
        Figure("penetration", penetration, DEEPEST, "m"),
        Figure("ticks that are not finite", sum_of("not_finite"), 0),
        Figure("joint beyond its limit", max(outcome.limit_excess for outcome in outcomes), LIMIT_TOLERANCE, "rad"),
        Figure("stuck ticks that nothing explains", sum_of("unexplained"), 0),
    ]


def by_case(rows: Sequence[Row]) -> list[list[Row]]:
    """Return the rows of each case by each method on each surface."""
    groups: dict[tuple[Any, ...], list[Row]] = {}
    for row in rows:
        groups.setdefault((row["case"], row["method"], row["surface"]), []).append(row)
    return list(groups.values())


def _strain(row: Row) -> float:
    """Share of the bar that is used up; nothing of a bar of zero that is kept."""
    if math.isnan(row["value"]):
        return math.inf
    used, allowed = (row["bar"], row["value"]) if row["at_least"] else (row["value"], row["bar"])
    return float(used / allowed) if allowed > 0.0 else math.inf if used > 0.0 else 0.0


def _spelled(row: Row) -> list[str]:
    """Return value and bar of a figure as people read them."""
    found = []
    for value in (row["value"], row["bar"]):
        factor, unit = {"m": (1e3, " mm"), "B": (1e-6, " MB"), "rad": (1.0, " rad")}.get(row["unit"], (1.0, ""))
        if row["unit"] == "m" and 0.0 < abs(value) < 1e-5:
            factor, unit = 1e6, " µm"
        found.append(f"{factor * value:.3g}{unit}")
    return [found[0], f"{'≥' if row['at_least'] else '≤'} {found[1]}"]


SUITE = Hard
