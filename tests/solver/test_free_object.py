"""What a free object is, in and out, and what is refused."""

import json
from typing import Any

import pytest
from free_scenes import box

from hhsim.errors import InputError
from hhsim.solver.free_object import FreeObject

WHOLE: dict[str, Any] = {"mass": 0.1, "center": (0.0, 0.0, 0.0), "inertia": ((1e-4, 0, 0), (0, 1e-4, 0), (0, 0, 1e-4))}


def test_a_file_has_it_to_the_bit() -> None:
    free = FreeObject.of_mesh(box((0.03, 0.04, 0.05)), density=700.0, friction=0.3, table=-0.02, torsion=1e-3)
    assert FreeObject.from_json(json.loads(json.dumps(free.to_json()))) == free
    assert free.mass == pytest.approx(700.0 * 0.03 * 0.04 * 0.05)
    assert free.of_table == free.friction


@pytest.mark.parametrize(
    ("wrong", "why"),
    [
        ({"mass": 0.0}, "mass is 0 kg"),
        ({"friction": -0.1}, "friction is -0.1"),
        ({"table": float("nan")}, "table is nan m: expected -100 to 100"),
        ({"center": (0.0, float("inf"), 0.0)}, "centre or the inertia .* not finite"),
        ({"inertia": ((1e-4, 1e-5, 0), (0, 1e-4, 0), (0, 0, 1e-4))}, "not symmetric"),
        ({"inertia": ((1e-4, 0, 0), (0, 1e-4, 0), (0, 0, 0))}, "not positive"),
    ],
)
def test_impossible_bodies_are_refused_in_one_line(wrong: dict[str, Any], why: str) -> None:
    with pytest.raises(InputError, match=why):
        FreeObject(**{**WHOLE, **wrong})


def test_what_is_no_free_object_is_refused() -> None:
    with pytest.raises(InputError, match="free object: center is missing"):
        FreeObject.from_json({"mass": 1.0})
