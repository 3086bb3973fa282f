"""Whether a hand that stood still could have moved: the judge of stuck ticks, apart from the solver.

It shares nothing with a tick but the hand's kinematics and the program's solver: distances are taken by brute force,
their derivatives by differences, and whether a step is free is decided by the distances at its end.
"""

import numpy as np
from numpy.typing import NDArray

from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.kernels.rotation import rotate_quaternion, rotation_vector_between
from hhsim.metrics.brute_force_distance import palm_spheres, round_cone_distance
from hhsim.solver.options import SolverOptions
from hhsim.solver.qp import QpProblem, QpStatus, solve
from hhsim.trees.sphere_tree import SphereTree

Array = NDArray[np.float64]
Pose = tuple[Array, Array, Array, Array]

WORTH = 0.01
"""A way must lower the coupling's energy by this share of what free space would let the same step lower it."""
SHARES = (1.0, 0.3, 0.1, 0.03, 0.01, 3e-3, 1e-3, 3e-4, 1e-4)
"""Shares of the program's step that are tried."""
ARRIVED = 1e-9
"""A hand that is this near to the haptic one [m] is there."""
DIFFERENCE = 1e-6
"""Step of the central differences [m, rad]."""


def way_out(
    hand: HandModel, tree: SphereTree, options: SolverOptions, graphic: HandConfiguration, haptic: HandConfiguration
) -> float:
    """The share of a step towards the haptic hand that was free and worth taking; 0 where there is none.

    A step is as long as the solver's longest near the object, follows the optimum of the linearised contacts, and keeps
    the abduction. It counts where all spheres stay clear of the hand and the energy falls as the program promised.

    Args:
        hand: The hand.
        tree: The object's sphere tree, world.
        options: Of the solver: stiffness, margin, offset.
        graphic: One tick, where the hand stood still.
        haptic: One tick, where the user has it, a reading of a hand.
    """
    here: Pose = tuple(values[0] for values in graphic)
    goal: Pose = tuple(values[0] for values in haptic)
    stiffness = options.stiffness.diagonal()
    target = _between(hand, here, goal)
    lever = float((hand.arrays().reach + hand.radius[:, 1:]).max())
    longest = np.linalg.norm(target[:3]) + lever * (np.linalg.norm(target[3:6]) + np.abs(target[6:]).max())
    if longest < ARRIVED:
        return 0.0
    clipped = target * min(1.0, options.margin / longest)
    pairs = _Pairs(hand, tree, here, 4.0 * options.margin)
    distance, matrix = pairs.linearised(here)
    limits = _limit_rows(hand, here)
    problem = QpProblem(
        stiffness=stiffness,
        matrix=np.concatenate([matrix, limits[0]]),
        # A little clear of what touches: the second order of a short step then cannot take it in.
        rhs=np.concatenate(
            [np.minimum(options.offset, np.maximum(distance, 0.0) + 0.1 * options.offset) - distance, limits[1]]
        ),
        target=clipped,
    )
    solution = solve(problem)
    if solution.status is not QpStatus.OPTIMAL:
        return 0.0

    def energy(offset: Array) -> float:
        return 0.5 * float(offset @ (stiffness * offset))

    promised = energy(target) - energy(target - solution.x)
    free = energy(target) - energy(target - clipped)
    if not promised > WORTH * free:
        return 0.0
    for share in SHARES:
        there = _moved(here, share * solution.x)
        gained = energy(target) - energy(_between(hand, there, goal))
        if gained > 0.1 * share * promised and pairs.least(there) >= min(0.0, float(distance.min(initial=0.0))):
            return share
    return 0.0


def _between(hand: HandModel, here: Pose, goal: Pose) -> Array:
    turn = np.empty(3)
    rotation_vector_between(np.array(here[1]), goal[1] / np.linalg.norm(goal[1]), turn)
    bend = np.clip(goal[2], hand.flexion_min, hand.flexion_max) - here[2]
    return np.concatenate([goal[0] - here[0], turn, bend.ravel()])


def _moved(here: Pose, step: Array) -> Pose:
    orientation = np.array(here[1])
    rotate_quaternion(orientation, step[3], step[4], step[5], orientation)
    return here[0] + step[:3], orientation, here[2] + step[6:].reshape(5, 3), here[3]


def _limit_rows(hand: HandModel, here: Pose) -> tuple[Array, Array]:
    rows = np.concatenate([np.eye(15), -np.eye(15)])
    matrix = np.concatenate([np.zeros((30, 6)), rows], axis=1)
    bounds = np.concatenate([(hand.flexion_min - here[2]).ravel(), (here[2] - hand.flexion_max).ravel()])
    return matrix, np.minimum(bounds, 0.0)


class _Pairs:
    """The object's leaves near each body of the hand."""

    def __init__(self, hand: HandModel, tree: SphereTree, pose: Pose, near: float) -> None:
        self._hand = hand
        self._palm = np.asarray(hand.palm_tree.leaf_center), np.asarray(hand.palm_tree.leaf_radius)
        everything = [(np.asarray(tree.leaf_center), np.asarray(tree.leaf_radius))] * (15 + len(self._palm[1]))
        self._leaves = everything
        distances = self._distances(pose)
        self._leaves = [(c[d <= near], r[d <= near]) for (c, r), d in zip(everything, distances)]

    def _distances(self, pose: Pose) -> list[Array]:
        hand, found = self._hand, []
        joints = hand.joints(*pose)
        for body in range(15):
            center, radius = self._leaves[body]
            ends, radii = joints[body // 3, body % 3 : body % 3 + 2], hand.radius[body // 3, body % 3 : body % 3 + 2]
            cone = round_cone_distance(center, ends[0], ends[1], float(radii[0]), float(radii[1]))
            found.append(cone - radius)
        for place, size, (center, radius) in zip(
            palm_spheres(self._palm[0], pose[0], pose[1]), self._palm[1], self._leaves[15:]
        ):
            found.append(np.linalg.norm(center - place, axis=1) - radius - size)
        return found

    def all(self, pose: Pose) -> Array:
        """Signed distances [m] of all near pairs, shape (N,)."""
        return np.concatenate(self._distances(pose))

    def least(self, pose: Pose) -> float:
        """Least signed distance [m] of all near pairs, infinite where there is none."""
        return float(self.all(pose).min(initial=np.inf))

    def linearised(self, pose: Pose) -> tuple[Array, Array]:
        """Distances, shape (N,), and their derivatives by the 21 variables, shape (N, 21)."""
        columns = []
        for variable in range(21):
            step = np.zeros(21)
            step[variable] = DIFFERENCE
            columns.append((self.all(_moved(pose, step)) - self.all(_moved(pose, -step))) / (2.0 * DIFFERENCE))
        return self.all(pose), np.stack(columns, axis=1)
