"""What a free object cannot be solved with, where it begins, and that it goes through nothing whatever is asked."""

import numpy as np
import pytest
from free_scenes import body_of, box, solver_of

from hhsim.bench.robustness.random_targets import RandomTargets
from hhsim.bench.robustness.safety import recorded_penetration
from hhsim.hand.model import HandModel
from hhsim.mesh.catalogue import load_object
from hhsim.scene.body import HalfSpace
from hhsim.solver.options import Stiffness

HAND = HandModel.default()


def harass(name: str, mass: float, stiffness: Stiffness, ticks: int, seed: int) -> float:
    """Throw the hand about an object on a table, and look at every tick; how far the object gets [m]."""
    mesh = load_object(name).mesh
    lowest = float(mesh.bounds[0, 2])
    solver = solver_of(body_of(mesh, mass=mass, torsion=2e-3), HAND, table=lowest, stiffness=stiffness)
    record = solver.run(*RandomTargets(HAND, seed).take(ticks))
    moved = solver.object_ticks
    rows = moved.contact[-1]
    values = (*record, *(field[:rows] if len(field) > ticks + 1 else field for field in moved))
    assert all(np.isfinite(value).all() for value in values)
    assert recorded_penetration(HAND, solver.workspace.surface, record).depth.max() == 0.0
    assert moved.table_distance.min() >= 0.0
    return float(np.linalg.norm(moved.shift[-1]))


def test_a_hand_thrown_about_enters_nothing() -> None:
    assert harass("cube", 0.1, Stiffness(), 400, seed=1) > 1e-3


def test_a_file_has_the_properties_of_a_free_body_and_of_its_table() -> None:
    body = body_of(box((0.03, 0.04, 0.05)), density=700.0, friction=0.3, torsion=1e-3)
    properties = body.properties(HalfSpace("table", -0.02))
    assert {**vars(body.motion), "friction": 0.3, "torsion": 1e-3, "table": -0.02, "table_friction": None} == properties
    assert body.solid.mass == pytest.approx(700.0 * 0.03 * 0.04 * 0.05)
