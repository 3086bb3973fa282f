"""The correction for curvature against the dense solution of the same equations, and what it does for convergence."""

from typing import Any

import numpy as np
import pytest
from harvested_programs import HAND, TICKS, harvest, multipliers, optimum
from sphere_scenes import CURL, bumpy_ball, random_targets, solve_prepared

from hhsim.arrays import FloatArray
from hhsim.kernels.hand.kinematics import DOF
from hhsim.kernels.qp.active_set import OPTIMAL
from hhsim.kernels.tick.curvature import curvature_product
from hhsim.kernels.tick.second_order import STRETCH
from hhsim.motion.analytic_motion import still
from hhsim.solver.contact_qp import coupled_problem
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.options import SolverOptions, Stiffness

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


def test_a_pressed_hold_settles_in_a_few_ticks() -> None:
    # Without the correction it would approach its optimum by a constant factor a linearisation.
    goal = still([0.0, -0.045, 0.048], flexion=CURL)
    for leaves in (200, 2000):
        solver = HandSolver(HAND, bumpy_ball(leaves).arrays(), SolverOptions())
        solver.run(*still([0.0, -0.045, 0.15]).line(goal, 249))
        record = solver.run(*goal.hold(39))
        moved = np.linalg.norm(np.diff(record.joints, axis=0), axis=3).max(axis=(1, 2))
        assert moved[20:].max() < 1e-9
