"""A hand among random spheres with its contacts found, and the rows made of them: what tests of the contacts share."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation
from sphere_scenes import PALM, cloud, random_hand, set_pose, tick_state

from hhsim.arrays import FloatArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.kernels.contact.detection import ListDistances, evaluate, find_contacts
from hhsim.kernels.hand.kinematics import DOF
from hhsim.kernels.hand.pose import HAND_POSE
from hhsim.solver.method import surface_of
from hhsim.solver.options import Stiffness
from hhsim.trees.sphere_tree import SphereTree

RIGHT = HandModel.default("right")
LEFT = HandModel.default("left")
ROOT = np.sqrt(Stiffness().diagonal())


def moved(at: HandConfiguration, step: FloatArray, abduction_step: FloatArray | None = None) -> HandConfiguration:
    """A configuration after (δp, δφ, δθ), the rotation from the left, and a change of the abduction."""
    turned = Rotation.from_rotvec(step[3:6]) * Rotation.from_quat(at.orientation[0], scalar_first=True)
    return HandConfiguration(
        at.position + step[:3],
        turned.as_quat(scalar_first=True)[None],
        at.flexion + step[6:].reshape(1, 5, 3),
        at.abduction + (np.zeros(5) if abduction_step is None else abduction_step),
    )


def transform(rotation: Rotation, translation: ArrayLike = (0.0, 0.0, 0.0)) -> FloatArray:
    """A rotation and a translation after it as a matrix (4, 4)."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation.as_matrix(), translation
    return matrix


def body_frames(hand: HandModel, at: HandConfiguration) -> FloatArray:
    """Frames of the phalanges and of the palm in the world, (16, 4, 4); y is along a phalanx, z dorsal.

    By T_world_palm T_palm_finger R_abduction Π R_x(-θ) T(0, L, 0), from the hand's definition.
    """
    palm, frames = transform(Rotation.from_quat(at.orientation[0], scalar_first=True), at.position[0]), []
    for f in range(5):
        axes = [np.cross(hand.distal[f], hand.dorsal[f]), hand.distal[f], hand.dorsal[f]]
        chain = palm @ transform(Rotation.from_matrix(np.stack(axes, axis=1)), hand.base[f])
        chain = chain @ transform(Rotation.from_euler("z", hand.abduction_sign * at.abduction[0, f]))
        for k in range(3):
            chain = chain @ transform(Rotation.from_euler("x", -at.flexion[0, f, k]))
            frames.append(chain)
            chain = chain @ transform(Rotation.identity(), (0.0, hand.length[f, k], 0.0))
    return np.array([*frames, palm])


def posed(hand: HandModel, at: HandConfiguration) -> Any:
    """The record of a pose, with what the kernels make of it."""
    here = np.zeros(1, HAND_POSE).view(np.recarray)[0]
    set_pose(hand, here, at)
    return here


def in_contact(hand: HandModel, surface: Any, at: HandConfiguration, reach: float, skin: float = 0.0) -> Any:
    """The state of a tick at a place, its contacts within a reach [m] of any surface found."""
    state, arrays = tick_state(ROOT**2, surface=surface_of(surface)), hand.arrays()
    set_pose(hand, state.pose, at)
    assert evaluate(arrays, state.pose, surface, ListDistances(reach, reach, skin), state.candidates, state.work) == 0
    assert find_contacts(surface, arrays, state.pose, state.candidates, reach, state.contacts) == 0
    return state


def scene(seed: int) -> tuple[HandModel, SphereTree, HandConfiguration, Any]:
    """A hand among spheres, its contacts found; some penetrate, as in the middle of a tick."""
    random = np.random.default_rng(seed)
    hand = RIGHT if seed % 2 else LEFT
    tree = cloud(random, 120, spread=0.1)
    at = random_hand(random, hand, 0.03)
    return hand, tree, at, in_contact(hand, tree.arrays(), at, 3e-3)


def assert_grouped(contacts: Any) -> None:
    """Contacts of the palm come first, then those of each finger, phalanx by phalanx."""
    start, body = contacts.start, contacts.body
    assert (body[: start[1]] == PALM).all()
    for f in range(5):
        rows = body[start[f + 1] : start[f + 2]]
        assert (rows // 3 == f).all() and (rows < PALM).all()
        assert (np.diff(rows) >= 0).all()
        ends = [start[f + 1] + np.sum(rows <= 3 * f + k) for k in range(3)]
        np.testing.assert_array_equal(contacts.phalanx_end[f], ends)


def row_matrix(state: Any) -> FloatArray:
    """Contact rows in m/m and m/rad, unscaled, shape (contacts, 21)."""
    count, start = int(state.contacts.start[-1]), state.contacts.start
    matrix = np.zeros((count, DOF))
    matrix[:, :6] = state.problem.common[:, :count].T
    for f in range(5):
        own = slice(start[f + 1], start[f + 2])
        matrix[own, 6 + 3 * f : 9 + 3 * f] = state.problem.block[:, own].T
    return matrix * ROOT


def pair_of(state: Any, tree: SphereTree, i: int) -> tuple[int, int]:
    key, total = int(state.contacts.key[i]), len(tree.radius)
    return key // total, key % total - tree.leaf_start
