"""Programs of real ticks of each method, solved again by other solvers, and the correction of their steps."""

from typing import Any

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray
from qp_problems import energy
from sphere_scenes import bumpy_ball, prepared, random_targets, solve_prepared

from hhsim.arrays import FloatArray
from hhsim.bench.robustness.random_targets import RandomTargets, StressOptions
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.kernels.contact.linearise import ROW_CAPACITY
from hhsim.kernels.hand.kinematics import DOF
from hhsim.kernels.qp.active_set import OPTIMAL
from hhsim.kernels.tick.curvature import curvature_product
from hhsim.kernels.tick.second_order import STRETCH
from hhsim.kernels.tick.state import STATUS_LAG, STATUS_STUCK
from hhsim.mesh.features import mesh_features
from hhsim.solver.backend_programs import coupled_problem, finger_problem, palm_problem
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.options import UNBOUNDED, UNLIMITED, SolverOptions, Stiffness
from hhsim.solver.qp import QpProblem, solve

HAND = HandModel.default("right")
TREE = bumpy_ball(600)
TICKS = 480


def harvest(method: str, motion: HandConfiguration, every: int) -> Any:
    """A solver standing before every `every`-th tick of a motion at which pairs are near, its first program prepared.

    Without a budget, so that the programs are the same whatever work is said to cost, and without bound.
    """
    options = SolverOptions(method=method, budget=UNLIMITED, snap_speed=UNBOUNDED)
    solver = HandSolver(HAND, TREE.arrays(), options)
    ticks = len(motion.position)
    for first in range(0, ticks, every):
        solver.run(*motion.part(first, first + every))
        if first + every < ticks and prepared(solver, motion, first + every) > 0:
            yield solver


def multipliers(solver: HandSolver, rows: NDArray[np.int64]) -> FloatArray:
    """λ of each of these rows in the step that the solver proposes, shape (rows,)."""
    step = solver.workspace.states[0].step
    whole = np.zeros(ROW_CAPACITY)
    np.add.at(whole, step.row[: step.count], step.multiplier[: step.count])
    found: FloatArray = whole[rows]
    return found


def optimum(problem: QpProblem, multiplier: FloatArray) -> FloatArray:
    """The point that these multipliers hold: G (δ - δ*) = Aᵀ λ."""
    return problem.target + problem.matrix.T @ multiplier / problem.stiffness


@pytest.mark.parametrize("seed", [0, 1])
# An interior-point method ends near the vertex and not at it: to 1e-8 of the energy, and in a joint to more.
@pytest.mark.parametrize(("backend", "exact"), [("quadprog", 1e-9), ("clarabel", 1e-7)])
def test_another_solver_finds_the_same_optimum(backend: str, exact: float, seed: int) -> None:
    programs, loaded = 0, 0
    for solver in harvest("coupled", random_targets(HAND, TICKS, seed), 7):
        assert solve_prepared(solver) == OPTIMAL
        problem, rows = coupled_problem(solver.workspace.states[0])
        multiplier = multipliers(solver, rows)
        own = optimum(problem, multiplier)
        theirs = solve(problem, backend)
        assert theirs.status == "optimal", theirs.message
        assert (multiplier >= 0.0).all()
        np.testing.assert_allclose(own, theirs.x, rtol=1e-6, atol=exact)
        assert energy(problem, own) == pytest.approx(energy(problem, theirs.x), rel=1e-8, abs=1e-12)
        assert problem.kkt_residual(own, multiplier) < 1e-8
        programs += 1
        loaded += bool(multiplier.any())
    assert programs > 20
    assert loaded > 10


def joined(state: Any) -> list[int]:
    """Fingers to which the palm yielded."""
    return [f for f in range(5) if state.progressive.yields[f] >= 0]


@pytest.mark.parametrize("seed", [1, 3])
def test_palm_and_fingers_are_the_optima_of_their_own_programs(seed: int) -> None:
    plain, palms, fingers = 0, 0, 0
    for solver in harvest("progressive", random_targets(HAND, 2 * TICKS, seed), 7):
        state = solver.workspace.states[0]
        assert solve_prepared(solver) == OPTIMAL
        if joined(state):
            continue
        plain += 1
        problem, rows = palm_problem(state)
        assert problem.target.size == 6
        if rows.size:
            theirs = solve(problem, "quadprog")
            own = optimum(problem, multipliers(solver, rows))
            np.testing.assert_allclose(own, theirs.x, rtol=1e-6, atol=1e-9)
            palms += bool(theirs.multiplier.any())
        else:
            np.testing.assert_allclose(state.step.delta[:6], problem.target, atol=1e-12)
        for finger in range(5):
            problem, rows = finger_problem(state, finger, state.step.delta[:6])
            theirs = solve(problem, "quadprog")
            multiplier = multipliers(solver, rows)
            if state.contacts.start[finger + 2] == state.contacts.start[finger + 1]:
                assert not multiplier.any()
                np.testing.assert_allclose(state.step.delta[6 + 3 * finger : 9 + 3 * finger], theirs.x, atol=1e-9)
                continue
            own = optimum(problem, multiplier)
            np.testing.assert_allclose(own, theirs.x, rtol=1e-6, atol=1e-9)
            assert energy(problem, own) == pytest.approx(energy(problem, theirs.x), rel=1e-8, abs=1e-12)
            fingers += bool(multiplier.any())
    assert plain > 10
    assert palms > 5
    assert fingers > 5


@pytest.mark.parametrize("seed", [2, 3, 4])
def test_every_step_satisfies_all_rows_of_the_whole_hand(seed: int) -> None:
    solved, yielded = 0, 0
    for solver in harvest("progressive", random_targets(HAND, TICKS, seed, sweep=True), 5):
        state = solver.workspace.states[0]
        problem, _ = coupled_problem(state)
        if solve_prepared(solver) != OPTIMAL:
            assert solve(problem, "quadprog").status == "infeasible"
            continue
        assert (problem.matrix @ state.step.delta - problem.rhs).min() > -1e-9
        solved += 1
        yielded += bool(joined(state))
    assert solved > 20
    assert yielded > 3


def palm_first(problem: QpProblem, fingers: list[int]) -> FloatArray:
    """The palm's best step (6,) that leaves these fingers a way out: their joints cost all but nothing."""
    columns = [*range(6), *(6 + 3 * f + k for f in fingers for k in range(3))]
    others = [j for j in range(21) if j not in columns]
    rows = ~problem.matrix[:, others].any(axis=1)
    stiffness = problem.stiffness[columns].copy()
    stiffness[6:] *= 1e-7
    answer = solve(
        QpProblem(stiffness, problem.matrix[rows][:, columns], problem.rhs[rows], problem.target[columns]), "quadprog"
    )
    return answer.x[:6]


@pytest.mark.parametrize("seed", [5, 6])
def test_a_yielding_palm_yields_no_more_than_it_must(seed: int) -> None:
    seen = 0
    for solver in harvest("progressive", random_targets(HAND, TICKS, seed), 5):
        state = solver.workspace.states[0]
        if solve_prepared(solver) != OPTIMAL or not joined(state):
            continue
        problem, _ = coupled_problem(state)
        stiffness, target = problem.stiffness[:6], problem.target[:6]
        best, found = palm_first(problem, joined(state)), state.step.delta[:6]
        energy = [0.5 * float((x - target) @ (stiffness * (x - target))) for x in (best, found)]
        # Joints keep a ten-thousandth of their stiffness in the palm's program, so that it is all but lexicographic.
        spare = 0.5e-4 * float(problem.stiffness[6:] @ problem.target[6:] ** 2)
        assert energy[1] <= energy[0] + spare + 1e-2 * energy[0]
        seen += 1
    assert seen > 5


def test_a_hand_arrives_where_the_users_rests_and_does_not_go_round_and_round() -> None:
    # A thin plate pinched between palm and fingers: with few linearisations the palm yields, arrives and is pulled
    # back, every five ticks.
    plate = trimesh.creation.box([0.12, 0.12, 0.0005])
    mesh, _ = mesh_features(np.asarray(plate.vertices), np.asarray(plate.faces, np.int64), closed=True)
    targets = RandomTargets(HAND, 537, StressOptions(), center=np.array([1e-4, 0.0, 0.0]), height=0.0).take(300)
    solver = HandSolver(HAND, mesh, SolverOptions(method="progressive", surface="mesh", linearisations=3))
    status = solver.run(*targets.hold(1000)).status
    arrived = (status & (STATUS_LAG | STATUS_STUCK)) == 0
    assert arrived[300:].any()
    assert arrived[-500:].all()


ROOT = np.sqrt(Stiffness().diagonal())


def lagrangian_curvature(state: Any) -> FloatArray:
    """Σ λ_i √G⁻¹ ∇²d_i √G⁻¹ of the proposed step's multipliers, shape (21, 21)."""
    step = state.step
    columns = np.empty((DOF, DOF))
    for j, direction in enumerate(np.eye(DOF)):
        curvature_product(state.pose, state.contacts, step.row, step.multiplier, int(step.count), direction, columns[j])
    return columns / ROOT / ROOT[:, None]


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_correction_is_newtons_on_the_loaded_rows(seed: int) -> None:
    compared, shortened = 0, 0
    for solver in harvest("coupled", random_targets(HAND, TICKS, seed), 4):
        state, longest = solver.workspace.states[0], solver.workspace.tick_options.longest_correction
        assert solve_prepared(solver) == OPTIMAL
        problem, rows = coupled_problem(state)
        multiplier = multipliers(solver, rows)
        x = ROOT * optimum(problem, multiplier)
        correction = ROOT * state.step.delta - x
        assert np.linalg.norm(correction) <= longest * (1.0 + 1e-9)
        loaded = multiplier > 0.0
        assert (problem.matrix @ state.step.delta - problem.rhs).min() > -1e-10
        if not loaded.any():
            np.testing.assert_allclose(correction, 0.0, atol=1e-9)
            continue
        normals = problem.matrix[loaded] / ROOT
        np.testing.assert_allclose(normals @ correction, 0.0, atol=1e-9 * np.abs(normals).max())
        # An orthonormal basis of the directions that keep all loaded rows.
        _, size, basis = np.linalg.svd(normals)
        free = basis[int(np.sum(size > 1e-9 * size[0])) :]
        curvature = lagrangian_curvature(state)
        reduced = free @ (np.eye(DOF) - curvature) @ free.T
        if np.linalg.eigvalsh(reduced).min() < 2.0 / STRETCH:
            continue
        newton = free.T @ np.linalg.solve(reduced, free @ curvature @ x)
        slack = (problem.matrix @ ((x + newton) / ROOT) - problem.rhs)[~loaded]
        if np.linalg.norm(newton) > longest or (slack < 0.0).any():
            shortened += 1
            assert np.linalg.norm(correction) <= np.linalg.norm(newton) * 1.1
            continue
        # Conjugate gradients stop at a hundredth of the residual.
        apart = float(np.linalg.norm(correction - newton))
        assert apart <= 0.05 * float(np.linalg.norm(newton)) + solver.workspace.tick_options.tolerance * STRETCH
        compared += 1
    assert compared > 5
    assert shortened > 0
