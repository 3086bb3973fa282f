"""Forces against the coupling that they balance, and against the paper's equations recomputed from poses."""

from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from sphere_scenes import CURL, PALM, brute_pairs, bumpy_ball, palm_spheres

from hhsim.arrays import FloatArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.kernels.tick.block import TickRecord
from hhsim.motion.analytic_motion import still
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.options import TOUCH, SolverOptions
from hhsim.trees.sphere_tree import SphereTree

RIGHT = HandModel.default("right")
LEFT = HandModel.default("left")
BALL = bumpy_ball(400)
OVER_THE_BALL = np.array([0.0, -0.045, 0.058])


class Hold(NamedTuple):
    """A hand that has pressed on the ball until nothing moved any more."""

    hand: HandModel
    options: SolverOptions
    haptic: HandConfiguration
    graphic: HandConfiguration
    record: TickRecord
    state: Any
    """The solver's state after the last tick."""


def press(hand: HandModel, method: str, force: str, flat: bool = False, ticks: int = 400) -> Hold:
    """From above, fingers straight, to a hand inside the ball, curled about it or flat; then hold."""
    if flat:
        goal = still([-0.02, 0.015, 0.045], abduction=0.02)
    else:
        goal = still(OVER_THE_BALL - [0.0, 0.0, 0.006], flexion=CURL, abduction=0.02)
    start = still(goal.position[0] + [0.0, 0.0, 0.1], abduction=0.02)
    options = SolverOptions(method=method, force=force)
    solver = HandSolver(hand, BALL.arrays(), options)
    solver.run(*start.line(goal, 299))
    record = solver.run(*goal.hold(ticks - 1))
    graphic = HandConfiguration(
        record.position[-1:], record.orientation[-1:], record.flexion[-1:], record.abduction[-1:]
    )
    return Hold(hand, options, goal, graphic, record, solver.workspace.states[0])


@pytest.fixture(scope="module")
def holds() -> dict[str, Hold]:
    return {
        "coupled, curled": press(RIGHT, "coupled", "kkt"),
        "coupled, flat": press(RIGHT, "coupled", "kkt", flat=True),
        "progressive, curled": press(RIGHT, "progressive", "kkt"),
        "progressive, flat": press(RIGHT, "progressive", "kkt", flat=True),
    }


@pytest.fixture(params=["coupled, curled", "coupled, flat", "progressive, curled", "progressive, flat"])
def kkt(request: pytest.FixtureRequest, holds: dict[str, Hold]) -> Hold:
    return holds[request.param]


@pytest.fixture(params=["coupled, curled", "coupled, flat", "progressive, flat"])
def balanced(request: pytest.FixtureRequest, holds: dict[str, Hold]) -> Hold:
    """Holds at which the palm feels all that the hand does; in the paper's order the fingers' contacts are not."""
    return holds[request.param]


@pytest.fixture(scope="module", params=[RIGHT, LEFT], ids=["right", "left"])
def paper(request: pytest.FixtureRequest) -> Hold:
    return press(request.param, "coupled", "paper")


def active_contacts(hold: Hold) -> tuple[FloatArray, FloatArray, FloatArray, NDArray[np.int64]]:
    """Points (n, 3), normals (n, 3), multipliers (n,) and bodies of the contacts that carry force."""
    active = hold.state.active
    which = np.flatnonzero(active.body[: active.count] >= 0)
    return active.point[:, which].T, active.normal[:, which].T, active.multiplier[which], active.body[which]


def limit_torques(hold: Hold) -> FloatArray:
    """What the joint limits push [N·m], positive towards flexion, shape (5, 3)."""
    torque = np.zeros(15)
    active = hold.state.active
    for i in np.flatnonzero(active.body[: active.count] < 0):
        limit = -1 - active.key[i]
        torque[limit // 2] += active.multiplier[i] * (1.0 if limit % 2 == 0 else -1.0)
    return torque.reshape(5, 3)


def palm_offset(hold: Hold) -> tuple[FloatArray, FloatArray]:
    """Graphic from haptic palm: shift (3,) and rotation vector (3,)."""
    graphic = Rotation.from_quat(hold.graphic.orientation[0], scalar_first=True)
    haptic = Rotation.from_quat(hold.haptic.orientation[0], scalar_first=True)
    return hold.graphic.position[0] - hold.haptic.position[0], (graphic * haptic.inv()).as_rotvec()


def body_frame(hand: HandModel, at: HandConfiguration, body: int) -> tuple[FloatArray, FloatArray]:
    """Origin (3,) and rotation (3, 3) of a rigid body of the hand in the world, from the hand's definition."""
    palm = Rotation.from_quat(at.orientation[0], scalar_first=True)
    if body == PALM:
        return at.position[0], palm.as_matrix()
    f, k = divmod(body, 3)
    sign = 1.0 if hand.side == "right" else -1.0
    spread = Rotation.from_rotvec(sign * at.abduction[0, f] * hand.dorsal[f])
    axis = np.cross(hand.dorsal[f], hand.distal[f])
    curl = Rotation.from_rotvec(at.flexion[0, f, : k + 1].sum() * axis)
    return hand.joints(*at.at(0))[f, k], (palm * spread * curl).as_matrix()


def test_the_multipliers_balance_the_palm(balanced: Hold) -> None:
    # G (q_g - q_h) = Jᵀ λ in the palm's six degrees of freedom: forces, and torques about its origin.
    point, normal, multiplier, _ = active_contacts(balanced)
    stiffness = balanced.options.stiffness
    shift, turn = palm_offset(balanced)
    force = multiplier[:, None] * normal
    torque = np.cross(point - balanced.graphic.position[0], force)
    size = float(np.linalg.norm(force, axis=1).sum())
    assert size > 1.0
    np.testing.assert_allclose(force.sum(axis=0), stiffness.translation * shift, atol=1e-6 * size)
    scale = float(np.linalg.norm(torque, axis=1).sum())
    np.testing.assert_allclose(torque.sum(axis=0), stiffness.rotation * turn, atol=1e-6 * scale)


def test_the_multipliers_balance_every_joint(kkt: Hold) -> None:
    point, normal, multiplier, body = active_contacts(kkt)
    force = multiplier[:, None] * normal
    limits = limit_torques(kkt)
    off = kkt.graphic.flexion[0] - kkt.haptic.flexion[0]
    scale = kkt.options.stiffness.flexion * np.abs(off).max()
    joints = kkt.hand.joints(*(values[0] for values in kkt.graphic))
    for f in range(5):
        axis = body_frame(kkt.hand, kkt.graphic, 3 * f)[1] @ np.cross(kkt.hand.dorsal[f], kkt.hand.distal[f])
        for k in range(3):
            moves = (body // 3 == f) & (body % 3 >= k) & (body < PALM)
            about = (np.cross(point[moves] - joints[f, k], force[moves]) @ axis).sum() + limits[f, k]
            assert about == pytest.approx(kkt.options.stiffness.flexion * off[f, k], abs=1e-6 * scale + 1e-12)


def test_the_palm_wrench_is_equation_1(kkt: Hold) -> None:
    shift, turn = palm_offset(kkt)
    stiffness = kkt.options.stiffness
    expected = np.concatenate([stiffness.translation * shift, stiffness.rotation * turn])
    np.testing.assert_allclose(kkt.record.palm_wrench[-1], expected, rtol=1e-9, atol=1e-9)


def fingertips_of_figure_9(hold: Hold) -> int:
    """Hold the fingertip forces against Fig. 9; returns how many fingers bear one."""
    graphic, haptic = (hold.hand.joints(*at.at(0)) for at in (hold.graphic, hold.haptic))
    pressed = 0
    for f in range(5):
        found = hold.record.fingertip_normal[-1, f]
        if not hold.record.phalanx[-1, f].any():
            assert not found.any()
            continue
        apart = graphic[f, 3] - haptic[f, 3]
        direction = (graphic[f, 3] - graphic[f, 2]) / np.linalg.norm(graphic[f, 3] - graphic[f, 2])
        across = apart - (apart @ direction) * direction
        expected = hold.options.stiffness.contact * np.linalg.norm(apart) * across / np.linalg.norm(across)
        np.testing.assert_allclose(found, expected, rtol=1e-9)
        pressed += 1
    return pressed


def test_fingertip_forces_are_those_of_figure_9(holds: dict[str, Hold]) -> None:
    for name, hold in holds.items():
        pressed = fingertips_of_figure_9(hold)
        assert pressed == 0 if name.endswith("flat") else pressed >= 3


def test_paper_forces_are_equation_14_over_the_spheres_in_touch(paper: Hold) -> None:
    distance = brute_pairs(paper.hand, BALL.leaf_center, BALL.leaf_radius, paper.graphic)
    force = np.zeros((16, 3))
    touching = np.argwhere(distance <= TOUCH)
    assert len(touching) >= 3
    for row, leaf in touching:
        body = min(row, PALM)
        normal, point = nearest_on_hand(paper.hand, BALL, paper.graphic, row, leaf)
        (origin, turn), (origin_h, turn_h) = (body_frame(paper.hand, at, body) for at in (paper.graphic, paper.haptic))
        same_point = origin_h + turn_h @ (turn.T @ (point - origin))
        force[body] += paper.options.stiffness.contact * np.linalg.norm(point - same_point) * normal
    np.testing.assert_allclose(paper.record.phalanx[-1].reshape(15, 3), force[:PALM], rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(paper.record.total[-1], force.sum(axis=0), rtol=1e-6, atol=1e-6)


def nearest_on_hand(
    hand: HandModel, tree: SphereTree, at: HandConfiguration, row: int, leaf: int
) -> tuple[FloatArray, FloatArray]:
    """Normal from object to hand, and the hand's point nearest to a leaf: the axis is searched by golden section."""
    center = tree.leaf_center[leaf]
    if row >= PALM:
        middle = palm_spheres(hand.palm_tree.leaf_center, at.position, at.orientation)[0, row - PALM]
        radius = float(hand.palm_tree.leaf_radius[row - PALM])
    else:
        f, k = divmod(row, 3)
        joints = hand.joints(*at.at(0))[f, k : k + 2]
        radii = hand.radius[f, k : k + 2]

        def distance(share: float) -> float:
            x = joints[0] + share * (joints[1] - joints[0])
            return float(np.linalg.norm(center - x) - (radii[0] + share * (radii[1] - radii[0])))

        from scipy.optimize import minimize_scalar

        share = float(minimize_scalar(distance, bounds=(0.0, 1.0), method="bounded", options={"xatol": 1e-10}).x)
        share = min((share, 0.0, 1.0), key=distance)
        middle = joints[0] + share * (joints[1] - joints[0])
        radius = float(radii[0] + share * (radii[1] - radii[0]))
    normal = (middle - center) / np.linalg.norm(middle - center)
    return normal, middle - radius * normal
