"""`hhsim bench qp`: the programs of real ticks, the degenerate sets, and every solver at hand side by side.

Three parts. `harvest`: our solver on programs of real ticks (`hhsim.bench.qp.recorded_problems`), from nothing and from
the guess that the tick had, every answer checked from the program alone (`hhsim.bench.qp.kkt_check`). `degenerate`:
every solver on the sets that are known to hurt. `time`: every solver on the same programs, in turns, by its best native
call.
"""

import importlib.metadata
import random
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hhsim.bench.qp.backends import (
    KNOWN_BACKENDS,
    Conditioned,
    PreparedCall,
    condition,
    other_backends,
    overhead,
    prepare,
)
from hhsim.bench.qp.degenerate_problems import FEASIBLE_SETS, INFEASIBLE_SETS, VARIABLES, degenerate_set
from hhsim.bench.qp.kkt_check import least_violation
from hhsim.bench.qp.program import Program, ProgramSolver
from hhsim.bench.qp.random_problems import SIZES, contact_programs
from hhsim.bench.qp.recorded_problems import MOTIONS, OBJECTS, RANDOM, harvest
from hhsim.bench.qp.statistics import OWN_LIMIT, Tally, percentile
from hhsim.bench.table import Column
from hhsim.errors import UnknownNameError
from hhsim.solver.qp import ACTIVE_SET

Progress = Callable[[str, int, int], None]

WARM = "active-set, warm"
WARM_DAQP = "daqp, warm"
ROUNDS = 3
"""Turns that each solver has at each program."""
IN_A_ROW = 5
"""Solves in a turn, of which the median counts: the first finds a cold cache."""
SLOW = 1e6
"""A call that takes longer [ns] is made once a turn."""
REFERENCE_SHARE = 50
"""One program in so many is solved by a reference too."""
LINEAR_PROGRAMS = 200
"""Refusals that an independent linear program looks at too."""

COLUMNS = (
    Column("part", "part of the bench: harvest, degenerate or time"),
    Column("case", "kind of program, name of the set, or variables × rows"),
    Column("variables", "number of variables, largest"),
    Column("rows", "number of rows, median"),
    Column("backend", "solver"),
    Column("problems", "programs it was given"),
    Column("solved", "answers with residuals of 1e-6 or less"),
    Column("refused", "rightly refused: the rows contradict each other"),
    Column("accepted", "answers to rows that contradict each other by less than it sees"),
    Column("gave_up", "no answer although there is one"),
    Column("wrong", "answers that are none"),
    Column("unproved", "refusals without a certificate that holds (ours only)"),
    Column("violation", "largest violation of a row, in sizes of the program"),
    Column("residual_p99", "KKT residual in sizes of the program, 99th percentile"),
    Column("residual_max", "KKT residual in sizes of the program, largest"),
    Column("iterations", "iterations, mean"),
    Column("call_p50", "wall time of the call as Python sees it, median", "s"),
    Column("call_p99", "the same, 99th percentile", "s"),
    Column("native_p50", "wall time without Python's share, median", "s"),
    Column("native_p99", "the same, 99th percentile", "s"),
)


@dataclass(frozen=True, kw_only=True)
class QpBenchOptions:
    """What is run.

    Attributes:
        problems: Programs to harvest.
        per_set: Programs of each degenerate set and number of variables.
        per_size: Programs of each size that is timed.
        objects: Of the harvest.
        motions: Of the harvest.
        backends: Solvers besides ours; None for all that are installed.
        patience: Time [s] that a solver may spend on a set or a size; what it has not reached by then it skips.
        seed: Of everything random.
    """

    problems: int = 100_000
    per_set: int = 200
    per_size: int = 100
    objects: tuple[str, ...] = OBJECTS
    motions: tuple[str, ...] = MOTIONS
    backends: tuple[str, ...] | None = None
    patience: float = 5.0
    seed: int = 0

    def solvers(self) -> list[str]:
        """Solvers besides ours.

        Raises:
            UnknownNameError: for one that is not installed.
        """
        installed = other_backends()
        if self.backends is None:
            return installed
        for name in self.backends:
            if name not in installed:
                raise UnknownNameError("QP solver", name, installed)
        return list(self.backends)


def check_names(options: QpBenchOptions) -> None:
    """Look, before the work, whether all that is named is there.

    Raises:
        UnknownNameError: An object, a motion or a solver that there is not.
    """
    from hhsim.mesh.catalogue import object_names
    from hhsim.scene.motion_catalogue import script_names

    options.solvers()
    for name in options.objects:
        if name not in object_names():
            raise UnknownNameError("object", name, object_names())
    known = [*script_names(), RANDOM]
    for name in options.motions:
        if name not in known:
            raise UnknownNameError("motion", name, known)


@dataclass
class QpBench:
    """What came out.

    Attributes:
        rows: One for each part, case and solver, by the names of `COLUMNS`.
        harvested: Of the harvest: counts of refused and relaxed programs, the reference's figures.
        nearest: For each timed case how ours stands to the fastest other one.
        absent: Solvers that qpsolvers knows and that are not installed.
        versions: Of the installed ones.
    """

    rows: list[dict[str, Any]] = field(default_factory=list)
    harvested: dict[str, Any] = field(default_factory=dict)
    nearest: list[dict[str, Any]] = field(default_factory=list)
    absent: list[str] = field(default_factory=list)
    versions: dict[str, str] = field(default_factory=dict)

    @property
    def failures(self) -> list[str]:
        """What ours missed, a sentence each; empty where it solved or proved everything."""
        missed = []
        for row in self.rows:
            if not row["backend"].startswith(ACTIVE_SET) or row["part"] == "time":
                continue
            wrong = row["problems"] - row["solved"] - row["refused"]
            where = f"{row['part']}, {row['case']}, {row['variables']} variables, {row['backend']}"
            if wrong:
                missed.append(f"{where}: {wrong} of {row['problems']} programs not solved and not proved infeasible")
            if not row["residual_max"] <= OWN_LIMIT:
                missed.append(f"{where}: KKT residual {row['residual_max']:.1e}, more than {OWN_LIMIT:g}")
        if self.harvested.get("linear_program_denies", 0):
            missed.append(f"a linear program finds {self.harvested['linear_program_denies']} refused programs feasible")
        return missed


def bench_qp(options: QpBenchOptions, progress: Progress | None = None) -> QpBench:
    """Run the three parts.

    Raises:
        UnknownNameError: An object, a motion or a solver that there is not.
    """
    solvers = options.solvers()
    installed = other_backends()
    bench = QpBench(
        absent=[name for name in KNOWN_BACKENDS if name not in installed],
        versions={name: _version(name) for name in installed},
    )
    solver = ProgramSolver()
    sampled = _harvest(options, bench, solver, progress)
    _degenerate(options, solvers, bench, solver, progress)
    cases = {f"{n}×{m}": list(contact_programs(n, m, options.per_size, options.seed)) for n, m in SIZES}
    _time(options, solvers, bench, {**cases, **sampled}, set(sampled), solver, progress)
    return bench


def _harvest(
    options: QpBenchOptions, bench: QpBench, solver: ProgramSolver, progress: Progress | None
) -> dict[str, list[Program]]:
    """Count and check; returns a sample of each kind, to be timed."""
    cold: dict[str, Tally] = {}
    warm: dict[str, Tally] = {}
    rows: dict[str, list[int]] = {}
    variables: dict[str, int] = {}
    sample: dict[str, list[Program]] = {}
    seen: dict[str, int] = {}
    draw = random.Random(options.seed)
    reference = next((name for name in ("quadprog", "daqp", "clarabel") if name in other_backends()), None)
    relaxed = compared = examined = denied = 0
    apart = 0.0
    for number, program in enumerate(
        harvest(
            options.problems, objects=options.objects, motions=options.motions, seed=options.seed, progress=progress
        )
    ):
        kind = program.kind
        from_nothing, from_guess = solver.solve(program.unguessed()), solver.solve(program)
        cold.setdefault(kind, Tally()).count_outcome(program, from_nothing)
        before = warm.setdefault(kind, Tally()).refused
        warm[kind].count_outcome(program, from_guess)
        rows.setdefault(kind, []).append(program.rows)
        variables[kind] = max(variables.get(kind, 0), program.variables)
        if warm[kind].refused > before and examined < LINEAR_PROGRAMS:
            examined += 1
            denied += least_violation(program) < -1e-9
        strict = np.max(program.rhs - program.matrix @ from_guess.x, initial=0.0)
        relaxed += bool(from_guess.status == 0 and strict > 2.0 * program.tolerance)
        if reference is not None and number % REFERENCE_SHARE == 0 and from_guess.status == 0:
            problem = condition(program)
            answer = prepare(reference, problem).solve(problem)
            if answer.found:
                compared += 1
                ours = 0.5 * float(np.sum((from_guess.x - program.target) ** 2))
                theirs = 0.5 * float(np.sum((answer.x - program.target) ** 2))
                apart = max(apart, abs(ours - theirs) / program.size**2)
        # A fair sample of a stream of unknown length.
        seen[kind] = seen.get(kind, 0) + 1
        kept = sample.setdefault(kind, [])
        if len(kept) < options.per_size:
            kept.append(program)
        elif (place := draw.randrange(seen[kind])) < options.per_size:
            kept[place] = program
    for kind in cold:
        for name, tallies in ((ACTIVE_SET, cold), (WARM, warm)):
            bench.rows.append(_row("harvest", kind, variables[kind], rows[kind], name, tallies[kind]))
    bench.harvested = {
        "problems": sum(tally.problems for tally in warm.values()),
        "proved_infeasible": sum(tally.refused for tally in warm.values()),
        "relaxed": relaxed,
        "linear_programs": examined,
        "linear_program_denies": denied,
        "reference": reference,
        "compared": compared,
        "objective_difference": apart,
    }
    return {f"harvested {kind}": programs for kind, programs in sample.items()}


def _degenerate(
    options: QpBenchOptions,
    solvers: Sequence[str],
    bench: QpBench,
    solver: ProgramSolver,
    progress: Progress | None,
) -> None:
    names = [*FEASIBLE_SETS, *INFEASIBLE_SETS]
    for number, name in enumerate(names):
        feasible = name in FEASIBLE_SETS
        for n in VARIABLES:
            tallies = {backend: Tally() for backend in (ACTIVE_SET, *solvers)}
            spent = dict.fromkeys(solvers, 0.0)
            rows = []
            for program in degenerate_set(name, n, options.per_set, options.seed):
                rows.append(program.rows)
                tallies[ACTIVE_SET].count_outcome(program, solver.solve(program), feasible)
                problem = condition(program)
                for backend in solvers:
                    if spent[backend] < options.patience:
                        began = time.perf_counter()
                        tallies[backend].count_answer(program, prepare(backend, problem).solve(problem), feasible)
                        spent[backend] += time.perf_counter() - began
            bench.rows.extend(_row("degenerate", name, n, rows, backend, tally) for backend, tally in tallies.items())
        if progress is not None:
            progress("degenerate sets", number + 1, len(names))


def _time(
    options: QpBenchOptions,
    solvers: Sequence[str],
    bench: QpBench,
    cases: dict[str, list[Program]],
    guessed: set[str],
    solver: ProgramSolver,
    progress: Progress | None,
) -> None:
    python_share = {backend: overhead(backend) for backend in solvers}
    for number, (case, programs) in enumerate(cases.items()):
        names = [ACTIVE_SET, *solvers]
        if case in guessed:
            names += [WARM] + ([WARM_DAQP] if "daqp" in solvers else [])
        tallies = {name: Tally() for name in names}
        spent = dict.fromkeys(names, 0.0)
        for program in programs:
            problem = condition(program)
            feasible = solver.solve(program).status == 0
            calls = {
                name: prepare("daqp" if name == WARM_DAQP else name, problem, warm=name == WARM_DAQP)
                for name in names
                if name not in (ACTIVE_SET, WARM) and spent[name] < options.patience
            }
            samples: dict[str, list[tuple[float, float]]] = {name: [] for name in names}
            for _ in range(ROUNDS):
                for name in names:
                    if name in (ACTIVE_SET, WARM):
                        samples[name].append(_turn(solver, program if name == WARM else program.unguessed()))
                    elif name in calls:
                        began = time.perf_counter()
                        share = python_share["daqp" if name == WARM_DAQP else name]
                        samples[name].append(_foreign_turn(calls[name], problem, share))
                        spent[name] += time.perf_counter() - began
            for name, tally in tallies.items():
                if not samples[name]:
                    continue
                if name in calls:
                    tally.count_answer(program, calls[name].solve(problem), feasible)
                else:
                    tally.count_outcome(program, solver.solve(program if name == WARM else program.unguessed()))
                tally.call.extend(call for call, _ in samples[name])
                tally.native.extend(native for _, native in samples[name])
        variables = max((program.variables for program in programs), default=0)
        rows = [program.rows for program in programs]
        new = [_row("time", case, variables, rows, name, tally) for name, tally in tallies.items()]
        bench.rows.extend(new)
        bench.nearest.extend(_nearest(case, new))
        if progress is not None:
            progress("timing", number + 1, len(cases))


def _turn(solver: ProgramSolver, program: Program) -> tuple[float, float]:
    """Our call as Python sees it, and the solve alone, medians of a few in a row [ns]."""
    call, native = solver.time_call(program, IN_A_ROW)
    return float(np.median(call)), float(np.median(native))


def _foreign_turn(call: PreparedCall, problem: Conditioned, python_share: float) -> tuple[float, float]:
    calls, natives = [], []
    for _ in range(IN_A_ROW):
        answer = call.solve(problem)
        calls.append(float(answer.call))
        natives.append(max(answer.call - python_share, 0.0) if answer.own is None else answer.own)
        if answer.call > SLOW:
            break
    return float(np.median(calls)), float(np.median(natives))


def _nearest(case: str, rows: Iterable[dict[str, Any]]) -> list[dict[str, Any]]:
    """How ours, from nothing and from a guess, stands to the fastest of the others in the same footing."""
    by_name = {row["backend"]: row for row in rows}
    found = []
    for own, warm in ((ACTIVE_SET, False), (WARM, True)):
        # Most take no guess: with one, ours is held against the best that the others can do with or without.
        others = [
            row
            for name, row in by_name.items()
            if name not in (ACTIVE_SET, WARM)
            and (warm or name != WARM_DAQP)
            and row["native_p50"] is not None
            and row["solved"] + row["refused"] > 0.5 * row["problems"]
        ]
        if own in by_name and others:
            best = min(others, key=lambda row: float(row["native_p50"]))
            ours = by_name[own]["native_p50"]
            found.append(
                {
                    "case": case,
                    "backend": own,
                    "native_p50": ours,
                    "nearest": best["backend"],
                    "nearest_p50": best["native_p50"],
                    "ratio": best["native_p50"] / ours,
                }
            )
    return found


def _row(part: str, case: str, variables: int, rows: list[int], backend: str, tally: Tally) -> dict[str, Any]:
    def seconds(values: list[float], share: float) -> float | None:
        value = percentile(values, share)
        return None if value is None else 1e-9 * value

    return {
        "part": part,
        "case": case,
        "variables": variables,
        "rows": float(np.median(rows)) if rows else 0.0,
        "backend": backend,
        "problems": tally.problems,
        "solved": tally.solved,
        "refused": tally.refused,
        "accepted": tally.accepted,
        "gave_up": tally.gave_up,
        "wrong": tally.wrong,
        "unproved": tally.unproved,
        "violation": tally.violation,
        "residual_p99": percentile(tally.residual, 99.0),
        "residual_max": tally.residual_max,
        "iterations": float(np.mean(tally.iterations)) if tally.iterations else None,
        "call_p50": seconds(tally.call, 50.0),
        "call_p99": seconds(tally.call, 99.0),
        "native_p50": seconds(tally.native, 50.0),
        "native_p99": seconds(tally.native, 99.0),
    }


def _version(backend: str) -> str:
    distribution = {"proxqp": "proxsuite", "highs": "highspy", "sip": "sip_python"}.get(backend, backend)
    try:
        return importlib.metadata.version(distribution)
    except importlib.metadata.PackageNotFoundError:
        return ""
