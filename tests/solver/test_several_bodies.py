"""Several bodies: closed forms of blocks on blocks, conservation, and true distances by another way."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from coulomb_program import last_program, solve_coulomb
from free_scenes import all_ticks, body_of, solver_of
from numpy.typing import ArrayLike

from hhsim.arrays import FloatArray
from hhsim.hand.quaternion import rotation_matrix
from hhsim.mesh.shapes import box_mesh
from hhsim.scene.body import Body, Fixed
from hhsim.solver.hand_solver import HandSolver

DT, G = 1e-3, 9.81
NOTHING: dict[str, Any] = {"gravity": (0.0, 0.0, 0.0), "friction": 0.0}


def block(center: ArrayLike, edges: Any = (0.04, 0.04, 0.04), tilt: float = 0.0, **given: Any) -> Body:
    """A box at a place, turned about y."""
    c, s = np.cos(tilt), np.sin(tilt)
    turn = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    mesh = box_mesh(edges).transformed(turn, np.array(center))
    return body_of(mesh, **({} if "moves" in given else {"mass": 0.1}) | given)


def solver_of_three(*bodies: Body, table: float | None = 0.0) -> HandSolver:
    """A hand and three bodies, of which those that are not given are far away: one program is compiled for all."""
    far = [block((50.0 + k, 0.0, 5.0), **NOTHING) for k in range(3 - len(bodies))]
    return solver_of(bodies[0], others=[*bodies[1:], *far], table=table)


def run(solver: HandSolver, ticks: int, place: Sequence[float] = (0.0, 0.0, 5.0)) -> Any:
    """Run ticks of a hand at a place; returns the records of the hand and of the bodies."""
    rows = np.ones((ticks, 1))
    still = rows * place, rows * [1.0, 0.0, 0.0, 0.0], np.zeros((ticks, 5, 3)), np.zeros((ticks, 5))
    return solver.run(*still), all_ticks(solver)


def test_a_stack_of_three_rests_and_each_bears_what_is_above_it() -> None:
    solver = solver_of_three(*(block((0.0, 0.0, 0.02 + 0.040002 * k)) for k in range(3)))
    run(solver, 50)
    record, ticks = run(solver, 500)
    assert not record.status.any()
    for k, body in enumerate(ticks.bodies):
        assert np.abs(np.diff(body.shift, axis=0)).max() == 0.0, "rest is rest"
        np.testing.assert_allclose(body.table_wrench[:, 2], 0.3 * G if k == 0 else 0.0, rtol=1e-9)
        np.testing.assert_allclose(ticks.body_wrench[k, :, 2], (-0.2, 0.1, 0.1)[k] * G, rtol=1e-9)
    program = last_program(solver)
    wanted, _ = solve_coulomb(program)
    np.testing.assert_allclose(program.found, wanted, atol=1e-6 * np.abs(program.target).max())


@pytest.mark.parametrize("mu", [0.3, 0.6])
def test_a_block_on_a_fixed_slope_slides_as_coulomb_says(mu: float) -> None:
    tilt, gap = np.radians(30.0), 2e-6
    up = np.array([np.sin(tilt), 0.0, np.cos(tilt)])
    slope = block((0, 0, 0), (1.0, 0.2, 0.01), tilt, friction=mu, moves=Fixed())
    solver = solver_of_three(block((0.025 + gap) * up, tilt=tilt, friction=mu), slope, table=None)
    _, ticks = run(solver, 300)
    way = np.linalg.norm(ticks.bodies[0].shift[-1] - ticks.bodies[0].shift[0])
    # Implicit Euler: n (n + 1) / 2 steps of a Δt², less the first tick's.
    falls = max(0.0, G * (np.sin(tilt) - mu * np.cos(tilt)))
    assert way == pytest.approx(falls * DT**2 * (300 * 301 / 2 - 1), rel=1e-4, abs=2e-6)
    assert np.abs(np.diff(ticks.bodies[1].shift, axis=0)).max() == 0.0


def momentum(body: Any, of: Body) -> FloatArray:
    """Linear and angular momentum about the world's origin at each tick, (T, 6)."""
    turn, free = rotation_matrix(body.turn), of.solid
    place = turn @ np.array(free.center) + body.shift
    spin = np.einsum("tij,jk,tlk,tl->ti", turn, np.array(free.inertia), turn, body.angular_velocity)
    return np.concatenate([free.mass * body.velocity, free.mass * np.cross(place, body.velocity) + spin], axis=1)


def test_two_free_things_that_meet_keep_their_momentum() -> None:
    bodies = [
        block((0.0, 0.0, 0.0), mass=0.1, velocity=(1.0, 0.0, 0.0), **NOTHING),
        block((0.05, 0.0, 0.01), mass=0.3, angular_velocity=(1.0, 2.0, 3.0), **NOTHING),
    ]
    _, ticks = run(solver_of_three(*bodies, table=None), 200)
    total = np.sum([momentum(body, of) for body, of in zip(ticks.bodies, bodies)], axis=0)
    np.testing.assert_allclose(total[:, :3], total[:1, :3].repeat(200, axis=0), atol=1e-12)
    # In the tick in which they meet each turns while the force acts: a share of what it gains, of first order.
    gained = np.abs(momentum(ticks.bodies[1], bodies[1])[-1, 3:]).max()
    assert np.abs(total[:, 3:] - total[0, 3:]).max() < 0.02 * gained
    speed = np.linalg.norm(ticks.bodies[1].velocity, axis=1)
    assert speed[0] == 0.0 and speed[-1] > 0.1, "they met"


def separation(one: tuple[FloatArray, FloatArray, FloatArray], two: tuple[FloatArray, FloatArray, FloatArray]) -> float:
    """Distance of two boxes along their best separating axis [m], negative where there is none; centre, turn, edges."""
    axes = [*one[1].T, *two[1].T, *(np.cross(a, b) for a in one[1].T for b in two[1].T)]
    found = -np.inf
    for axis in axes:
        size = float(np.linalg.norm(axis))
        if size > 1e-6:
            reach = sum(float(np.abs(axis @ turn) @ edges) for _, turn, edges in (one, two))
            found = max(found, (abs(float(axis @ (two[0] - one[0]))) - 0.5 * reach) / size)
    return found


@pytest.mark.parametrize("seed", range(4))
def test_things_that_fly_about_never_enter_each_other_hand_or_table(seed: int) -> None:
    rng, ticks_run = np.random.default_rng(seed), 400
    edges, mass = rng.uniform(0.01, 0.06, (3, 3)), 10.0 ** rng.uniform(-3.0, 1.0, 3)
    bodies, height = [], 0.0
    for k in range(3):
        height += 0.5 * edges[k, 2] + rng.uniform(2e-6, 0.01)
        place = (*rng.uniform(-0.01, 0.01, 2), height)
        motion: dict[str, Any] = {
            "velocity": tuple(rng.uniform(-1, 1, 3)),
            "angular_velocity": tuple(rng.uniform(-20, 20, 3)),
        }
        bodies.append(block(place, edges[k], mass=mass[k], friction=rng.uniform(0, 1), **motion))
        height += 0.5 * edges[k, 2]
    solver = solver_of_three(*bodies)
    way = np.linspace([-0.12, 0.0, 0.05], [0.12, 0.0, 0.03], ticks_run)
    given = np.ones((ticks_run, 1)) * [1.0, 0.0, 0.0, 0.0], np.zeros((ticks_run, 5, 3)), np.zeros((ticks_run, 5))
    record = solver.run(way, *given)
    ticks = all_ticks(solver)
    turns = [rotation_matrix(body.turn) for body in ticks.bodies]
    least = np.inf
    for i in range(0, ticks_run, 4):
        boxes = []
        for turn, body, of, edge in zip(turns, ticks.bodies, bodies, edges):
            boxes.append((turn[i] @ np.array(of.solid.center) + body.shift[i], turn[i], edge))
        least = min(least, *(separation(boxes[a], boxes[b]) for a in range(3) for b in range(a)))
        least = min(least, *(c[2] - 0.5 * float(np.abs(turn[2]) @ edge) for c, turn, edge in boxes))
    assert least >= 0.0
    assert not (record.status & 1).any()
    settled = record.status[1:] == 0
    for k, (body, of) in enumerate(zip(ticks.bodies, bodies)):
        free = of.solid
        force = body.hand_wrench[:, :3] + body.table_wrench[:, :3] + ticks.body_wrench[k, :, :3]
        gained = free.mass * np.diff(body.velocity, axis=0) / DT
        wanted = force[1:] + [0.0, 0.0, -free.mass * G]
        scale = np.abs(force[1:]).max() + free.mass * G
        assert np.abs(gained - wanted)[settled].max() <= 1e-6 * scale, "Newton's equation"
