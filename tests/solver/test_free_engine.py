"""What a free object cannot be solved with, and where it begins."""

from typing import Any

import pytest
from free_scenes import box, far_hand, solver_of

from hhsim.errors import InputError
from hhsim.scene.free_object import FreeObject

MESH = box((0.05, 0.05, 0.05))


@pytest.mark.parametrize(
    ("options", "why"),
    [
        ({"method": "progressive"}, "method progressive has no free objects: coupled has"),
        ({"qp": "clarabel"}, "own QP solver, not clarabel"),
        ({"force": "paper"}, "use the force model kkt"),
        ({"threads": 2}, "threads is 2"),
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
