"""Several bodies: closed forms of blocks on blocks, conservation, and true distances by another way."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from coulomb_program import last_program, solve_coulomb
from cut_scene import placed_meshes
from free_scenes import all_ticks, body_of, solver_of
from numpy.typing import ArrayLike
from referee_clearance import bodies_clearance

from hhsim.arrays import FloatArray
from hhsim.errors import InputError
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import rotation_matrix
from hhsim.kernels.tick.state import STATUS_START_INSIDE
from hhsim.mesh.mesh import Mesh
from hhsim.mesh.shapes import box_mesh
from hhsim.solver.free_object import FreeObject
from hhsim.solver.hand_solver import HandSolver

DT, G = 1e-3, 9.81
NOTHING: dict[str, Any] = {"gravity": (0.0, 0.0, 0.0), "table": None, "friction": 0.0}
Body = tuple[Mesh, FreeObject]


def block(center: ArrayLike, edges: Any = (0.04, 0.04, 0.04), tilt: float = 0.0, **free: Any) -> Body:
    """A box at a place, turned about y, on a table at z = 0 unless said otherwise."""
    c, s = np.cos(tilt), np.sin(tilt)
    turn = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    mesh = box_mesh(edges).transformed(turn, np.array(center))
    return mesh, FreeObject.of_mesh(mesh, **{"mass": 0.1, "table": 0.0, "friction": 0.6, **free})


def solver_of_three(*bodies: Body, fixed: Sequence[int] = ()) -> HandSolver:
    """A hand and three bodies, of which those that are not given lie far away: one program is compiled for all."""
    far = [block((50.0 + k, 0.0, 0.0), **NOTHING) for k in range(3 - len(bodies))]
    others = [body_of(*body, f"body {k}", fixed=k in fixed) for k, body in enumerate([*bodies[1:], *far], 1)]
    return solver_of(*bodies[0], others=others)


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
    free: dict[str, Any] = {"table": None, "friction": mu}
    solver = solver_of_three(
        block((0.025 + gap) * up, tilt=tilt, **free), block((0, 0, 0), (1.0, 0.2, 0.01), tilt, **free), fixed=[1]
    )
    _, ticks = run(solver, 300)
    way = np.linalg.norm(ticks.bodies[0].shift[-1] - ticks.bodies[0].shift[0])
    # Implicit Euler: n (n + 1) / 2 steps of a Δt², less the first tick's.
    falls = max(0.0, G * (np.sin(tilt) - mu * np.cos(tilt)))
    assert way == pytest.approx(falls * DT**2 * (300 * 301 / 2 - 1), rel=1e-4, abs=2e-6)
    assert np.abs(np.diff(ticks.bodies[1].shift, axis=0)).max() == 0.0


def momentum(body: Any, free: FreeObject) -> FloatArray:
    """Linear and angular momentum about the world's origin at each tick, (T, 6)."""
    turn = rotation_matrix(body.turn)
    place = turn @ np.array(free.center) + body.shift
    spin = np.einsum("tij,jk,tlk,tl->ti", turn, np.array(free.inertia), turn, body.angular_velocity)
    return np.concatenate([free.mass * body.velocity, free.mass * np.cross(place, body.velocity) + spin], axis=1)


def test_two_free_things_that_meet_keep_their_momentum() -> None:
    bodies = [
        block((0.0, 0.0, 0.0), mass=0.1, velocity=(1.0, 0.0, 0.0), **NOTHING),
        block((0.05, 0.0, 0.01), mass=0.3, angular_velocity=(1.0, 2.0, 3.0), **NOTHING),
    ]
    _, ticks = run(solver_of_three(*bodies), 200)
    total = np.sum([momentum(body, free) for body, (_, free) in zip(ticks.bodies, bodies)], axis=0)
    np.testing.assert_allclose(total[:, :3], total[:1, :3].repeat(200, axis=0), atol=1e-12)
    # In the tick in which they meet each turns while the force acts: a share of what it gains, of first order.
    gained = np.abs(momentum(ticks.bodies[1], bodies[1][1])[-1, 3:]).max()
    assert np.abs(total[:, 3:] - total[0, 3:]).max() < 0.02 * gained
    speed = np.linalg.norm(ticks.bodies[1].velocity, axis=1)
    assert speed[0] == 0.0 and speed[-1] > 0.1, "they met"


def test_crossed_planks_lie_on_the_crossings_of_their_edges() -> None:
    solver = solver_of_three(block((0, 0, 0.005), (0.2, 0.02, 0.01)), block((0, 0, 0.01505), (0.02, 0.2, 0.01)))
    record, ticks = run(solver, 300)
    assert not record.status.any()
    upper = ticks.bodies[1]
    assert upper.shift[-1, 2] == pytest.approx(-4.85e-5, abs=1e-6)
    assert np.abs(upper.turn[-1, 1:]).max() < 1e-9 and np.abs(np.diff(upper.shift[-50:], axis=0)).max() == 0.0
    rows = slice(*ticks.bodies[0].contact[-2:])
    crossings = ticks.bodies[0].point[rows][ticks.bodies[0].body[rows] <= -2]
    assert len(crossings)
    np.testing.assert_allclose(np.abs(crossings[:, :2]), 0.01, atol=1e-9)


def test_a_lid_falls_onto_its_pot_and_lies_there_to_the_bit() -> None:
    lid, pot = placed_meshes("pot")
    middle = [0.5 * (mesh.bounds[0] + mesh.bounds[1]) * [1.0, 1.0, 0.0] for mesh in (lid, pot)]
    # Its plug, 6 mm high, is 5.5 mm in the pot.
    above = pot.bounds[1, 2] - lid.bounds[0, 2] - 0.0055
    lid, pot = lid.transformed(np.eye(3), [0.0, 0.0, above] - middle[0]), pot.transformed(np.eye(3), -middle[1])
    bodies = [(mesh, FreeObject.of_mesh(mesh, mass=mass, table=0.0)) for mesh, mass in ((lid, 0.1), (pot, 0.5))]
    solver = solver_of_three(*bodies)
    record, ticks = run(solver, 300)
    assert not record.status.any()
    assert ticks.bodies[0].shift[-1, 2] == pytest.approx(-0.0005, abs=2e-6), "it fell half a millimetre"
    record, ticks = run(solver, 200)
    assert not record.status.any()
    assert all(np.ptp(body.shift, axis=0).max() == 0.0 for body in ticks.bodies[:2])
    np.testing.assert_allclose(ticks.body_wrench[:2, :, 2], [[0.1 * G] * 200, [-0.1 * G] * 200], rtol=1e-9)
    np.testing.assert_allclose(ticks.bodies[1].table_wrench[:, 2], 0.6 * G, rtol=1e-9)


def prism(radius: float, height: float, corners: int = 24) -> Mesh:
    """An upright prism on the plane z = 0."""
    angle = 2.0 * np.pi * np.arange(corners) / corners
    ring = np.stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros(corners)], axis=1)
    points = np.concatenate([ring, ring + [0.0, 0.0, height], [[0.0, 0.0, 0.0], [0.0, 0.0, height]]])
    faces = []
    for i in range(corners):
        j, below, above = (i + 1) % corners, 2 * corners, 2 * corners + 1
        faces += [[i, j, corners + j], [i, corners + j, corners + i], [below, j, i], [above, corners + i, corners + j]]
    return Mesh(points, np.array(faces))


def holed(radius: float, edge: float, height: float, corners: int = 24) -> Mesh:
    """A block on the plane z = 0 with an upright hole through it, whose corners are at a radius."""
    angle = 2.0 * np.pi * np.arange(corners) / corners
    inner = np.stack([np.cos(angle), np.sin(angle), np.zeros(corners)], axis=1)
    outer = 0.5 * edge * inner / np.abs(inner).max(axis=1, keepdims=True)
    points = np.concatenate([ring + [0.0, 0.0, z] for z in (0.0, height) for ring in (radius * inner, outer)])
    faces = []
    for i in range(corners):
        j = (i + 1) % corners
        a, b, c, d = (corners * ring + np.array([i, j]) for ring in range(4))
        for one, two in ((a, b[::-1]), (c[::-1], d), (b, d[::-1]), (a[::-1], c)):
            faces += [[one[0], two[0], two[1]], [one[0], one[1], two[0]]]
    return Mesh(points, np.array(faces))


def test_a_peg_let_go_over_a_hole_goes_in_and_leans_no_more_than_the_gap_allows() -> None:
    gap, radius, depth, corners = 5e-4, 0.01, 0.04, 24
    hole = holed((radius + gap) / np.cos(np.pi / corners), 0.06, depth)
    tilt = np.radians(1.0)
    turn = np.array([[np.cos(tilt), 0.0, np.sin(tilt)], [0.0, 1.0, 0.0], [-np.sin(tilt), 0.0, np.cos(tilt)]])
    peg = prism(radius, 0.06).transformed(turn, np.array([0.0, 0.0, depth + 1e-3]))
    free: dict[str, Any] = {"mass": 0.1, "table": 0.0, "friction": 0.2}
    assert hole.volume > 0.0 and peg.volume > 0.0
    bodies = [(mesh, FreeObject.of_mesh(mesh, **free)) for mesh in (peg, hole)]
    record, ticks = run(solver_of_three(*bodies, fixed=[1]), 400)
    place = ticks.bodies[0]
    axis = rotation_matrix(place.turn) @ turn @ [0.0, 0.0, 1.0]
    foot = rotation_matrix(place.turn) @ [0.0, 0.0, depth + 1e-3] + place.shift
    assert foot[-1, 2] < 1e-3, "it stands on the table"
    inside = foot[:, 2] < 0.5 * depth
    lean = np.arctan2(np.linalg.norm(axis[:, :2], axis=1), axis[:, 2])
    # Foot and rim on opposite walls: a lean takes up depth x sin(lean) of the gap on both sides.
    assert lean[inside].max() <= 2.0 * gap / (depth - foot[inside, 2].max()) + 1e-6
    assert not (record.status & 1).any()


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
        for turn, body, (_, free), edge in zip(turns, ticks.bodies, bodies, edges):
            boxes.append((turn[i] @ np.array(free.center) + body.shift[i], turn[i], edge))
        least = min(least, *(separation(boxes[a], boxes[b]) for a in range(3) for b in range(a)))
        least = min(least, *(c[2] - 0.5 * float(np.abs(turn[2]) @ edge) for c, turn, edge in boxes))
    assert least >= 0.0
    assert not (record.status & 1).any()
    settled = record.status[1:] == 0
    for k, (body, (_, free)) in enumerate(zip(ticks.bodies, bodies)):
        force = body.hand_wrench[:, :3] + body.table_wrench[:, :3] + ticks.body_wrench[k, :, :3]
        gained = free.mass * np.diff(body.velocity, axis=0) / DT
        wanted = force[1:] + [0.0, 0.0, -free.mass * G]
        scale = np.abs(force[1:]).max() + free.mass * G
        assert np.abs(gained - wanted)[settled].max() <= 1e-6 * scale, "Newton's equation"


@pytest.mark.parametrize("inside", [0, 1, 2])
def test_a_hand_that_begins_in_any_of_several_things_is_freed_of_all_of_them(inside: int) -> None:
    # Side by side: the way out of one must not lead into the next.
    places = [np.array([0.0600011 * k, 0.0, 0.0]) for k in range(3)]
    bodies = [block(place, (0.06, 0.06, 0.06), **NOTHING) for place in places]
    solver = solver_of_three(*bodies, fixed=[2])
    record, ticks = run(solver, 1, (places[inside] - (0.0, 0.05, 0.0)).tolist())
    assert record.status[0] == STATUS_START_INSIDE
    # So near, and not where it was freed.
    assert 0.0 <= bodies_clearance(HandModel.default(), [mesh for mesh, _ in bodies], record, ticks.bodies) < 2e-6


def test_things_that_begin_inside_each_other_are_told() -> None:
    solver = solver_of_three(block((0, 0, 0.02)), block((0.01, 0.005, 0.0596)))
    with pytest.raises(InputError, match=r"begins .* mm inside"):
        run(solver, 1)
