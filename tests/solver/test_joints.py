"""Two free bodies on a hinge or a slider: what is conserved, limits, and a plate that hangs from a box in the hand."""

from typing import Any

import numpy as np
import pytest
from free_scenes import REACH_PER_STIFFNESS, all_ticks, body_of, box, closing, far_hand, solver_of, tongs, tongs_at
from scipy.integrate import solve_ivp

from hhsim.arrays import FloatArray
from hhsim.hand.quaternion import rotation_matrix
from hhsim.solver.free_object import FreeObject, Hinge, Slider
from hhsim.solver.options import Stiffness

DT, G = 1e-3, 9.81
STILL: dict[str, Any] = {"gravity": (0.0, 0.0, 0.0)}
EDGES = (0.2, 0.1, 0.02)


def run_pair(ticks: int, **of_first: Any) -> tuple[Any, tuple[FreeObject, FreeObject]]:
    """The records of two plates without gravity that begin end to end, the first one on a joint of the second."""
    meshes = box(EDGES, (0.1, 0.0, 0.0)), box(EDGES, (-0.1, 0.0, 0.0))
    first = FreeObject.of_mesh(meshes[0], mass=0.3, **STILL, **of_first)
    second = FreeObject.of_mesh(meshes[1], mass=0.5, **STILL)
    solver = solver_of(meshes[0], first, others=[body_of(meshes[1], second, "base")])
    record = solver.run(*far_hand(ticks))
    assert not record.status.any()
    return all_ticks(solver), (first, second)


def conserved(record: Any, free: tuple[FreeObject, FreeObject]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Momentum (T, 3), angular momentum about the origin (T, 3) and energy (T,) of both."""
    momentum, angular, energy = np.zeros(3), np.zeros(3), np.zeros(())
    for ticks, one in zip(record.bodies, free):
        turn = rotation_matrix(ticks.turn)
        inertia = turn @ np.array(one.inertia) @ turn.transpose(0, 2, 1)
        spun = np.einsum("tij,tj->ti", inertia, ticks.angular_velocity)
        moved = one.mass * ticks.velocity
        momentum = momentum + moved
        angular = angular + np.cross(turn @ np.array(one.center) + ticks.shift, moved) + spun
        energy = energy + 0.5 * (moved * ticks.velocity + spun * ticks.angular_velocity).sum(axis=1)
    return momentum, angular, energy


def beside(record: Any) -> tuple[FloatArray, FloatArray]:
    """Turn (T, 3, 3) and shift [m] (T, 3) of the first body beside the second one, from where they began."""
    first, second = record.bodies[:2]
    back = rotation_matrix(second.turn).transpose(0, 2, 1)
    return back @ rotation_matrix(first.turn), np.einsum("tij,tj->ti", back, first.shift - second.shift)


@pytest.mark.parametrize("axis", [(0.0, 1.0, 0.0), (0.3, -0.2, 1.0)])
def test_what_turns_on_a_hinge_keeps_momenta_and_energy(axis: tuple[float, float, float]) -> None:
    given = {"hinge": Hinge(axis, (0.0, 0.0, 0.0), on="base"), "velocity": (0.0, 0.02, 0.1)}
    record, free = run_pair(400, **given, angular_velocity=(0.5, 4.0, -2.0))
    turn, shift = beside(record)
    assert np.abs(shift).max() < 1e-6, "the origin is a point of both"
    along = np.array(axis) / np.linalg.norm(axis)
    assert np.abs(turn @ along - along).max() < 1e-6 and np.abs(turn - np.eye(3)).max() > 0.3
    momentum, angular, energy = conserved(record, free)
    np.testing.assert_allclose(momentum, momentum[:1].repeat(400, axis=0), atol=1e-9)
    np.testing.assert_allclose(momentum[0], 0.3 * np.array([0.0, 0.02, 0.1]), atol=1e-9)
    np.testing.assert_allclose(angular, angular[:1].repeat(400, axis=0), atol=2e-3 * float(np.linalg.norm(angular[0])))
    assert (np.diff(energy) < 1e-6 * energy[0]).all() and energy[-1] > 0.98 * energy[0]
    first, second = record.body_wrench
    np.testing.assert_allclose(first[:, :3], -second[:, :3], atol=1e-9)


@pytest.mark.parametrize("kind", ["hinge", "slider"])
def test_dry_friction_slows_two_things_until_they_go_on_as_one(kind: str) -> None:
    ticks, size = 400, {"hinge": 0.002, "slider": 0.15}[kind]
    joint: Any = {
        "hinge": Hinge((0.0, 0.0, 1.0), (0.0, 0.0, 0.0), friction=size, on="base"),
        "slider": Slider((1.0, 0.0, 0.0), friction=size, on="base"),
    }[kind]
    given: dict[str, Any] = {"velocity": (0.2, 0.0, 0.0)} if kind == "slider" else {"angular_velocity": (0.0, 0.0, 0.6)}
    record, free = run_pair(ticks, **{kind: joint}, **given)
    momentum, angular, energy = conserved(record, free)
    np.testing.assert_allclose(momentum, momentum[:1].repeat(ticks, axis=0), atol=1e-9)
    np.testing.assert_allclose(
        angular, angular[:1].repeat(ticks, axis=0), atol=2e-3 * float(np.linalg.norm(angular[0]))
    )
    assert (np.diff(energy) <= 1e-9).all()
    one, two = record.bodies[:2]
    speed = (
        (one.velocity - two.velocity)[:, 0] if kind == "slider" else (one.angular_velocity - two.angular_velocity)[:, 2]
    )
    stops = int(np.argmax(np.abs(speed) < 1e-6))
    assert np.abs(speed[stops:]).max() < 1e-6 and 50 < stops < 350
    if kind == "slider":
        # The reduced mass of 0.3 and 0.5 kg.
        assert stops * DT == pytest.approx(0.2 * (0.3 * 0.5 / 0.8) / size, abs=2 * DT)
        np.testing.assert_allclose(record.body_wrench[0, : stops - 1, 0], -size, rtol=1e-3)
        assert np.abs(record.body_wrench[0, stops + 1 :]).max() < 1e-6
    else:
        # Both turn about the hinge, whose moment is that of friction alone.
        moment = record.body_wrench[:, : stops - 1]
        about = moment[0, :, 5] + np.cross(hinge_from_center(one, free[0])[: stops - 1], -moment[0, :, :3])[:, 2]
        np.testing.assert_allclose(about, -size, rtol=2e-3)


def hinge_from_center(ticks: Any, free: FreeObject) -> FloatArray:
    """Origin of a body's frame from its centre at the ticks [m], world, shape (T, 3)."""
    return np.asarray(-1.0 * rotation_matrix(ticks.turn) @ np.array(free.center))


def test_limits_of_a_hinge_end_its_turn_and_both_go_on_as_one() -> None:
    hinge = Hinge((0.0, 1.0, 0.0), (0.0, 0.0, 0.0), limits=(-0.5, 0.5), on="base")
    record, free = run_pair(800, hinge=hinge, angular_velocity=(0.0, 4.0, 0.0))
    turn, _ = beside(record)
    angle = np.arctan2(turn[:, 0, 2], turn[:, 0, 0])
    assert angle.max() == pytest.approx(0.5, abs=1e-9)
    # As one, until the centrifugal forces stretch them again.
    stopped = int(angle.argmax()) + 1
    spins = [one.angular_velocity[stopped] for one in record.bodies[:2]]
    np.testing.assert_allclose(spins[0], spins[1], atol=1e-3)
    assert 0.1 < angle[-1] < 0.5
    _, angular, _ = conserved(record, free)
    np.testing.assert_allclose(angular[-1], angular[0], atol=2e-3 * float(np.linalg.norm(angular[0])))


def test_what_moves_on_a_slider_keeps_momenta_and_turns_with_what_bears_it() -> None:
    slider = Slider((1.0, 0.0, 0.0), limits=(-0.01, 0.06), on="base")
    record, free = run_pair(600, slider=slider, velocity=(0.3, 0.0, 0.1))
    turn, shift = beside(record)
    assert np.abs(turn - np.eye(3)).max() < 1e-6
    # Of the first body's centre, which began on the axis.
    off = np.einsum("tij,j->ti", turn - np.eye(3), np.array(free[0].center)) + shift
    assert np.abs(off[:, 1:]).max() < 1e-6 and off[:, 0].max() == pytest.approx(0.06, abs=1e-6)
    momentum, angular, energy = conserved(record, free)
    np.testing.assert_allclose(momentum, momentum[:1].repeat(600, axis=0), atol=1e-9)
    np.testing.assert_allclose(angular, angular[:1].repeat(600, axis=0), atol=2e-3 * float(np.linalg.norm(angular[0])))
    stops = int(np.argmax(off[:, 0] > 0.06 - 1e-6))
    assert energy[stops - 2] > 0.99 * energy[0] and energy[-1] < 0.9 * energy[0], "the stop is inelastic"


def test_a_plate_hangs_from_a_box_that_the_fingers_hold() -> None:
    held, plate = box((0.03, 0.03, 0.03)), box((0.01, 0.02, 0.08), (0.0, 0.0, -0.055))
    hinge = Hinge((1.0, 0.0, 0.0), (0.0, 0.0, -0.015), on="box")
    hung = body_of(plate, FreeObject.of_mesh(plate, mass=0.1, hinge=hinge), "plate")
    free = FreeObject.of_mesh(held, mass=0.2, friction=1.0, name="box")
    stiffness = Stiffness(translation=1e5, rotation=1e3, flexion=500.0)
    solver = solver_of(held, free, tongs(), [hung], stiffness=stiffness)
    touch, tips = closing(0.03)
    # They close while it begins to fall.
    closed = touch + np.interp(np.arange(1500), [0, 20], [-2e-3, REACH_PER_STIFFNESS])
    position, *others = tongs_at(closed, np.tile([-tips, 0.0, 0.0], (1500, 1)))
    record = solver.run(position, *others)
    ticks = all_ticks(solver)
    assert not record.status[-100:].any()
    np.testing.assert_allclose(ticks.bodies[0].hand_wrench[-1, 2], 0.3 * G, rtol=1e-3)
    np.testing.assert_allclose(ticks.body_wrench[1, -1, :3], [0.0, 0.0, 0.1 * G], atol=2e-3)


def test_a_plate_on_a_hinged_one_is_a_double_pendulum() -> None:
    length, mass, ticks = 0.2, (0.3, 0.5), 240
    meshes = [box((length, 0.1, 0.01), (length * (k + 0.5), 0.0, 0.0)) for k in range(2)]
    upper = FreeObject.of_mesh(meshes[0], mass=mass[0], hinge=Hinge((0.0, -1.0, 0.0), (0.0, 0.0, 0.0)), name="upper")
    hinge = Hinge((0.0, -1.0, 0.0), (length, 0.0, 0.0), on="upper")
    lower = FreeObject.of_mesh(meshes[1], mass=mass[1], hinge=hinge)
    solver = solver_of(meshes[0], upper, others=[body_of(meshes[1], lower, "l")])
    record = solver.run(*far_hand(ticks))
    assert not record.status.any()
    recorded = all_ticks(solver)
    turns = [rotation_matrix(one.turn) for one in recorded.bodies[:2]]
    found = [np.arctan2(turn[:, 2, 0], turn[:, 0, 0]) for turn in turns]
    inertia = [m * (length**2 + 0.01**2) / 12.0 for m in mass]

    def rates(_: float, at: FloatArray) -> FloatArray:
        a, b, va, vb = at
        both, half = mass[1] * length * 0.5 * length, 0.5 * length
        matrix = [
            [inertia[0] + mass[0] * half**2 + mass[1] * length**2, both * np.cos(a - b)],
            [both * np.cos(a - b), inertia[1] + mass[1] * half**2],
        ]
        pull = [
            -both * np.sin(a - b) * vb**2 - (mass[0] * half + mass[1] * length) * G * np.cos(a),
            both * np.sin(a - b) * va**2 - mass[1] * half * G * np.cos(b),
        ]
        return np.concatenate([[va, vb], np.linalg.solve(matrix, pull)])

    true = solve_ivp(rates, (0.0, DT * ticks), np.zeros(4), t_eval=DT * np.arange(1, ticks + 1), rtol=1e-9).y
    np.testing.assert_allclose(np.unwrap(found[0]), true[0], atol=0.01 * np.abs(true[0]).max())
    np.testing.assert_allclose(np.unwrap(found[1]), true[1], atol=0.01 * np.abs(true[1]).max())
    # The upper one's balance about its hinge, with what the joint bears: the referee's own equation.
    wrench = recorded.body_wrench
    np.testing.assert_allclose(wrench[0, :, :3], -wrench[1, :, :3], atol=1e-9)
    moved = mass[1] * np.diff(recorded.bodies[1].velocity, axis=0, prepend=0.0) / DT
    np.testing.assert_allclose(wrench[1, :, :3], moved + [0.0, 0.0, mass[1] * G], atol=1e-5)
