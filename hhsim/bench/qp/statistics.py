"""How a solver does on a set of programs: counts of each outcome, residuals, times."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from hhsim.bench.qp.backends import Answer
from hhsim.bench.qp.kkt_check import CERTIFIED_RADIUS, certified_radius, residuals
from hhsim.bench.qp.program import Outcome, Program
from hhsim.kernels.qp.active_set import INFEASIBLE, OPTIMAL

FloatArray = NDArray[np.float64]

SOLVED_LIMIT = 1e-6
"""Largest residual, in sizes of the program, of an answer that counts as a solution, for every solver alike."""
OWN_LIMIT = 1e-9
"""What ours is held to."""


@dataclass
class Tally:
    """Outcomes of one solver on one set of programs.

    Attributes:
        solved: Answers within `SOLVED_LIMIT`.
        refused: No answer, and rightly so: the rows contradict each other.
        accepted: An answer although the rows contradict each other, by less than it lets rows be violated.
        gave_up: No answer although there is one.
        wrong: An answer that is none.
        unproved: Called infeasible without a certificate that holds; only ours gives one.
        residual: Largest residual of each answer, in sizes of its program.
        violation: Largest violation of a row in any answer, in sizes of the program.
        iterations: Of each solve.
        call: Time of each call as Python sees it [ns].
        native: The same without Python's share [ns].
    """

    solved: int = 0
    refused: int = 0
    accepted: int = 0
    gave_up: int = 0
    wrong: int = 0
    unproved: int = 0
    residual: list[float] = field(default_factory=list)
    violation: float = 0.0
    iterations: list[int] = field(default_factory=list)
    call: list[float] = field(default_factory=list)
    native: list[float] = field(default_factory=list)

    @property
    def problems(self) -> int:
        """How many outcomes were counted."""
        return self.solved + self.refused + self.accepted + self.gave_up + self.wrong + self.unproved

    @property
    def right(self) -> int:
        """Solved, or rightly refused."""
        return self.solved + self.refused

    @property
    def residual_max(self) -> float:
        """Largest residual; 0 without answers."""
        return max(self.residual, default=0.0)

    @property
    def exact(self) -> bool:
        """Whether every outcome is right, and every answer within `OWN_LIMIT`."""
        return self.right == self.problems and self.residual_max <= OWN_LIMIT

    def count_answer(self, program: Program, answer: Answer, feasible: bool) -> None:
        """Count what a backend answered."""
        if not answer.found:
            if feasible:
                self.gave_up += 1
            else:
                self.refused += 1
            return
        self._count_solution(program, answer.x, answer.multiplier, feasible)

    def count_outcome(self, program: Program, outcome: Outcome, feasible: bool | None = None) -> None:
        """Count what the active set answered; `feasible` None: not known, its certificate must prove a refusal."""
        self.iterations.append(outcome.iterations)
        if outcome.status == OPTIMAL:
            self._count_solution(program, outcome.x, outcome.multiplier, feasible is not False)
        elif outcome.status != INFEASIBLE or feasible is True:
            self.gave_up += 1
        elif outcome.certificate is None or certified_radius(program, outcome.certificate) < CERTIFIED_RADIUS:
            self.unproved += 1
        else:
            self.refused += 1

    def _count_solution(self, program: Program, x: FloatArray, multiplier: FloatArray, feasible: bool) -> None:
        found = residuals(program, x, multiplier)
        residual, violation = found.largest, found.primal
        if program.relaxation > 0.0 and residual > OWN_LIMIT:
            # Rows that contradict each other by rounding are all moved back, see `kernels.active_set`.
            moved = residuals(program, x, multiplier, program.relaxation)
            residual, violation = min((residual, violation), (moved.largest, moved.primal))
        self.violation = max(self.violation, violation)
        if not feasible:
            # An answer to a contradiction violates some row; what its other residuals are says nothing.
            self.accepted += violation <= SOLVED_LIMIT
            self.wrong += violation > SOLVED_LIMIT
            return
        self.residual.append(residual)
        self.solved += residual <= SOLVED_LIMIT
        self.wrong += not residual <= SOLVED_LIMIT


def percentile(values: list[float], share: float) -> float | None:
    """Of a list; None where it is empty."""
    return float(np.percentile(values, share)) if values else None
