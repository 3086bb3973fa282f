"""The programs of real ticks, against Coulomb's law by Gauss-Seidel over the contacts on the Delassus matrix.

There each contact by itself is solved exactly with its round cone, in plain numpy; the kernels search cones of four
directions.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from coulomb_program import CoulombProgram, last_program, solve_coulomb, violation
from free_scenes import GRAVITY, free_scene, gripped, solver_of, squeeze_of, tongs_at

from hhsim.hand.configuration import HandConfiguration
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.options import SolverOptions

CLEARANCE = SolverOptions().offset
SETTLED = 0.2 * CLEARANCE
"""A Γ that is off what it is to be by no more than this [m] is as good as found."""
FLOATS = 0.5 * CLEARANCE + SETTLED
"""What slips floats by as much [m]: Γ is to be the slip less half the clearance."""
TICKS = range(4, 40, 5)


def harvest(solver: HandSolver, haptic: HandConfiguration, ticks: range) -> Iterator[CoulombProgram]:
    """The program of every so many ticks in which a contact bears a force, and Γ and directions are found."""
    done = 0
    for tick in ticks:
        solver.run(*haptic.at(slice(done, tick + 1)))
        done = tick + 1
        engine: Any = solver.engine
        if engine.world.loaded.count and not engine.states[0].program.is_relaxed:
            program = last_program(solver)
            # The tick itself says by how much its friction is off the way of the slip, which the program's Γ does not.
            if max(program.astray, float(engine.world.problem.gamma_error)) <= FLOATS:
                yield program


def grasped(mass: float, friction: float, ticks: range) -> Iterator[CoulombProgram]:
    """A whole hand that closes on a cylinder on a table; of each tick its first program, for which Γ is sought."""
    scene = free_scene(mass, friction)
    assert scene.plane is not None
    solver = solver_of(scene.solids[0], scene.hands[0].model, table=scene.plane.height, linearisations=1)
    return harvest(solver, HandConfiguration.of(scene.hands[0].ticks), ticks)


def judge(program: CoulombProgram) -> float:
    """Compare the tick's answer with that of the oracle; how much slides [m]."""
    assert violation(program, program.found, program.multiplier) < FLOATS + SETTLED
    x, forces = solve_coulomb(program)
    assert violation(program, x, forces) < 2.0 * SETTLED
    differs = x - program.found
    bears = (forces[:, 0] > 0.0) | (program.multiplier[:, 0] > 0.0)
    assert np.abs((program.rows @ differs)[bears]).max() < CLEARANCE
    # Where all contacts float by as much, the object does too, and a force of its mass over the square of the tick's
    # period goes with that: 0.1 N for 200 g.
    weight = program.weight[6:9]
    assert np.abs(weight * differs[6:9]).max() < CLEARANCE
    assert np.linalg.norm(differs[6:9] / weight) < 1e-2 * forces[:, 0].sum() + CLEARANCE / weight.min() ** 2
    s = np.einsum("cpi,i->cp", program.rows[:, 1:], x) + program.start
    return float(np.linalg.norm(s[forces[:, 0] > 0.0], axis=1).max())


@pytest.mark.parametrize("torsion", [0.0, 0.003])
def test_what_two_fingers_lose_slips_as_coulomb_says(torsion: float) -> None:
    mass, friction = 0.1, 0.5
    solver, closed = gripped(mass, friction, mass * GRAVITY / (2.0 * friction), torsion=torsion)
    body = solver.engine.world.bodies[0]  # type: ignore[attr-defined]
    # Twice what friction bears.
    body.gravity[2] = -2.0 * friction * squeeze_of(solver) / mass
    slips = [judge(program) for program in harvest(solver, HandConfiguration(*tongs_at(np.full(40, closed))), TICKS)]
    assert len(slips) >= 3 and max(slips) > 10.0 * SETTLED


def test_hand_object_and_table_bear_as_coulomb_says() -> None:
    assert sum(1 for program in grasped(0.2, 0.6, range(90, 240, 15)) if judge(program) >= 0.0) >= 3


@pytest.mark.soak
@pytest.mark.parametrize("mass", [0.02, 0.2])
@pytest.mark.parametrize("friction", [0.2, 0.6])
def test_so_they_do_with_other_masses_and_frictions(mass: float, friction: float) -> None:
    assert len([judge(program) for program in grasped(mass, friction, range(90, 240, 5))]) >= 5
