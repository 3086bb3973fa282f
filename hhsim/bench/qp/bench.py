"""`hhsim bench qp`: the programs of real ticks, solved by every solver at hand.

Ours solves all of them (`hhsim.bench.qp.recorded_problems`), from nothing and from the guess that the tick had, and
every answer is checked from the program alone (`hhsim.bench.qp.kkt_check`). A fair sample of each kind is solved by
every solver in turns, and timed.
"""

import importlib.metadata
import random
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hhsim.bench.qp.backends import Answer, Conditioned, PreparedCall, condition, other_backends, overhead, prepare
from hhsim.bench.qp.kkt_check import CERTIFIED_RADIUS, certified_radius, residuals
from hhsim.bench.qp.problem_file import ProblemFile
from hhsim.bench.qp.program import Outcome, Program, ProgramSolver
from hhsim.bench.qp.recorded_problems import MOTIONS, OBJECTS, RANDOM, harvest
from hhsim.bench.table import Column
from hhsim.errors import UnknownNameError
from hhsim.kernels.qp.active_set import INFEASIBLE, OPTIMAL
from hhsim.solver.qp import ACTIVE_SET

FloatArray = NDArray[np.float64]
Progress = Callable[[str, int, int], None]

WARM = "active-set, warm"
WARM_DAQP = "daqp, warm"
SAMPLE = 100
"""Programs of a kind that every solver solves."""
PATIENCE = 5.0
"""Time that another solver may spend on a kind [s]; what it has not reached by then it skips."""
ROUNDS = 3
"""Turns that each solver has at each program."""
IN_A_ROW = 5
"""Solves in a turn, of which the median counts: the first finds a cold cache."""
SLOW = 1e6
"""A call that takes longer [ns] is made once a turn."""
SOLVED_LIMIT = 1e-6
"""Largest residual, in sizes of the program, of an answer of another solver that counts as a solution."""
OWN_LIMIT = 1e-9
"""What ours is held to."""

COLUMNS = (
    Column("program", "kind of program"),
    Column("variables", "number of variables, largest"),
    Column("rows", "number of rows, median"),
    Column("solver", "solver; warm: from the guess that the tick had"),
    Column("problems", "programs it was given: ours all, another a sample"),
    Column("solved", "answers with residuals of 1e-6 or less, of ours 1e-9 or less"),
    Column("refused", "rightly refused: the rows contradict each other; ours proves it"),
    Column("missed", "no answer although there is one, a wrong one, or a refusal that is not proved"),
    Column("residual_p99", "KKT residual in sizes of the program, 99th percentile"),
    Column("residual_max", "KKT residual in sizes of the program, largest"),
    Column("iterations", "iterations, mean (ours only)"),
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
        objects: Of the harvest.
        motions: Of the harvest.
        backends: Solvers besides ours; None for all that are installed.
        seed: Of everything random.
    """

    problems: int = 100_000
    objects: tuple[str, ...] = OBJECTS
    motions: tuple[str, ...] = MOTIONS
    backends: tuple[str, ...] | None = None
    seed: int = 0

    def solvers(self) -> list[str]:
        """Solvers besides ours."""
        return other_backends() if self.backends is None else list(self.backends)


def check_names(options: QpBenchOptions) -> None:
    """Look, before the work, whether all that is named is there.

    Raises:
        UnknownNameError: An object, a motion or a solver that there is not.
    """
    from hhsim.mesh.catalogue import object_names
    from hhsim.scene.motion_catalogue import script_names

    for kind, names, known in (
        ("QP solver", options.solvers(), other_backends()),
        ("object", options.objects, object_names()),
        ("motion", options.motions, [*script_names(), RANDOM]),
    ):
        for name in names:
            if name not in known:
                raise UnknownNameError(kind, name, known)


@dataclass
class Tally:
    """How one solver did on the programs of one kind.

    Attributes:
        solved: Answers that are right.
        refused: No answer, and rightly so: the rows contradict each other.
        missed: All else.
        residual: Of each answer to a program that has a solution, in sizes of the program.
        iterations: Of each solve.
        call: Time of each call as Python sees it [ns].
        native: The same without Python's share [ns].
    """

    solved: int = 0
    refused: int = 0
    missed: int = 0
    residual: list[float] = field(default_factory=list)
    iterations: list[int] = field(default_factory=list)
    call: list[float] = field(default_factory=list)
    native: list[float] = field(default_factory=list)

    def count_answer(self, program: Program, answer: Answer, feasible: bool) -> None:
        """Count what another solver answered."""
        if not answer.found:
            self.missed += feasible
            self.refused += not feasible
            return
        found = residuals(program, answer.x, answer.multiplier)
        # What answers a contradiction violates some row; what its other residuals are says nothing.
        residual = found.largest if feasible else found.primal
        if feasible:
            self.residual.append(residual)
        self.solved += residual <= SOLVED_LIMIT
        self.missed += not residual <= SOLVED_LIMIT

    def count_outcome(self, program: Program, outcome: Outcome) -> None:
        """Count what ours answered: its certificate must prove a refusal."""
        self.iterations.append(outcome.iterations)
        if outcome.status == OPTIMAL:
            residual = residuals(program, outcome.x, outcome.multiplier).largest
            if program.relaxation > 0.0 and residual > OWN_LIMIT:
                # Rows that contradict each other by rounding are all moved back, see `kernels.active_set`.
                residual = min(residual, residuals(program, outcome.x, outcome.multiplier, program.relaxation).largest)
            self.residual.append(residual)
            self.solved += residual <= OWN_LIMIT
            self.missed += not residual <= OWN_LIMIT
            return
        proved = (
            outcome.status == INFEASIBLE
            and outcome.certificate is not None
            and certified_radius(program, outcome.certificate) >= CERTIFIED_RADIUS
        )
        self.refused += proved
        self.missed += not proved

    def row(self, kind: str, variables: int, rows: Sequence[int], solver: str) -> dict[str, Any]:
        """A row of the table."""
        call, native = 1e-9 * np.array(self.call), 1e-9 * np.array(self.native)
        return {
            "program": kind,
            "variables": variables,
            "rows": float(np.median(rows)),
            "solver": solver,
            "problems": self.solved + self.refused + self.missed,
            "solved": self.solved,
            "refused": self.refused,
            "missed": self.missed,
            "residual_p99": _percentile(self.residual, 99.0),
            "residual_max": max(self.residual, default=None),
            "iterations": float(np.mean(self.iterations)) if self.iterations else None,
            "call_p50": _percentile(call, 50.0),
            "call_p99": _percentile(call, 99.0),
            "native_p50": _percentile(native, 50.0),
            "native_p99": _percentile(native, 99.0),
        }


@dataclass
class _Kind:
    """What was harvested of one kind of program: how ours did, and a sample."""

    variables: int = 0
    rows: list[int] = field(default_factory=list)
    sample: list[Program] = field(default_factory=list)
    tallies: dict[str, Tally] = field(default_factory=lambda: {ACTIVE_SET: Tally(), WARM: Tally()})


def bench_qp(
    options: QpBenchOptions, programs: Path | None = None, progress: Progress | None = None
) -> list[dict[str, Any]]:
    """Harvest, solve, check and time; returns a row for each kind of program and solver, by the names of `COLUMNS`.

    Args:
        options: What is run; `check_names` looks at it.
        programs: Where the harvested programs go, see `hhsim.bench.qp.problem_file`; None for nowhere.
        progress: Called with what is being done, how much is done and how much there is.

    Raises:
        OutputError: The programs cannot be written.
    """
    solver = ProgramSolver()
    kinds: dict[str, _Kind] = {}
    draw = random.Random(options.seed)
    wanted = {"objects": options.objects, "motions": options.motions, "seed": options.seed, "progress": progress}
    with nullcontext() if programs is None else ProblemFile(programs) as file:
        for program in harvest(options.problems, **wanted):  # type: ignore[arg-type]
            kind = kinds.setdefault(program.kind, _Kind())
            kind.tallies[ACTIVE_SET].count_outcome(program, solver.solve(program.unguessed()))
            kind.tallies[WARM].count_outcome(program, solver.solve(program))
            kind.variables = max(kind.variables, program.variables)
            kind.rows.append(program.rows)
            # A fair sample of a stream of unknown length.
            if len(kind.sample) < SAMPLE:
                kind.sample.append(program)
            elif (place := draw.randrange(len(kind.rows))) < SAMPLE:
                kind.sample[place] = program
            if file is not None:
                file.append(program)
    python_share = {backend: overhead(backend) for backend in options.solvers()}
    for number, kind in enumerate(kinds.values()):
        _time(kind, python_share, solver)
        if progress is not None:
            progress("timing", number + 1, len(kinds))
    return [
        tally.row(name, kind.variables, kind.rows, backend)
        for name, kind in kinds.items()
        for backend, tally in kind.tallies.items()
    ]


def _time(kind: _Kind, python_share: dict[str, float], solver: ProgramSolver) -> None:
    others = [*python_share, *([WARM_DAQP] if "daqp" in python_share else [])]
    kind.tallies |= {name: Tally() for name in others}
    spent = dict.fromkeys(others, 0.0)
    for program in kind.sample:
        problem = condition(program)
        feasible = solver.solve(program).status == OPTIMAL
        calls = {
            name: prepare(name.removesuffix(", warm"), problem, warm=name == WARM_DAQP)
            for name in others
            if spent[name] < PATIENCE
        }
        for _ in range(ROUNDS):
            for name, given in ((ACTIVE_SET, program.unguessed()), (WARM, program)):
                call, native = solver.time_call(given, IN_A_ROW)
                kind.tallies[name].call.append(float(np.median(call)))
                kind.tallies[name].native.append(float(np.median(native)))
            for name, prepared in calls.items():
                began = time.perf_counter()
                times = np.array(list(_turn(prepared, problem, python_share[name.removesuffix(", warm")])))
                spent[name] += time.perf_counter() - began
                kind.tallies[name].call.append(float(np.median(times[:, 0])))
                kind.tallies[name].native.append(float(np.median(times[:, 1])))
        for name, prepared in calls.items():
            kind.tallies[name].count_answer(program, prepared.solve(problem), feasible)


def _turn(call: PreparedCall, problem: Conditioned, python_share: float) -> Iterator[tuple[float, float]]:
    for _ in range(IN_A_ROW):
        answer = call.solve(problem)
        yield answer.call, max(answer.call - python_share, 0.0) if answer.own is None else answer.own
        if answer.call > SLOW:
            return


def missed_programs(rows: Sequence[dict[str, Any]]) -> list[str]:
    """What ours missed, a sentence each; empty where it solved or proved everything."""
    return [
        f"{row['program']}, {row['solver']}: {row['missed']} of {row['problems']} programs not solved to "
        f"{OWN_LIMIT:g} and not proved infeasible"
        for row in rows
        if row["solver"] in (ACTIVE_SET, WARM) and row["missed"]
    ]


def solver_versions(backends: Sequence[str]) -> dict[str, str]:
    """Version of each solver besides ours, as installed; empty where it has none."""
    distributions = {"proxqp": "proxsuite", "highs": "highspy", "sip": "sip_python"}
    found = {}
    for backend in backends:
        try:
            found[backend] = importlib.metadata.version(distributions.get(backend, backend))
        except importlib.metadata.PackageNotFoundError:
            found[backend] = ""
    return found


def _percentile(values: list[float] | FloatArray, share: float) -> float | None:
    return float(np.percentile(values, share)) if len(values) else None
