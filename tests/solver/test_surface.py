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

PLANE = '''
"""A table: everything below a height is inside."""

from typing import NamedTuple

import numpy as np

from hhsim.kernels.by_reference import by_reference
from hhsim.kernels.contact.surface import (
    SHARED_CANDIDATES, Surface, cone_distance, gather_pairs, measure_pairs, pairs_within, record_pairs,
)
from hhsim.kernels.hand.kinematics import BODY_COUNT, PALM_BODY, PHALANX_COUNT
from hhsim.kernels.memory import copy_values
from hhsim.kernels.jit import jit

ROOM = 1024
FLAT = 1e6


@by_reference
class PlaneArrays(NamedTuple):
    height: float


CANDIDATES = np.dtype(
    [
        ("center", np.float64, (BODY_COUNT, ROOM, 3)),
        ("radius", np.float64, (BODY_COUNT, ROOM)),
        ("distance", np.float64, (BODY_COUNT, ROOM)),
        *SHARED_CANDIDATES,
        ("scratch", np.int64, (1,)),
        ("stack", np.int64, (1,)),
    ],
    align=True,
)


@gather_pairs.of(PlaneArrays)
@jit
def _gather(plane, hand, pose, body, reach, candidates, walk):
    # Every sphere of the body, always: there is no list that could grow old.
    candidates.count[body] = 2 if body < PALM_BODY else hand.palm_radius.shape[0]
    candidates.slack[body] = np.inf
    return candidates.count[body] <= ROOM


@measure_pairs.of(PlaneArrays)
@jit
def _measure(plane, hand, pose, body, candidates):
    least = np.inf
    for i in range(candidates.count[body]):
        center = candidates.center[body, i]
        if body < PALM_BODY:
            f, k = body // PHALANX_COUNT, body % PHALANX_COUNT
            copy_values(pose.joints[f, k + i], center)
            candidates.radius[body, i] = hand.radius[f, k + i]
        else:
            x, y, z = hand.palm_x[i], hand.palm_y[i], hand.palm_z[i]
            for j in range(3):
                r = pose.rotation
                center[j] = pose.position[j] + r[j, 0] * x + r[j, 1] * y + r[j, 2] * z
            candidates.radius[body, i] = hand.palm_radius[i]
        candidates.distance[body, i] = center[2] - candidates.radius[body, i] - plane.height
        least = min(least, candidates.distance[body, i])
    return least


@pairs_within.of(PlaneArrays)
@jit
def _within(plane, hand, candidates, body, limit):
    count = 0
    for i in range(candidates.count[body]):
        count += 1 if candidates.distance[body, i] <= limit else 0
    return count


@record_pairs.of(PlaneArrays)
@jit
def _record(plane, hand, pose, body, candidates, limit, row, contacts):
    for i in range(candidates.count[body]):
        if candidates.distance[body, i] > limit:
            continue
        if row >= contacts.body.shape[0]:
            return -1
        contacts.body[row] = body
        contacts.key[row] = body * ROOM + i
        for j in range(3):
            contacts.normal[j, row] = 1.0 if j == 2 else 0.0
            reach = contacts.normal[j, row] * candidates.radius[body, i]
            contacts.point[j, row] = candidates.center[body, i, j] - reach
        contacts.distance[row] = candidates.distance[body, i]
        contacts.hand_radius[row] = candidates.radius[body, i]
        contacts.object_radius[row] = FLAT
        contacts.slides[row] = 0
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
    hand, above, margin = HandModel.default(), plane.arrays(HEIGHT), 1e-3
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
