"""A free object's known answers, and its programs against Coulomb's law by Gauss-Seidel on the Delassus matrix."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
import trimesh
from coulomb_program import CoulombProgram, last_program, solve_coulomb, violation
from free_scenes import (
    GRAVITY,
    HALF_APART,
    REACH,
    TIP,
    body_of,
    box,
    far_hand,
    free_scene,
    gripped,
    solver_of,
    squeeze_of,
    tongs,
    tongs_at,
)

from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import rotation_matrix
from hhsim.kernels.tick.block import TickRecord
from hhsim.mesh.mesh import Mesh
from hhsim.scene.body import Free, HalfSpace
from hhsim.solver.options import SolverOptions, Stiffness
from hhsim.solver.solver import HandSolver
from hhsim.trees.contact_surface import contact_surface
from hhsim.trees.sphere_tree import SphereTree

DT = 1e-3


def tilted(degrees: float) -> tuple[float, float, float]:
    angle = np.radians(degrees)
    return (GRAVITY * float(np.sin(angle)), 0.0, -GRAVITY * float(np.cos(angle)))


def alone(mesh: Mesh, ticks: int, table: float, **free: Any) -> tuple[TickRecord, Any]:
    """What the ticks of an object without a hand near it record."""
    solver = solver_of(body_of(mesh, **free), table=table)
    return solver.run(*far_hand(ticks)), solver.object_ticks


BLOCK = box((0.05, 0.05, 0.05))


def test_a_block_that_friction_holds_stays_to_the_bit() -> None:
    _, moved = alone(BLOCK, 1000, mass=0.1, friction=0.6, table=-0.025, gravity=tilted(30.0))
    assert (moved.shift == moved.shift[0]).all() and (moved.turn == moved.turn[0]).all()
    assert moved.table_wrench[-1, 0] == pytest.approx(-0.1 * tilted(30.0)[0], rel=1e-4)


@pytest.mark.parametrize("friction", [0.6, 0.1])
def test_a_ball_on_a_slope_rolls_or_slides_and_spins_up_by_friction(friction: float) -> None:
    radius, ticks = 0.038, 500
    along, _, down = tilted(30.0)
    rows = tuple(map(tuple, (0.4 * 0.2 * radius**2 * np.eye(3)).tolist()))
    rolling = Free(0.2, (0.0, 0.0, 0.0), rows, gravity=(along, 0.0, down))
    body, plane = body_of(BLOCK, moves=rolling, friction=friction), HalfSpace("table", -radius)
    ball = SphereTree(np.zeros((2, 3)), np.full(2, radius), np.array([0, 1]), np.array([-1, 0]))
    solver = HandSolver(HandModel.default(), contact_surface("spheres", None, ball), SolverOptions(), body, (plane,))
    solver.run(*far_hand(ticks))
    moved = solver.object_ticks
    # It rolls with 5/7 of the slope's share of gravity if friction bears the other 2/7.
    rolls = friction * -down > 2.0 / 7.0 * along
    pull, spun = (5.0 / 7.0 * along,) * 2 if rolls else (along + friction * down, -2.5 * friction * down)
    way = pull * DT**2 * (ticks * (ticks + 1) / 2 - 1)
    assert moved.shift[-1, 0] - moved.shift[0, 0] == pytest.approx(way, rel=1e-2)
    assert moved.angular_velocity[-1, 1] == pytest.approx(spun / radius * ticks * DT, rel=1e-2)


@pytest.mark.parametrize(("share", "tips"), [(0.98, False), (1.01, True)])
def test_a_pushed_cube_slides_or_tips_by_the_height_of_the_fingertip(share: float, tips: bool) -> None:
    side, friction, ticks = 0.07, 0.8, 800
    mesh = box([side] * 3, (REACH + TIP + 0.001 + 0.5 * side, HALF_APART, 0.0))
    about = {"table": -0.5 * side, "table_friction": friction}
    stiffness = Stiffness(translation=1000.0, rotation=1000.0, flexion=14.5)
    body = body_of(mesh, mass=0.24, friction=0.0)
    solver = solver_of(body, tongs(), **about, fingers=("index",), stiffness=stiffness)
    height = share * 0.5 * side / friction - 0.5 * side
    way = 0.015 * np.arange(1, ticks + 1) / ticks
    solver.run(*tongs_at(np.zeros(ticks), np.stack([way, 0.0 * way, np.full(ticks, height)], axis=1)))
    turned = 2.0 * np.arccos(np.abs(solver.object_ticks.turn[:, 0]).clip(max=1.0)).max()
    assert (turned > np.radians(1.0)) is np.bool_(tips)


def test_a_body_in_free_flight_keeps_its_momentum() -> None:
    mesh = box((0.03, 0.05, 0.08))
    velocity, spin = (0.3, -0.2, 0.1), (3.0, 1.0, -2.0)
    body = body_of(mesh, mass=0.3, gravity=(0.0, 0.0, 0.0), velocity=velocity, angular_velocity=spin)
    solver = solver_of(body)
    solver.run(*far_hand(500))
    moved = solver.object_ticks
    assert np.abs(moved.velocity - velocity).max() < 1e-9
    inertia, energy, momenta = np.array(body.solid.inertia), [], []
    for turn, rate in zip(moved.turn[::50], moved.angular_velocity[::50]):
        rotation = rotation_matrix(turn)
        momenta.append(rotation @ inertia @ rotation.T @ rate)
        energy.append(float(rate @ momenta[-1]))
    start = inertia @ np.array(spin)
    assert np.linalg.norm(momenta - start, axis=1).max() < 1e-2 * np.linalg.norm(start)
    assert (np.diff(energy) <= 0.0).all()


@pytest.mark.parametrize(("mass", "friction"), [(0.01, 0.2), (0.01, 1.0), (0.1, 0.5), (1.0, 0.2), (1.0, 1.0)])
def test_a_pinch_holds_up_to_its_threshold_and_no_further(mass: float, friction: float) -> None:
    solver, closed = gripped(mass, friction, mass * GRAVITY / (2.0 * friction))
    body = solver.engine.world.bodies[0]  # type: ignore[attr-defined]
    squeeze = squeeze_of(solver)
    pulled = 0.0
    for share, holds in ((0.5, True), (0.9, True), (0.99, True), (1.01, False)):
        for part in np.linspace(pulled, share, 40):
            # Slowly: what is let go at once swings to twice as far.
            body.gravity[2] = -part * friction * squeeze / mass
            record = solver.run(*tongs_at(np.full(10, closed)))
        pulled = share
        record = solver.run(*tongs_at(np.full(100, closed)))
        moved = solver.object_ticks
        slips = moved.slip[moved.contact[-2] : moved.contact[-1]]
        assert (bool(slips.size) and float(slips.max()) < 1e-8) is holds, (share, slips)
        assert not record.status.any()


def test_a_contact_bears_torsion_up_to_its_radius_times_its_force() -> None:
    solver, closed = gripped(0.1, 0.5, 1.0, torsion=0.003)
    body = solver.engine.world.bodies[0]  # type: ignore[attr-defined]
    squeeze = squeeze_of(solver)
    body.damping = 0.0
    body.inverse_root[:] *= np.sqrt(1.0 + 20.0 * DT)
    body.spin[:] = body.axes @ np.array([0.0, 30.0, 0.0])
    solver.run(*tongs_at(np.full(5, closed)))
    moved = solver.object_ticks
    braked = np.diff(moved.angular_velocity[:, 1]) / DT
    inertia = np.array(solver.engine.bodies[0].solid.inertia)[1, 1]  # type: ignore[attr-defined]
    assert braked == pytest.approx(np.full(4, -0.003 * squeeze / inertia), rel=1e-2)


def test_what_has_tumbled_rests_and_its_table_bears_its_weight() -> None:
    mass = 0.3
    mesh = box((0.1, 0.06, 0.02))
    moving = {"velocity": (0.5, 0.0, 0.0), "angular_velocity": (3.0, 5.0, 0.5)}
    _, moved = alone(mesh, 800, mass=mass, friction=0.5, table=-0.3, **moving)
    resting = slice(-100, None)
    assert (moved.shift[resting] == moved.shift[-1]).all()
    assert np.abs(moved.table_wrench[resting, 2] - mass * GRAVITY).max() < 1e-10


def nearly_flat(radius: float, thick: float, curvature: float) -> Mesh:
    """A disc of a radius and a thickness [m] whose underside is part of a sphere of a radius [m], in many corners."""
    around = np.linspace(0.0, 2.0 * np.pi, 64, endpoint=False)
    from_middle = np.linspace(0.0, radius, 17)[:, None]
    x, y = from_middle * np.cos(around), from_middle * np.sin(around)
    under = np.stack([x, y, np.broadcast_to(from_middle**2 / (2.0 * curvature), x.shape)], axis=-1).reshape(-1, 3)
    solid = trimesh.convex.convex_hull(np.vstack([under, under[-64:] + [0.0, 0.0, thick]]))
    return Mesh(solid.vertices, solid.faces, name="disc")


@pytest.mark.parametrize("curvature", [30.0, 100.0])
def test_what_is_nearly_flat_rocks_on_its_table_and_is_never_stuck(curvature: float) -> None:
    mesh = nearly_flat(0.03, 0.02, curvature)
    moving = {"velocity": (0.05, 0.0, 0.0), "angular_velocity": (1.0, 0.5, 0.0)}
    record, moved = alone(mesh, 100, mass=0.1, friction=0.1, table=-1e-4, **moving)
    assert (record.status == 0).all()
    assert moved.table_distance.min() >= 0.0
    assert moved.shift[-1, 0] > 1e-3


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
        if engine.world.loaded.count and not engine.states[0].fallback.is_relaxed:
            program = last_program(solver)
            # The tick itself says by how much its friction is off the way of the slip, which the program's Γ does not.
            if max(program.astray, float(engine.world.problem.gamma_error)) <= FLOATS:
                yield program


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
    slips = [judge(program) for program in harvest(solver, tongs_at(np.full(40, closed)), TICKS)]
    assert len(slips) >= 3 and max(slips) > 10.0 * SETTLED


def test_hand_object_and_table_bear_as_coulomb_says() -> None:
    # A whole hand that closes on a cylinder on a table; of each tick the first program, for which Γ is sought.
    scene = free_scene(0.2, 0.6)
    solver = solver_of(scene.solids[0], scene.hands[0].model, table=scene.plane.height, linearisations=1)
    programs = harvest(solver, HandConfiguration.of(scene.hands[0].ticks), range(90, 240, 15))
    assert sum(judge(program) >= 0.0 for program in programs) >= 3
