"""Two free bodies on a hinge or a slider: what is conserved, limits, and a plate that hangs from a box in the hand."""

from typing import Any

import numpy as np
import pytest
from free_scenes import all_ticks, body_of, box, far_hand, solver_of

from hhsim.arrays import FloatArray
from hhsim.hand.quaternion import rotation_matrix
from hhsim.scene.body import Body, Joint

DT = 1e-3
STILL: dict[str, Any] = {"gravity": (0.0, 0.0, 0.0)}
EDGES = (0.2, 0.1, 0.02)


def run_pair(ticks: int, **of_first: Any) -> tuple[Any, tuple[Body, Body]]:
    """The records of two plates without gravity that begin end to end, the first one on a joint of the second."""
    meshes = box(EDGES, (0.1, 0.0, 0.0)), box(EDGES, (-0.1, 0.0, 0.0))
    first = body_of(meshes[0], mass=0.3, **STILL, **of_first)
    second = body_of(meshes[1], "base", mass=0.5, **STILL)
    solver = solver_of(first, others=[second])
    record = solver.run(*far_hand(ticks))
    assert not record.status.any()
    return all_ticks(solver), (first, second)


def conserved(record: Any, bodies: tuple[Body, Body]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Momentum (T, 3), angular momentum about the origin (T, 3) and energy (T,) of both."""
    momentum, angular, energy = np.zeros(3), np.zeros(3), np.zeros(())
    for ticks, body in zip(record.bodies, bodies):
        one, turn = body.solid, rotation_matrix(ticks.turn)
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
    given = {"joint": Joint("hinge", axis, on="base"), "velocity": (0.0, 0.02, 0.1)}
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
    joint = {
        "hinge": Joint("hinge", (0.0, 0.0, 1.0), friction=size, on="base"),
        "slider": Joint("slider", (1.0, 0.0, 0.0), friction=size, on="base"),
    }[kind]
    given: dict[str, Any] = {"velocity": (0.2, 0.0, 0.0)} if kind == "slider" else {"angular_velocity": (0.0, 0.0, 0.6)}
    record, free = run_pair(ticks, joint=joint, **given)
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


def hinge_from_center(ticks: Any, body: Body) -> FloatArray:
    """Origin of a body's frame from its centre at the ticks [m], world, shape (T, 3)."""
    return np.asarray(-1.0 * rotation_matrix(ticks.turn) @ np.array(body.solid.center))


def test_what_moves_on_a_slider_keeps_momenta_and_turns_with_what_bears_it() -> None:
    slider = Joint("slider", (1.0, 0.0, 0.0), limits=(-0.01, 0.06), on="base")
    record, free = run_pair(600, joint=slider, velocity=(0.3, 0.0, 0.1))
    turn, shift = beside(record)
    assert np.abs(turn - np.eye(3)).max() < 1e-6
    # Of the first body's centre, which began on the axis.
    off = np.einsum("tij,j->ti", turn - np.eye(3), np.array(free[0].solid.center)) + shift
    assert np.abs(off[:, 1:]).max() < 1e-6 and off[:, 0].max() == pytest.approx(0.06, abs=1e-6)
    momentum, angular, energy = conserved(record, free)
    np.testing.assert_allclose(momentum, momentum[:1].repeat(600, axis=0), atol=1e-9)
    np.testing.assert_allclose(angular, angular[:1].repeat(600, axis=0), atol=2e-3 * float(np.linalg.norm(angular[0])))
    stops = int(np.argmax(off[:, 0] > 0.06 - 1e-6))
    assert energy[stops - 2] > 0.99 * energy[0] and energy[-1] < 0.9 * energy[0], "the stop is inelastic"
