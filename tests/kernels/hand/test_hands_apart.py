"""Distance of two hands against every pair of bodies, each minimised by SciPy."""

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from hhsim.arrays import FloatArray
from hhsim.hand.forward_kinematics import PlacedHand, forward_kinematics
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import rotation_matrix
from hhsim.metrics.metrics import distance_of_hands

HANDS = HandModel.default("right"), HandModel.default("left")
TICKS = 4


def placed(hand: HandModel, rng: np.random.Generator, away: FloatArray) -> PlacedHand:
    turn = Rotation.random(TICKS, random_state=rng).as_quat(scalar_first=True)
    bend = rng.uniform(0.0, 1.0, (TICKS, 5, 3)) * hand.flexion_max
    return forward_kinematics(hand, away + rng.normal(0.0, 0.03, (TICKS, 3)), turn, bend, np.zeros((TICKS, 5)))


def bodies(hand: HandModel, at: PlacedHand, tick: int) -> tuple[FloatArray, FloatArray]:
    """Ends of the axes (B, 2, 3) and radii there (B, 2) of 15 phalanges and all spheres of the palm."""
    ends = np.stack([at.joints[tick, :, :-1], at.joints[tick, :, 1:]], axis=2).reshape(15, 2, 3)
    radius = np.stack([hand.radius[:, :-1], hand.radius[:, 1:]], axis=2).reshape(15, 2)
    center = hand.palm_tree.leaf_center @ rotation_matrix(at.orientation[tick]).T + at.position[tick]
    palm = np.repeat(center[:, None], 2, axis=1), np.repeat(hand.palm_tree.leaf_radius[:, None], 2, axis=1)
    return np.concatenate([ends, palm[0]]), np.concatenate([radius, palm[1]])


def least(one: FloatArray, r: FloatArray, other: FloatArray, q: FloatArray) -> float:
    def gap(x: FloatArray) -> float:
        a, b = one[0] + x[0] * (one[1] - one[0]), other[0] + x[1] * (other[1] - other[0])
        return float(np.linalg.norm(a - b) - r[0] - x[0] * (r[1] - r[0]) - q[0] - x[1] * (q[1] - q[0]))

    starts = [(s, t) for s in (0.1, 0.9) for t in (0.1, 0.9)]
    return min(float(minimize(gap, at, bounds=[(0.0, 1.0)] * 2, tol=1e-14).fun) for at in starts)


@pytest.mark.parametrize("away", [0.05, 0.12, 0.3])
def test_it_is_the_least_over_all_pairs(away: float) -> None:
    rng = np.random.default_rng(int(100 * away))
    at = [placed(hand, rng, np.array([sign * away / 2, 0.0, 0.0])) for hand, sign in zip(HANDS, (1.0, -1.0))]
    found = distance_of_hands(HANDS, at)
    back = distance_of_hands(HANDS[::-1], at[::-1])
    np.testing.assert_allclose(back, found, atol=1e-12)
    for tick in range(TICKS):
        (ends, radius), (others, widths) = (bodies(hand, one, tick) for hand, one in zip(HANDS, at))
        # The balls that hold both bodies are a lower bound: of the pairs only the near ones are minimised.
        middle, other = ends.mean(axis=1), others.mean(axis=1)
        half = [
            np.linalg.norm(e[:, 1] - e[:, 0], axis=1) / 2 + w.max(axis=1) for e, w in ((ends, radius), (others, widths))
        ]
        bound = np.linalg.norm(middle[:, None] - other[None], axis=2) - half[0][:, None] - half[1][None]
        best = np.inf
        for i, j in zip(*np.unravel_index(np.argsort(bound, axis=None), bound.shape)):
            if bound[i, j] > best:
                break
            best = min(best, least(ends[i], radius[i], others[j], widths[j]))
        assert abs(found[tick] - best) < 1e-7


def test_a_joint_that_is_no_number_has_no_distance() -> None:
    rng = np.random.default_rng(1)
    one, other = (placed(hand, rng, np.zeros(3)) for hand in HANDS)
    one.joints[2, 3, 3, 1] = np.nan
    found = distance_of_hands(HANDS, (one, other))
    assert np.isnan(found).tolist() == [False, False, True, False]
