"""Several bodies, free and driven: closed forms, conservation, true distances by another way, and what is refused."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from coulomb_program import last_program, solve_coulomb
from free_scenes import body_of, box, far_hand, solver_of
from mesh_oracle import shift_of_boxes
from numpy.typing import ArrayLike

from hhsim.arrays import FloatArray
from hhsim.bench.robustness.random_targets import RandomTargets
from hhsim.bench.robustness.safety import recorded_penetration
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import quaternion, rotation_matrix
from hhsim.mesh.catalogue import load_object
from hhsim.mesh.mesh import Mesh
from hhsim.mesh.shapes import box_mesh
from hhsim.motion.analytic_motion import still
from hhsim.motion.trajectory import ObjectMotion, RigidMotion
from hhsim.scene.body import Body, Driven, Fixed, HalfSpace
from hhsim.solver.solver import HandSolver

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
    return solver.run(*still(place, ticks=ticks)), solver.solver.all_ticks


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
    record = solver.run(*still(np.zeros(3), ticks=ticks_run)._replace(position=way))
    ticks = solver.solver.all_ticks
    turns = [rotation_matrix(body.turn) for body in ticks.bodies]
    least = np.inf
    for i in range(0, ticks_run, 4):
        boxes = [of.mesh.vertices @ turn[i].T + body.shift[i] for turn, body, of in zip(turns, ticks.bodies, bodies)]
        least = min(least, *(-shift_of_boxes(boxes[a], boxes[b]) for a in range(3) for b in range(a)))
        least = min(least, *(corners[:, 2].min() for corners in boxes))
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


GAP = 2e-6


def shifted(way: FloatArray, direction: Any = (1.0, 0.0, 0.0)) -> RigidMotion:
    """Motion by ways [m] along a direction, shape (T,)."""
    return RigidMotion(np.tile([1.0, 0.0, 0.0, 0.0], (len(way), 1)), way[:, None] * np.array(direction))


def turned(angle: FloatArray, axis: Any = (0.0, 1.0, 0.0)) -> RigidMotion:
    """Motion by angles [rad] about an axis through the origin, shape (T,)."""
    return RigidMotion(quaternion(angle[:, None] * np.array(axis)), np.zeros((len(angle), 3)))


def play(body: Body, driven: Mesh, motion: RigidMotion, *others: Body, friction: float = 0.6) -> Any:
    """Records of the hand, far away, and of a free body, a driven one, and others."""
    goes = Driven(ObjectMotion(motion.shift, motion.turn))
    solver = solver_of(body, others=(body_of(driven, "driven", moves=goes, friction=friction), *others))
    return solver.run(*far_hand(len(motion.turn))), solver.solver.all_ticks


def rider(mass: float = 0.1, friction: float = 0.6, **given: Any) -> Body:
    """A cube of 40 mm that stands 2 µm above z = 0."""
    return body_of(box((0.04, 0.04, 0.04), (0.0, 0.0, 0.02 + GAP)), mass=mass, friction=friction, **given)


PLATE = box((1.0, 0.2, 0.02), (0.0, 0.0, -0.01))


@pytest.mark.parametrize("share", [0.5, 0.99, 1.5])
def test_a_block_rides_on_a_plate_unless_it_is_drawn_away_faster_than_friction_accelerates(share: float) -> None:
    ticks, mu = 400, 0.5
    speed = share * mu * G * DT * np.clip(np.arange(ticks) - 20, 0, None)
    record, found = play(rider(friction=mu), PLATE, shifted(np.cumsum(speed * DT)), friction=mu)
    assert not record.status.any()
    rides, drives = found.bodies[:2]
    np.testing.assert_allclose(drives.shift[:, 0], np.cumsum(speed * DT), atol=1e-9)
    np.testing.assert_allclose(rides.velocity[-1, 0], min(share, 1.0) / share * speed[-1], rtol=1e-3)
    np.testing.assert_allclose(found.body_wrench[0, -100:, 0].mean(), 0.1 * min(share, 1.0) * mu * G, rtol=1e-3)
    np.testing.assert_allclose(found.body_wrench[1, :, :3], -found.body_wrench[0, :, :3], atol=1e-9)
    if share < 1.0:
        slid = rides.shift[:, 0] - drives.shift[:, 0]
        assert np.abs(slid - slid[19]).max() < 1e-6


def test_a_block_on_a_plate_that_tilts_slides_at_the_angle_of_friction() -> None:
    ticks, mu = 900, 0.4
    angle = 0.6 * np.arange(ticks) / ticks
    record, found = play(rider(friction=mu), PLATE, turned(angle), friction=mu)
    assert not record.status.any()
    first, second = found.bodies[:2]
    back = RigidMotion(second.turn, second.shift).seen_points(
        RigidMotion(first.turn, first.shift).points(np.zeros((ticks, 3)))
    )
    slides = int(np.argmax(np.linalg.norm(back - back[0], axis=1) > 1e-4))
    # Where it has slid by 0.1 mm the plate is a little steeper: d = ½ g' Δt² with g' from the angle beyond.
    assert np.arctan(mu) - 1e-3 < angle[slides] < np.arctan(mu) + 0.03


def test_a_press_stops_where_a_block_is_in_its_way_and_goes_on_where_it_is_not() -> None:
    ticks = 240
    way = np.interp(np.arange(ticks), [0, 100, 140, 200], [0.0, 0.005, 0.005, -0.002])
    press = box((0.1, 0.1, 0.02), (0.0, 0.0, 0.04 + GAP + 0.0125))
    anvil = body_of(PLATE, "anvil", moves=Fixed())
    _, found = play(rider(), press, shifted(way, (0.0, 0.0, -1.0)), anvil)
    block_z, press_z = found.bodies[0].shift[:, 2], found.bodies[1].shift[:, 2]
    top, bottom = 0.04 + GAP + block_z, 0.0425 + GAP + press_z
    assert (bottom - top).min() > 0.0 and block_z.min() > -GAP, "nothing is entered"
    assert np.abs(press_z + np.minimum(way, 0.0025)).max() < 5e-6, "it stops at the block, and comes back as recorded"
    assert np.abs(press_z[-60:] + way[-60:]).max() < 1e-9


HAND = HandModel.default()


def test_a_hand_thrown_about_enters_nothing() -> None:
    # Beside an object on a table; every tick is looked at.
    mesh, ticks = load_object("cube").mesh, 400
    solver = solver_of(body_of(mesh, mass=0.1, torsion=2e-3), HAND, table=float(mesh.bounds[0, 2]))
    record = solver.run(*RandomTargets(HAND, 1).take(ticks))
    moved = solver.object_ticks
    rows = moved.contact[-1]
    values = (*record, *(field[:rows] if len(field) > ticks + 1 else field for field in moved))
    assert all(np.isfinite(value).all() for value in values)
    assert recorded_penetration(HAND, solver.workspace.surface, record).depth.max() == 0.0
    assert moved.table_distance.min() >= 0.0
    assert float(np.linalg.norm(moved.shift[-1])) > 1e-3


def test_a_file_has_the_properties_of_a_free_body_and_of_its_table() -> None:
    body = body_of(box((0.03, 0.04, 0.05)), density=700.0, friction=0.3, torsion=1e-3)
    properties = body.properties(HalfSpace("table", -0.02))
    assert {**vars(body.motion), "friction": 0.3, "torsion": 1e-3, "table": -0.02, "table_friction": None} == properties
    assert body.solid.mass == pytest.approx(700.0 * 0.03 * 0.04 * 0.05)
