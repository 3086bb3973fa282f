"""The seam of surfaces: what is registered, and that one new file is a surface that hands rest on."""

import importlib
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from contact_scenes import in_contact
from sphere_scenes import bumpy_ball

import hhsim.kernels.surfaces
from hhsim.errors import InputError
from hhsim.hand.model import HandModel
from hhsim.motion.analytic_motion import still
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.method import SURFACES, surface_of
from hhsim.solver.options import SolverOptions

BALLS = """
from typing import NamedTuple

from hhsim.kernels.by_reference import by_reference
from hhsim.kernels.contact import surface
from hhsim.kernels.jit import Array, Indices
from hhsim.kernels.surfaces import spheres


@by_reference
class BallArrays(NamedTuple):
    x: Array
    y: Array
    z: Array
    radius: Array
    first_child: Indices
    child_count: Indices
    leaf_start: int


surface.gather_pairs.of(BallArrays)(spheres._gather)
surface.measure_pairs.of(BallArrays)(spheres._measure)
surface.pairs_within.of(BallArrays)(spheres._within)
surface.record_pairs.of(BallArrays)(spheres._record)
surface.cone_distance.of(BallArrays)(spheres._cone_distance)
SURFACE = spheres.SURFACE._replace(summary="balls", arrays=BallArrays)
"""
"""A module of a surface: another type of arrays, to whose kernels those of the spheres are enough."""


@pytest.fixture
def balls(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """One more file in the package of surfaces."""
    (tmp_path / "balls.py").write_text(BALLS)
    monkeypatch.setattr(hhsim.kernels.surfaces, "__path__", [*hhsim.kernels.surfaces.__path__, str(tmp_path)])
    importlib.invalidate_caches()
    yield SURFACES["balls"]
    sys.modules.pop("hhsim.kernels.surfaces.balls", None)


def test_the_spheres_are_a_surface() -> None:
    assert list(SURFACES) == ["spheres", "mesh"]
    tree = bumpy_ball(20).arrays()
    assert surface_of(tree) is SURFACES["spheres"]
    np.testing.assert_array_equal(SURFACES["spheres"].center(tree), [tree.x[0], tree.y[0], tree.z[0]])
    with pytest.raises(InputError, match="is no surface of an object"):
        surface_of((1.0,))
    with pytest.raises(InputError, match=r"'mesh'.*TreeArrays"):
        HandSolver(HandModel.default(), tree, SolverOptions(surface="mesh"))


def test_a_surface_is_added_by_one_file(balls: Any) -> None:
    tree, at = bumpy_ball(300).arrays(), still([0.0, -0.045, 0.058], flexion=0.4)
    ours = balls.arrays(*tree)
    assert SolverOptions(surface="balls").surface == "balls" and surface_of(ours) is SURFACES["balls"]
    found, expected = (in_contact(HandModel.default(), each, at, 1e-3).contacts for each in (ours, tree))
    count = int(expected.start[-1])
    assert count > 0
    for name in ("key", "distance", "normal", "point"):
        np.testing.assert_array_equal(found[name][..., :count], expected[name][..., :count])
