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
from hhsim.kernels.sphere_tree import TreeArrays
from hhsim.motion.analytic_motion import still
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.method import SURFACES, surface_of
from hhsim.solver.options import SolverOptions

PLANE = '''
"""A table: everything below a height is inside."""

from typing import NamedTuple

import numpy as np

from hhsim.kernels.by_reference import by_reference
from hhsim.kernels.contact.lists import list_fields, put_in_order
from hhsim.kernels.contact.surface import (
    Surface, at_distance, cone_distance, list_pieces, measure_pieces, record_pieces, write_contact,
)
from hhsim.kernels.jit import jit
from hhsim.kernels.sphere_tree import TreeArrays, tree_of

FLAT = 1e6


@by_reference
class PlaneArrays(NamedTuple):
    height: float
    tree: TreeArrays


@tree_of.of(PlaneArrays)
@jit
def _tree(plane):
    return plane.tree


@list_pieces.of(PlaneArrays)
@jit
def _list(plane, probe, most, most_found, reach, look_out, candidates, walk):
    # Both ends of the axis, always: there is no list that could grow old.
    ends = 2 if probe.cone.length > 0.0 else 1
    for end in range(ends):
        candidates.piece[0, probe.start + end] = end
        candidates.distance[0, probe.start + end] = 0.0
    put_in_order(probe.number, 0, probe.start, probe.start + ends, candidates, walk.scratch)
    return np.inf


@measure_pieces.of(PlaneArrays)
@jit
def _measure(plane, kind, cone, start, stop, candidates):
    for i in range(start, stop):
        end = candidates.piece[0, i]
        radius = cone.radius - end * cone.drop
        candidates.distance[0, i] = cone.z + end * cone.length * cone.uz - radius - plane.height


@record_pieces.of(PlaneArrays)
@jit
def _record(plane, probe, pose, candidates, limit, row, contacts):
    number, cone, start = probe
    normal = (0.0, 0.0, 1.0)
    for i in range(start, start + candidates.measured[number, 0]):
        end, distance = candidates.piece[0, i], candidates.distance[0, i]
        if distance > limit:
            continue
        if row >= contacts.key.shape[0]:
            return -1
        radius = cone.radius - end * cone.drop
        center = at_distance((cone.x, cone.y, cone.z), (cone.ux, cone.uy, cone.uz), end * cone.length)
        point = at_distance(center, normal, -radius)
        write_contact(contacts, row, point, normal, distance, (radius, FLAT), 2 * number + end)
        row += 1
    return row


@cone_distance.of(PlaneArrays)
@jit
def _cone_distance(plane, cone, limit, stack):
    first = cone.z - cone.radius
    last = cone.z + cone.length * cone.uz - (cone.radius - cone.drop)
    return min(limit, min(first, last) - plane.height)


def _center(plane):
    return np.array([0.0, 0.0, plane.height - 1.0])


CANDIDATES = np.dtype(list_fields(1), align=True)
SURFACE = Surface("a horizontal plane", PlaneArrays, CANDIDATES, _center)
'''


@pytest.fixture
def plane(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """One more file in the package of surfaces."""
    (tmp_path / "plane.py").write_text(PLANE)
    monkeypatch.setattr(hhsim.kernels.surfaces, "__path__", [*hhsim.kernels.surfaces.__path__, str(tmp_path)])
    importlib.invalidate_caches()
    yield SURFACES["plane"]
    sys.modules.pop("hhsim.kernels.surfaces.plane", None)


def test_the_spheres_are_a_surface() -> None:
    assert list(SURFACES) == ["spheres", "mesh"]
    tree = bumpy_ball(20).arrays()
    assert surface_of(tree) is SURFACES["spheres"]
    np.testing.assert_array_equal(SURFACES["spheres"].center(tree), [tree.x[0], tree.y[0], tree.z[0]])
    with pytest.raises(InputError, match="is no surface of an object"):
        surface_of((1.0,))
    with pytest.raises(InputError, match=r"'mesh'.*TreeArrays"):
        HandSolver(HandModel.default(), tree, SolverOptions(surface="mesh"))


HEIGHT = -0.02
"""Of the plane [m]."""


def test_a_surface_is_added_by_one_file(plane: Any) -> None:
    # A ball that is as good as flat.
    center, radius = np.array([HEIGHT - 1e6]), np.array([1e6])
    tree = TreeArrays(np.zeros(1), np.zeros(1), center, radius, np.array([-1]), np.array([0]))
    hand, above, margin = HandModel.default(), plane.arrays(HEIGHT, tree), 1e-3
    assert SolverOptions(surface="plane").surface == "plane" and surface_of(above) is SURFACES["plane"]
    bent = still([0.0, 0.0, 0.015], flexion=0.3)
    state = in_contact(hand, above, bent, margin)
    joints = hand.joints(*bent.at(0))
    ends = (joints[..., 2] - hand.radius)[:, [0, 1, 1, 2, 2, 3]].ravel()
    palm = bent.position[0, 2] + hand.palm_tree.leaf_center[:, 2] - hand.palm_tree.leaf_radius
    gaps = np.concatenate([ends, palm]) - HEIGHT
    count = int(state.contacts.start[-1])
    assert count > 0
    np.testing.assert_allclose(np.sort(state.contacts.distance[:count]), np.sort(gaps[gaps <= margin]), atol=1e-12)
    np.testing.assert_array_equal(state.contacts.normal[2, :count], 1.0)
