"""MJCF of the hand: other software that sets the same angles has the joints where hhsim has them."""

import math
from collections.abc import Callable
from xml.etree import ElementTree as Xml

import numpy as np
import pytest

from hhsim.arrays import FloatArray
from hhsim.hand.fingers import FINGERS
from hhsim.hand.model import HandModel, Side
from hhsim.hand.quaternion import rotation_matrix
from hhsim.kernels.round_cone_distance import cone_slope
from hhsim.submissions.hand_mjcf import STEP, HandBodies, RoundCone, hand_bodies, hand_mjcf

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


def _turned(axis: FloatArray, angle: float) -> FloatArray:
    """Rodrigues: rotation about a unit axis."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + math.sin(angle) * cross + (1.0 - math.cos(angle)) * cross @ cross)


def _joint_centres(place: Callable[[str], FloatArray]) -> FloatArray:
    names = [[f"{finger}_1", f"{finger}_2", f"{finger}_3", f"{finger}_tip"] for finger in FINGERS]
    return np.array([[place(name) for name in row] for row in names])


@pytest.mark.parametrize("side", SIDES)
def test_mjcf_has_the_joints_where_hhsim_has_them(side: Side) -> None:
    hand = HandModel.default(side)
    bodies, palm = hand_bodies(hand), Xml.fromstring(hand_mjcf(hand)).find("worldbody/body")
    assert palm is not None and palm.find("freejoint") is not None
    for position, orientation, flexion, abduction in _poses(hand, 20):
        angles, turn = bodies.angles(flexion, abduction), rotation_matrix(orientation)
        wanted = hand.joints(position, orientation, flexion, abduction)
        found = _mjcf_frames(palm, angles, turn, position)
        assert np.abs(_joint_centres(found.__getitem__) - wanted).max() < 1e-12


@pytest.mark.parametrize("side", SIDES)
def test_mujoco_has_the_joints_where_hhsim_has_them(side: Side) -> None:
    mujoco = pytest.importorskip("mujoco")
    hand = HandModel.default(side)
    model = mujoco.MjModel.from_xml_string(hand_mjcf(hand))
    data, bodies = mujoco.MjData(model), hand_bodies(hand)
    for position, orientation, flexion, abduction in _poses(hand, 20):
        data.joint("palm").qpos[:] = [*position, *orientation]
        for name, angle in bodies.angles(flexion, abduction).items():
            data.joint(name).qpos[0] = angle
        mujoco.mj_forward(model, data)
        found = _joint_centres(lambda name: (data.site if name.endswith("tip") else data.body)(name).xpos)
        assert np.abs(found - hand.joints(position, orientation, flexion, abduction)).max() < 1e-9
        assert data.ncon == 0, "the hand does not collide with itself"


def _mjcf_frames(
    body: Xml.Element, angles: dict[str, float], turn: FloatArray, place: FloatArray
) -> dict[str, FloatArray]:
    for joint in body.findall("joint"):
        turn = turn @ _turned(_vector(joint.get("axis", "")), angles[joint.get("name", "")])
    found = {body.get("name", ""): place}
    for site in body.findall("site"):
        found[site.get("name", "")] = place + turn @ _vector(site.get("pos", ""))
    for child in body.findall("body"):
        found |= _mjcf_frames(child, angles, turn, place + turn @ _vector(child.get("pos", "")))
    return found


def test_every_degree_of_freedom_is_a_joint_with_its_limits() -> None:
    hand = HandModel.default()
    bodies: HandBodies = hand_bodies(hand)
    assert len(bodies.bodies) == 16 and len(bodies.joints) == 20
    by_name = {joint.name: joint for joint in bodies.joints}
    for f, finger in enumerate(FINGERS):
        assert by_name[f"{finger}_abd"].upper == hand.abduction_max[f]
        for k in range(3):
            assert by_name[f"{finger}_flex{k + 1}"].lower == hand.flexion_min[f, k]
    assert set(by_name) <= {element.get("name") for element in Xml.fromstring(hand_mjcf(hand)).iter("joint")}


def test_masses_are_those_of_a_hand_and_every_inertia_is_one() -> None:
    bodies = hand_bodies(HandModel.default()).bodies
    assert 0.2 < sum(body.inertial.mass for body in bodies) < 0.8
    for body in bodies:
        a, b, c = np.linalg.eigvalsh(body.inertial.inertia)
        assert a > 0.0 and c <= (a + b) * (1.0 + 1e-12)


def test_capsules_stand_for_a_tapering_phalanx_from_inside() -> None:
    cone = RoundCone(np.array([0.0, 0.0, 0.04]), 0.0187, 0.0098)
    capsules = cone.capsules()
    tan, _ = cone_slope(0.04, cone.start_radius, cone.end_radius)
    for z, x in np.random.default_rng(3).uniform([-0.03, 0.0], [0.06, 0.03], (2000, 2)):
        share = min(max((z - x * tan) / 0.04, 0.0), 1.0)
        exact = math.hypot(x, z - 0.04 * share) - (cone.start_radius - share * (cone.start_radius - cone.end_radius))
        near = min(math.hypot(x, z - min(max(z, part.start[2]), part.end[2])) - part.radius for part in capsules)
        # Exact inside is not the same distance: points deep inside tell nothing of the surface.
        if exact > -1e-4:
            assert exact - 1e-12 <= near <= exact + STEP
    equal = RoundCone(np.array([0.0, 0.0, 0.04]), 0.01, 0.01).capsules()
    assert len(equal) == 1 and not equal[0].is_sphere
