"""Eq. 14 is judged where the paper's contacts are those of the nearest points, and nowhere else."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from sampled import sampled
from short_grasp import result_of

from hhsim.bench.robustness.random_targets import RandomTargets, StressOptions
from hhsim.hand.model import HandModel
from hhsim.mesh.catalogue import load_object
from hhsim.motion.trajectory import Trajectory
from hhsim.result.reader import load_result
from hhsim.scene.scene import make_scene
from hhsim.trees.cache import cached_sphere_tree
from hhsim.trees.options import TreeOptions
from hhsim.verify.claim import FAILS, HOLDS
from hhsim.verify.contacts import Pairs
from hhsim.verify.force_checks import force_claims
from hhsim.verify.forces import on_another_part
from hhsim.verify.kinematics import OwnHand, Posed
from hhsim.verify.tick_data import JudgedTicks


@pytest.mark.parametrize(
    ("name", "level", "seed"),
    sampled([("sphere", 2, 3), ("cylinder", 2, 3), ("cube", 3, 0)], lambda place, _: place == 1),
)
@pytest.mark.soak
def test_a_hand_that_jumps_into_the_object_claims_nothing_false(
    tmp_path: Path, name: str, level: int, seed: int
) -> None:
    """Knuckles that touch, and spheres deep inside a phalanx: as many pairs, but others."""
    motion = RandomTargets(HandModel.default(), seed, StressOptions(hold=20, bound="none", position_spread=0.04)).take(
        400
    )
    mesh = load_object(name).mesh
    tree = cached_sphere_tree(mesh, TreeOptions(level=level))
    scene = make_scene(mesh, tree, HandModel.default(), Trajectory(np.linspace(0.0, 0.399, 400), *motion, name="jumps"))
    result = result_of(scene, tmp_path / "jumps.h5", method="paper")
    assert result["penetration_depth"].max() > 0.01, "nothing is deep inside: the test shows little"
    ticks = JudgedTicks(result, np.arange(result.ticks))
    claims = {found.name: found for found in force_claims(ticks)}
    assert claims["Eq. 14"].verdict == HOLDS
    assert claims["Eq. 14"].checked > 50
    # Eq. 1 in Euler angles, whichever branch the palm has come to; a torque that is off by 1e-3 N·m is on none.
    assert claims["palm wrench"].verdict == HOLDS
    wrench = np.array(result["force/palm_wrench"])
    assert np.abs(wrench[:, 3:] - ticks.pull[:, 3:6]).max() > 0.1, "not the rotation vector"
    wrench[200, 3] += 1e-3
    changed = replace(load_result(result.path), replaced={"force/palm_wrench": wrench})
    off = JudgedTicks(changed, ticks.chosen)
    false = next(found for found in force_claims(off) if found.name == "palm wrench")
    assert (false.verdict, false.tick) == (FAILS, 200)


RADIUS = 0.004
"""Of the object's spheres [m]."""


def around(depth: float, phalanx: int, moved: float = 0.0) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    """Where along an index phalanx 20 mm long, 10 mm thick to 6 mm, spheres are on another part, and their places.

    The phalanx has `moved` in the tick [m].
    """
    joints = np.full((1, 5, 4, 3), 9.0)
    joints[0, 1, phalanx], joints[0, 1, phalanx + 1] = [0.0, 0.0, 0.0], [0.0, 0.02, 0.0]
    sizes = np.full((5, 4), 0.006)
    sizes[1, phalanx] = 0.010
    hand = OwnHand(*(np.empty(0),) * 4, sizes, *(np.empty(0),) * 4, 1.0)
    # Tangent to the side at every place of the axis, then `depth` deeper.
    share, sine = np.linspace(0.01, 0.99, 99), 0.2
    out = np.array([0.0, sine, np.sqrt(1.0 - sine**2)])
    axis = share[:, None] * [0.0, 0.02, 0.0]
    away = 0.010 - 0.004 * share + RADIUS - depth
    center = axis + away[:, None] * out
    n, zero = len(share), np.zeros((len(share), 3))
    body = np.full(n, 3 + phalanx)
    pairs = Pairs(np.zeros(n, np.int64), body, np.arange(n), np.full(n, -depth), zero, zero)
    posed = Posed(joints, np.empty(0), np.empty(0), np.empty(0))
    return on_another_part(hand, posed, pairs, center, np.full(n, RADIUS), True, np.array([moved])), share


@pytest.mark.parametrize("phalanx", [1, 2])
def test_what_only_touches_is_on_the_nearest_part(phalanx: int) -> None:
    assert not around(0.0, phalanx)[0].any()


@pytest.mark.parametrize("phalanx", [1, 2])
def test_what_the_tick_began_with_on_another_part_may_be_on_that(phalanx: int) -> None:
    """The pairs of a tick are those of its beginning, and which part each is on: a slow tick changes it at an end."""
    other, share = around(0.0, phalanx, 1e-3)
    length = 0.02 * (1.0 - 0.2**2)
    np.testing.assert_array_equal(other, np.minimum(share, 1.0 - share) * length <= 1e-3)


@pytest.mark.parametrize("phalanx", [1, 2])
def test_what_is_deep_inside_is_on_another_part_beside_the_thick_end(phalanx: int) -> None:
    """d nearer to the axis than a sphere that only touches, its centre has its foot d sin φ nearer to the joint."""
    other, share = around(0.005, phalanx)
    length = 0.02 * (1.0 - 0.2**2)
    np.testing.assert_array_equal(other, share * length < 0.001)
    assert 0 < other.sum() < 10


def test_a_sphere_that_reaches_a_first_joint_is_the_palms_too() -> None:
    other, share = around(0.005, 0)
    assert other[share < 0.5].all() and not other[share > 0.6].any()
