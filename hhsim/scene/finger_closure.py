"""A hand closed on an object: the palm's place, the fingers' postures, and how near each body is."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.hand import finger_closure as kernel
from hhsim.kernels.hand.kinematics import BODY_COUNT, HandArrays
from hhsim.kernels.sphere_tree import STACK_SIZE, TreeArrays

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class FingerClosure:
    """A grasp of one object: a palm pose, an open hand and the postures that touch and press.

    Attributes:
        rotation: Palm to world, shape (3, 3).
        back: Unit direction of the way back to the start, shape (3,), world; the palm's normal if not told otherwise.
        position: Palm origin where the fingers close [m], shape (3,), world; a palm that is to touch does so there.
        open: Flexion of the open hand [rad], shape (5, 3).
        contact: Flexion at first contact; the open one for fingers that do not close [rad], shape (5, 3).
        command: Flexion commanded into the object [rad], shape (5, 3).
        abduction: [rad], shape (5,).
        reached: The named fingers whose command lies inside the object.
        missed: The named fingers that do not reach it.
        slide: Unit direction of a slide, shape (3,), world; zeros where the script has none.
        distance: Signed distance of each body with the palm and all named fingers as commanded [m], shape (16,).
    """

    rotation: Array
    back: Array
    position: Array
    open: Array
    contact: Array
    command: Array
    abduction: Array
    reached: tuple[str, ...]
    missed: tuple[str, ...]
    slide: Array
    distance: Array


def make_work() -> kernel.ClosureWork:
    """Workspace for the kernels of the search."""
    return kernel.ClosureWork(
        joints=np.zeros((5, 4, 3)),
        direction=np.zeros((5, 3, 3)),
        axis=np.zeros((5, 3)),
        abduction_axis=np.zeros((5, 3)),
        stack=np.zeros(STACK_SIZE, dtype=np.int64),
    )


def body_distances(
    hand: HandArrays,
    tree: TreeArrays,
    position: Array,
    rotation: Array,
    flexion: Array,
    abduction: Array,
    work: kernel.ClosureWork,
) -> Array:
    """Signed distance of the 15 phalanges and the palm to the object's leaf spheres [m], shape (16,).

    `work` then holds the kinematics of that pose.
    """
    distance = np.empty(BODY_COUNT)
    kernel.body_distances(hand, tree, position, rotation, flexion, abduction, np.inf, work, distance)
    return distance
