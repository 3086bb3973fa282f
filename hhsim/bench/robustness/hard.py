"""`hhsim bench hard`: the catalogue of the hard cases, and every one by every method; no case can end the bench.

Only the bit of a stuck tick is taken from the solver: penetration is recomputed from the recorded poses, and a stuck
tick is explained only if `hhsim.bench.robustness.local_optimality` finds no step.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from hhsim.bench.robustness.case import DEEPEST, Figure, HardCase, HardRun, Outcome, shown_points
from hhsim.bench.robustness.contact_cases import CONTACT_CASES
from hhsim.bench.robustness.failure import recorded_penetration
from hhsim.bench.robustness.input_cases import INPUT_CASES
from hhsim.bench.robustness.invariance_cases import INVARIANCE_CASES, endurance_case
from hhsim.bench.robustness.local_optimality import pieces_of
from hhsim.bench.robustness.safety import SafetyFigures, SafetyMeasure
from hhsim.bench.robustness.triangle_cases import TRIANGLE_CASES
from hhsim.bench.table import totals_of
from hhsim.errors import HhsimError, InputError, check_known
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.kernels.tick.block import TickRecord
from hhsim.motion.analytic_motion import hold_readings
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.method import never_penetrates
from hhsim.solver.options import SolverOptions
from hhsim.system.posix import used_memory
from hhsim.system.progress import Progress, silent
from hhsim.table.table import Column, Table

ENDURANCE_TICKS = 20_000
"""Ticks of the closed loops unless given; ten minutes at 1 kHz are 600,000."""
LIMIT_TOLERANCE = 1e-9
"""Excess of a joint beyond its limit that is rounding [rad]."""


def hard_cases(
    names: Sequence[str] = (), ticks: int = ENDURANCE_TICKS, surfaces: Sequence[str] = ("spheres",)
) -> tuple[HardCase, ...]:
    """Return the cases of these names in the catalogue's order; without names all that the surfaces allow.

    `ticks` is the length of the case `endurance`. Without the surface `mesh` there are no cases of triangles alone.
    Raises UnknownNameError for no case of that name, InputError for one that needs the surface `mesh`.
    """
    cases = (*INPUT_CASES, *CONTACT_CASES, *INVARIANCE_CASES, endurance_case(ticks), *TRIANGLE_CASES)
    check_known("hard case", names, [case.name for case in cases])
    chosen = [case for case in cases if not names or case.name in names]
    left_out = [case.name for case in chosen if case.mesh_only and "mesh" not in surfaces]
    if names and left_out:
        raise InputError(f"hard case '{left_out[0]}' is made of triangles alone: it takes --surface mesh")
    return tuple(case for case in chosen if case.name not in left_out)


@dataclass(frozen=True)
class CaseResult:
    """Result of one method in one case."""

    case: str
    method: str
    surface: str  # surface that the hand touched: spheres in a case of spheres alone
    figures: tuple[Figure, ...]  # the common ones first; empty if an exception ended the case
    reason: str = ""  # message of the exception or of the refusal, else empty
    refused: bool = False  # True if the method refused the scene
    may_refuse: bool = False  # True if a refusal is as good as a sound motion in this case
    # Figures of all ticks of all runs.
    safety: SafetyFigures = SafetyFigures()  # noqa: RUF009

    @property
    def passed(self) -> bool:
        """True if every bar is kept, or the method refused a scene that it may refuse."""
        if self.refused:
            return self.may_refuse
        return bool(self.figures) and all(figure.passed for figure in self.figures)

    @property
    def penetration(self) -> float:
        """Deepest penetration [m]; NaN if the case ended before it was known."""
        return self.figures[0].value if self.figures else float("nan")

    @property
    def deciding(self) -> Figure | None:
        """Figure, besides penetration, that is farthest beyond or nearest to its bar; the last of equals."""
        return max(reversed(self.figures[1:]), key=_strain, default=None)


def _strain(figure: Figure) -> float:
    """Share of the bar that is used up; nothing of a bar of zero that is kept."""
    if np.isnan(figure.value):
        return float("inf")
    used, allowed = (figure.bar, figure.value) if figure.at_least else (figure.value, figure.bar)
    return used / allowed if allowed > 0.0 else float("inf") if used > 0.0 else 0.0


def bench_hard(
    cases: Sequence[HardCase], solvers: Sequence[SolverOptions], seed: int = 0, progress: Progress = silent
) -> list[CaseResult]:
    """Run every case with every solver; cases of triangles alone with the solvers on the mesh."""
    results = []
    for number, case in enumerate(cases):
        progress(case.name, number * len(solvers), len(cases) * len(solvers))
        taking = [options for options in solvers if options.surface == "mesh" or not case.mesh_only]
        try:
            runs = case.build(seed)
        except Exception as error:  # a scene that cannot be built is a fault of the bench, reported as one
            results += [_ended(case, options, error) for options in taking]
            continue
        for i, options in enumerate(taking):
            results.append(judge_case(case, runs, options))
            progress(case.name, number * len(solvers) + i + 1, len(cases) * len(solvers))
    return results


def judge_case(case: HardCase, runs: Sequence[HardRun], options: SolverOptions) -> CaseResult:
    """Run one case with one method; any exception becomes a failure that names it."""
    try:
        outcomes = [run_scene(run, options) for run in runs]
        refusals = [outcome.refusal for outcome in outcomes if outcome.refusal]
        sound = [outcome for outcome in outcomes if not outcome.refusal]
        figures = [*common_figures(sound)] if sound else []
        figures += case.judge(outcomes) if not refusals else ()
    except Exception as error:
        return _ended(case, options, error)
    return CaseResult(
        case=case.name,
        method=options.method,
        surface=" and ".join(sorted({outcome.options.surface for outcome in outcomes})),
        figures=tuple(figures),
        reason=refusals[0] if refusals else "",
        refused=bool(refusals),
        may_refuse=case.may_refuse and all(figure.passed for figure in figures),
        safety=SafetyFigures(**totals_of(SafetyFigures, [outcome.safety for outcome in outcomes])),
    )


def run_scene(run: HardRun, options: SolverOptions) -> Outcome:
    """Run a scene from its first tick, and measure the common figures."""
    outcome = Outcome(run, run.solver(options), None)
    surface = outcome.surface
    solver = HandSolver(run.hand, surface, outcome.options)
    pieces = pieces_of(outcome.options.surface, run.mesh, run.tree)
    safety, excess = SafetyMeasure(run.hand, pieces, outcome.options), [0.0]
    marked, memory = [], []

    def measured(motion: HandConfiguration) -> TickRecord:
        record = solver.run(*motion)
        safety.add(hold_readings(motion), record, recorded_penetration(run.hand, surface, record).depth)
        excess.append(limit_excess(run.hand, record))
        return record

    record: TickRecord | None = None
    refusal = ""
    try:
        if run.lead is not None:
            measured(run.lead)
        for _ in range(run.repeats):
            record = measured(run.motion)
            marked.append(shown_points(record)[list(run.marks)])
            memory.append(used_memory()[0])
    except HhsimError as error:
        record, refusal = None, str(error)
    return replace(
        outcome,
        record=record,
        refusal=refusal,
        safety=safety.figures,
        limit_excess=float(np.max(excess)),
        marked=np.array(marked),
        memory=np.array(memory, dtype=np.float64),
    )


def common_figures(outcomes: list[Outcome]) -> list[Figure]:
    """Return the figures of every case, over all of its runs that were not refused."""
    penetration = float(np.max([outcome.safety.penetration / outcome.run.scale for outcome in outcomes]))
    return [
        Figure("penetration", penetration, DEEPEST, "m"),
        Figure("ticks that are not finite", sum(outcome.safety.not_finite for outcome in outcomes), 0),
        Figure("joint beyond its limit", max(outcome.limit_excess for outcome in outcomes), LIMIT_TOLERANCE, "rad"),
        Figure("stuck ticks that nothing explains", sum(outcome.safety.unexplained for outcome in outcomes), 0),
    ]


def limit_excess(hand: HandModel, record: TickRecord) -> float:
    """Return the largest excess of a joint beyond its limit [rad]; NaN if an angle is."""
    low = hand.flexion_min - record.flexion
    high = record.flexion - hand.flexion_max
    return float(max(0.0, np.max(low), np.max(high))) if np.isfinite(record.flexion).all() else float("nan")


COLUMNS = (
    Column("case", "hard case", of="result.case"),
    Column("method", "method of the solver", of="result.method"),
    Column("surface", "what of the objects the hand touched", of="result.surface"),
    Column("case_passed", "whether the method kept every bar of the case", of="result.passed"),
    Column("figure", "what was measured; empty where the case ended before", of="figure.name"),
    Column("value", "measured value, in the unit of the column `unit`", of=lambda row: float(row.figure.value)),
    Column("bar", "what it is held to, in the same unit", of=lambda row: float(row.figure.bar)),
    Column("at_least", "whether the bar is a lower one", of="figure.at_least"),
    Column("unit", "SI unit of value and bar; 1 for counts and ratios", of=lambda row: row.figure.unit or "1"),
    Column("passed", "whether the bar was kept", of=lambda row: bool(row.figure.passed)),
    Column("ticks", "ticks of all runs of the case", of="result.safety.ticks"),
    Column("stuck", "ticks that kept the last feasible hand", of="result.safety.stuck"),
    Column("unexplained", "of those, the ones from where a hand could move", of="result.safety.unexplained"),
    Column("lagging", "ticks with distance still to go", of="result.safety.lagging"),
    Column("lag", "most distance still to go", "m", "result.safety.lag"),
    Column("reason", "the refusal or the exception that ended the case", of="result.reason"),
)
"""Columns of the suite's table: a row for every figure of every case and method."""


class _Row(NamedTuple):
    result: CaseResult
    figure: Figure


def table_rows(results: Sequence[CaseResult]) -> list[dict[str, Any]]:
    """Return the rows of `COLUMNS`."""
    nothing = Figure("", float("nan"), float("nan"))
    rows = [_Row(result, figure) for result in results for figure in (result.figures or (nothing,))]
    return Table(COLUMNS, rows).records


def missed(results: Sequence[CaseResult]) -> list[CaseResult]:
    """Return the results of methods that promise to pass and did not."""
    return [result for result in results if never_penetrates(result.method) and not result.passed]


def _ended(case: HardCase, options: SolverOptions, error: Exception) -> CaseResult:
    return CaseResult(case.name, options.method, options.surface, (), f"{type(error).__name__}: {error}")
