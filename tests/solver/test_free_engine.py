"""What a free object cannot be solved with, where it begins, and that it goes through nothing whatever is asked."""

from typing import Any

import numpy as np
import pytest
from free_scenes import box, far_hand, solver_of

from hhsim.bench.robustness.random_targets import RandomTargets
from hhsim.bench.robustness.safety import recorded_penetration
from hhsim.errors import InputError
from hhsim.hand.model import HandModel
from hhsim.mesh.catalogue import load_object, object_names
from hhsim.solver.free_object import FreeObject
from hhsim.solver.options import Stiffness

MESH = box((0.05, 0.05, 0.05))


@pytest.mark.parametrize(
    ("options", "why"),
    [
        ({"method": "progressive"}, "method progressive has no free objects: coupled has"),
        ({"qp": "clarabel"}, "own QP solver, not clarabel"),
        ({"force": "paper"}, "use the force model kkt"),
    ],
)
def test_what_has_no_free_objects_says_so(options: dict[str, Any], why: str) -> None:
    with pytest.raises(InputError, match=why):
        solver_of(MESH, FreeObject.of_mesh(MESH), **options)


def test_an_object_in_the_table_is_refused_and_one_on_it_begins_free_of_it() -> None:
    with pytest.raises(InputError, match="begins 1 mm below the table"):
        solver_of(MESH, FreeObject.of_mesh(MESH, table=-0.024))
    solver = solver_of(MESH, FreeObject.of_mesh(MESH, table=-0.025))
    solver.run(*far_hand(3))
    assert (solver.object_ticks.table_distance > 0.0).all()


def test_without_mass_in_the_way_it_falls() -> None:
    solver = solver_of(MESH, FreeObject.of_mesh(MESH))
    solver.run(*far_hand(100))
    assert solver.object_ticks.velocity[-1, 2] == pytest.approx(-9.81 * 0.1, rel=1e-9)
    assert solver.object_ticks.contact[-1] == 0


HAND = HandModel.default()


def harass(name: str, mass: float, stiffness: Stiffness, ticks: int, seed: int) -> float:
    """Throw the hand about an object on a table, and look at every tick; how far the object gets [m]."""
    mesh = load_object(name).mesh
    lowest = float(mesh.bounds[0, 2])
    free = FreeObject.of_mesh(mesh, mass=mass, friction=0.6, torsion=2e-3, table=lowest)
    solver = solver_of(mesh, free, HAND, stiffness=stiffness)
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


@pytest.mark.soak
@pytest.mark.parametrize("ratio", [1e-2, 1.0, 1e2])
@pytest.mark.parametrize("mass", [1e-3, 0.1, 10.0])
@pytest.mark.parametrize("name", object_names())
def test_no_object_is_entered_or_enters_the_table(name: str, mass: float, ratio: float) -> None:
    """The ratio is that of the fingers' stiffness to the palm's, as it usually is."""
    usual = Stiffness()
    stiffness = Stiffness(usual.translation, usual.rotation, ratio * usual.flexion)
    # A hand that has thrown its object away begins anew.
    for seed in range(5):
        harass(name, mass, stiffness, 600, seed)
