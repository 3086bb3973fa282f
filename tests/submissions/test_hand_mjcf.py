"""MJCF of the hand: other software that sets the same angles has the joints where hhsim has them."""

import math
from collections.abc import Callable
from xml.etree import ElementTree as Xml

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hhsim.arrays import FloatArray
from hhsim.hand.fingers import FINGERS
from hhsim.hand.model import HandModel, Side
from hhsim.hand.quaternion import rotation_matrix
from hhsim.kernels.round_cone import cone_slope
from hhsim.submissions.hand_mjcf import BODIES, JOINTS, STEP, capsules, hand_mjcf, joint_angles

SIDES = ("right", "left")


def _poses(hand: HandModel, count: int) -> list[tuple[FloatArray, FloatArray, FloatArray, FloatArray]]:
    random = np.random.default_rng(5)
    found = []
    for _ in range(count):
        turn = random.normal(size=4)
        flexion = random.uniform(hand.flexion_min, hand.flexion_max)
        abduction = random.uniform(hand.abduction_min, hand.abduction_max)
        found.append((random.normal(size=3), turn / np.linalg.norm(turn), flexion, abduction))
    return found


def _vector(text: str) -> FloatArray:
    return np.array([float(word) for word in text.split()])


def _joint_centres(place: Callable[[str], FloatArray]) -> FloatArray:
    names = [[f"{finger}_1", f"{finger}_2", f"{finger}_3", f"{finger}_tip"] for finger in FINGERS]
    return np.array([[place(name) for name in row] for row in names])


@pytest.mark.parametrize("side", SIDES)
def test_mjcf_has_the_joints_where_hhsim_has_them(side: Side) -> None:
    hand = HandModel.default(side)
    palm = Xml.fromstring(hand_mjcf(hand)).find("worldbody/body")
    assert palm is not None and palm.find("freejoint") is not None
    for position, orientation, flexion, abduction in _poses(hand, 20):
        angles, turn = dict(zip(JOINTS, joint_angles(flexion, abduction))), rotation_matrix(orientation)
        wanted = hand.joints(position, orientation, flexion, abduction)
        found = _mjcf_frames(palm, angles, turn, position)
        assert np.abs(_joint_centres(found.__getitem__) - wanted).max() < 1e-12


def _mjcf_frames(
    body: Xml.Element, angles: dict[str, float], turn: FloatArray, place: FloatArray
) -> dict[str, FloatArray]:
    for joint in body.findall("joint"):
        bend = angles[joint.get("name", "")] * _vector(joint.get("axis", ""))
        turn = turn @ Rotation.from_rotvec(bend).as_matrix()
    found = {body.get("name", ""): place}
    for site in body.findall("site"):
        found[site.get("name", "")] = place + turn @ _vector(site.get("pos", ""))
    for child in body.findall("body"):
        found |= _mjcf_frames(child, angles, turn, place + turn @ _vector(child.get("pos", "")))
    return found


def test_every_degree_of_freedom_is_a_joint_with_its_limits_and_masses_are_those_of_a_hand() -> None:
    hand = HandModel.default()
    model = Xml.fromstring(hand_mjcf(hand))
    assert tuple(body.get("name") for body in model.iter("body")) == BODIES
    limits = {joint.get("name", ""): _vector(joint.get("range", "")) for joint in model.iter("joint")}
    assert tuple(limits) == JOINTS
    for f, finger in enumerate(FINGERS):
        assert limits[f"{finger}_abd"].tolist() == [hand.abduction_min[f], hand.abduction_max[f]]
        for k in range(3):
            assert limits[f"{finger}_flex{k + 1}"].tolist() == [hand.flexion_min[f, k], hand.flexion_max[f, k]]
    inertials = list(model.iter("inertial"))
    assert len(inertials) == 16 and 0.2 < sum(float(one.get("mass", "")) for one in inertials) < 0.8
    for one in inertials:
        xx, yy, zz, xy, xz, yz = _vector(one.get("fullinertia", ""))
        a, b, c = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        assert a > 0.0 and c <= (a + b) * (1.0 + 1e-12)


def test_capsules_stand_for_a_tapering_phalanx_from_inside() -> None:
    end, thick, thin = np.array([0.0, 0.0, 0.04]), 0.0187, 0.0098
    tan, _ = cone_slope(0.04, thick, thin)
    for z, x in np.random.default_rng(3).uniform([-0.03, 0.0], [0.06, 0.03], (2000, 2)):
        share = min(max((z - x * tan) / 0.04, 0.0), 1.0)
        exact = math.hypot(x, z - 0.04 * share) - (thick - share * (thick - thin))
        parts = capsules(end, thick, thin)
        near = min(math.hypot(x, z - min(max(z, start[2]), stop[2])) - radius for start, stop, radius in parts)
        # Exact inside is not the same distance: points deep inside tell nothing of the surface.
        if exact > -1e-4:
            assert exact - 1e-12 <= near <= exact + STEP
    ((start, stop, _),) = capsules(end, 0.01, 0.01)
    assert (start != stop).any()
