"""Programs in the kernels' own layout, apart from the tick that built them, and their solution by the active set.

    minimise ½ |x - x₀|²   subject to   a_i · x >= b_i

in the conditioned variables x = √G δ [√J], see `hhsim.kernels.qp.active_set`.
"""

import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.qp.active_set import INFEASIBLE, OPTIMAL, new_work
from hhsim.kernels.qp.standalone import PROGRAM, solve_repeatedly

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True)
class Program:
    """One program.

    Attributes:
        kind: What it is of: `coupled`, `palm`, `palm+fingers`, `finger`; or the name of a size or of a degenerate set.
        common: Columns that all rows share, shape (0 or 6, m).
        block: Three more, shape (3, m); which variables they stand for is the group's.
        rhs: b, shape (m,).
        group_start: First row of each group, shape (groups,).
        group_stop: Row after the last of each group.
        group_block: First variable of each group's block, -1 for none.
        target: x₀, shape (n,) [√J].
        tolerance: Violation that counts as satisfied [√J].
        relaxation: What contradicting rows may be moved back by [√J].
        guess: Rows expected to be active.
        source: Where it was found.
    """

    kind: str
    common: FloatArray
    block: FloatArray
    rhs: FloatArray
    group_start: IntArray
    group_stop: IntArray
    group_block: IntArray
    target: FloatArray
    tolerance: float
    relaxation: float
    guess: IntArray
    source: str = ""

    @property
    def variables(self) -> int:
        """Their number n."""
        return self.target.size

    @property
    def rows(self) -> int:
        """Their number m."""
        return self.rhs.size

    @property
    def matrix(self) -> FloatArray:
        """The rows a_i, shape (m, n)."""
        dense = np.zeros((self.rows, self.variables))
        dense[:, : len(self.common)] = self.common.T
        for start, stop, first in zip(self.group_start, self.group_stop, self.group_block):
            if first >= 0:
                dense[start:stop, first : first + 3] = self.block[:, start:stop].T
        return dense

    @property
    def size(self) -> float:
        """Size of the numbers in it [√J]: the larger of |x₀| and the largest |b_i| / |a_i|; 1 where all are zero."""
        norm = np.linalg.norm(self.matrix, axis=1)
        apart = np.abs(self.rhs) / np.where(norm > 0.0, norm, np.inf)
        size = max(float(np.linalg.norm(self.target)), float(apart.max(initial=0.0)))
        return size if size > 0.0 else 1.0

    def unguessed(self) -> "Program":
        """The same, to be solved from nothing."""
        return replace(self, guess=self.guess[:0])


@dataclass(frozen=True)
class Outcome:
    """What the active set answered.

    Attributes:
        status: Of `hhsim.kernels.qp.active_set`.
        x: Shape (n,) [√J].
        multiplier: Of each row as given, shape (m,).
        certificate: Farkas' y >= 0 for the normalised rows where infeasible, shape (m,); else None.
        iterations: Rows added and dropped.
        active: Rows of the active set.
        duration: Wall time of each solve [ns].
    """

    status: int
    x: FloatArray
    multiplier: FloatArray
    certificate: FloatArray | None
    iterations: int
    active: IntArray
    duration: IntArray


class ProgramSolver:
    """Solves programs one after the other in one workspace."""

    def __init__(self) -> None:
        """Allocate the workspace."""
        self._program: Any = np.zeros(1, PROGRAM).view(np.recarray)[0]
        self._work = new_work(21, 1)

    def solve(self, program: Program, repeats: int = 1) -> Outcome:
        """Solve a program `repeats` times in one compiled loop."""
        self._load(program)
        work, m = self._work, program.rows
        duration = np.zeros(repeats, dtype=np.int64)
        status = int(solve_repeatedly(self._program, duration, work))
        count = int(work.counts[0])
        active = np.array(work.active[:count])
        multiplier, certificate = np.zeros(m), None
        if status == OPTIMAL:
            multiplier[active] = work.multiplier[:count]
        elif status == INFEASIBLE:
            certificate = np.zeros(m)
            certificate[active] = np.maximum(-work.dual_step[:count], 0.0)
            certificate[work.counts[2]] = 1.0
        return Outcome(
            status=status,
            x=np.array(work.x[: program.variables]),
            multiplier=multiplier,
            certificate=certificate,
            iterations=int(work.counts[1]),
            active=active,
            duration=duration,
        )

    def time_call(self, program: Program, repeats: int) -> tuple[IntArray, IntArray]:
        """Time of calls from Python, and of solves in one compiled loop, shapes (repeats,) [ns]."""
        self._load(program)
        call, native, one = (np.zeros(size, dtype=np.int64) for size in (repeats, repeats, 1))
        for i in range(repeats):
            began = time.perf_counter_ns()
            solve_repeatedly(self._program, one, self._work)
            call[i] = time.perf_counter_ns() - began
        solve_repeatedly(self._program, native, self._work)
        return call, native

    def _load(self, program: Program) -> None:
        record, m, groups = self._program, program.rows, program.group_start.size
        record.common[: len(program.common), :m] = program.common
        record.block[:, :m] = program.block
        record.rhs[:m] = program.rhs
        record.target[: program.variables] = program.target
        record.group_start[:groups] = program.group_start
        record.group_stop[:groups] = program.group_stop
        record.group_block[:groups] = program.group_block
        record.guess[: program.guess.size] = program.guess
        record.guess_count = program.guess.size
        record.variables, record.common_columns = program.variables, len(program.common)
        record.groups = groups
        record.tolerance, record.relaxation = program.tolerance, program.relaxation
