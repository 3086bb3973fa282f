"""Programs of real ticks, taken out of a tick of either method: our solver solves each, or nothing can."""

from collections import Counter

import numpy as np
import pytest
from sphere_scenes import bumpy_ball, random_targets

from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.kernels.hand.kinematics import FINGER_COUNT
from hhsim.kernels.qp.active_set import OPTIMAL
from hhsim.kernels.tick.coupled import solve_coupled
from hhsim.kernels.tick.haptic_input import set_haptic
from hhsim.kernels.tick.method import Coupled, Progressive
from hhsim.kernels.tick.progressive import solve_progressive
from hhsim.solver.backend_programs import coupled_problem, drive_tick, finger_problem, palm_problem
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.options import SolverOptions
from hhsim.solver.qp import QpProblem, QpStatus, solve_active_set

MOVED_BACK = 1e-10
"""Distance [√J] by which rows may be moved back that contradict each other by rounding, as in a tick."""
HAND, BALL = HandModel.default("right"), bumpy_ball(300)


def taken(solver: HandSolver, haptic: HandConfiguration, tick: int) -> list[tuple[str, QpProblem]]:
    """Kind and program of each solve of the next tick, which is run."""
    workspace = solver.workspace
    state, found = workspace.states[0], list[tuple[str, QpProblem]]()
    method = (Coupled if solver.options.method == "coupled" else Progressive)(workspace.tick_options)

    def solve() -> bool:
        if isinstance(method, Coupled) or state.program.is_coupled:
            found.append(("coupled", coupled_problem(state)[0]))
            return bool(solve_coupled(Coupled(workspace.tick_options), state, workspace.qp) == OPTIMAL)
        status = solve_progressive(method, state, workspace.qp)
        step = state.progressive.palm_step * state.problem.inverse_root[:6]
        touched = np.flatnonzero(np.diff(state.contacts.start[1 : FINGER_COUNT + 2])).tolist()
        of_fingers = [("finger", finger_problem(state, finger, step)[0]) for finger in touched]
        found.extend(one for one in [("palm", palm_problem(state)[0]), *of_fingers] if one[1].rhs.size)
        return bool(status == OPTIMAL)

    position, orientation, flexion, abduction = haptic.part(tick, tick + 1)
    set_haptic(workspace.hand, position[0], orientation[0], flexion[0], abduction[0], state)
    drive_tick(workspace, method, solve)
    return found


def residual(problem: QpProblem) -> float:
    """KKT residual of our answer in sizes of the program, of the rows as they are or moved back."""
    answer = solve_active_set(problem, MOVED_BACK)
    assert answer.status is QpStatus.OPTIMAL
    root, _, norm = problem.conditioned()
    moved = QpProblem(problem.stiffness, problem.matrix, problem.rhs - MOVED_BACK * norm, problem.target)
    size = max(float(np.linalg.norm(root * problem.target)), float(np.abs(problem.rhs / norm).max(initial=0.0)))
    return min(one.kkt_residual(answer.x, answer.multiplier) for one in (problem, moved)) / (size or 1.0)


@pytest.mark.parametrize(
    ("method", "kinds"), [("coupled", {"coupled"}), ("progressive", {"palm", "finger"})], ids=["coupled", "progressive"]
)
@pytest.mark.soak
def test_every_program_of_ticks_is_solved_and_taking_them_out_changes_no_tick(method: str, kinds: set[str]) -> None:
    motion, options = random_targets(HAND, 80, 3, hold=20), SolverOptions(method=method)
    whole = HandSolver(HAND, BALL.arrays(), options).run(*motion)
    driven, count = HandSolver(HAND, BALL.arrays(), options), Counter[str]()
    driven.run(*(values[:1] for values in motion))
    for tick in range(1, 80):
        programs = taken(driven, HandConfiguration(*motion), tick)
        np.testing.assert_allclose(driven.workspace.states[0].pose.position, whole.position[tick], atol=1e-7)
        count.update(kind for kind, _ in programs)
        assert max((residual(problem) for _, problem in programs), default=0.0) <= 1e-9
    assert count.total() > 80 and kinds <= set(count)
