"""The judge of stuck ticks: it finds a way where there is one, and none at an optimum."""

import numpy as np
import pytest
from numpy.typing import NDArray
from sphere_scenes import bumpy_ball, sphere_tree
from stress_motion import random_targets

from hhsim.bench.robustness.local_optimality import way_out
from hhsim.bench.robustness.random_targets import StressOptions
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.options import SolverOptions

HAND = HandModel.default()
BALL = bumpy_ball(1200)
OPTIONS = SolverOptions()


def tick_of(record: object, tick: int) -> HandConfiguration:
    return HandConfiguration(*(getattr(record, name)[tick : tick + 1] for name in HandConfiguration._fields))


def test_in_free_space_the_way_is_free() -> None:
    motion = random_targets(HAND, 2, 0)
    goal = motion.part(1, 2).copy()
    goal.position[0, 0] += 0.05
    assert way_out(HAND, BALL, OPTIONS, motion.part(0, 1), goal) == 1.0
    assert way_out(HAND, BALL, OPTIONS, goal, goal) == 0.0


@pytest.mark.parametrize("seed", range(4))
def test_at_an_optimum_there_is_none_and_away_from_it_there_is(seed: int) -> None:
    # Held still, the coupled method comes to rest at a local optimum; on the way there it is at none.
    motion = random_targets(
        HAND, 10 * 200, seed, StressOptions(hold=200, bound="none", sweep=False, position_spread=0.03)
    )
    record = HandSolver(HAND, BALL.arrays(), OPTIONS).run(*motion)
    touching, moving = 0, 0
    for hold in range(1, 10):
        end = 200 * hold + 199
        rest = tick_of(record, end)
        touching += int(record.work[end, 6] > 0)
        assert way_out(HAND, BALL, OPTIONS, rest, motion.part(end, end + 1)) == 0.0
        next_goal = motion.part((end + 1) % 2000, (end + 1) % 2000 + 1)
        moving += int(way_out(HAND, BALL, OPTIONS, rest, next_goal) > 0.0)
    assert touching > 4
    assert moving == 9


def test_a_straight_finger_that_pushes_a_wall_can_only_go_back_or_aside() -> None:
    (sample,) = zip(*random_targets(HAND, 1, 0))
    joints = HAND.joints(*sample)
    ahead = joints[2, 3] - joints[2, 2]
    ahead /= np.linalg.norm(ahead)
    tree = sphere_tree((joints[2, 3] + (HAND.radius[2, 3] + 0.1 + 1e-9) * ahead)[None], np.array([0.1]))
    here = HandConfiguration(*(np.array(values)[None] for values in sample))

    def way(direction: NDArray[np.float64]) -> float:
        goal = here.copy()
        goal.position[0] += 0.05 * direction
        return way_out(HAND, tree, OPTIONS, here, goal)

    assert way(ahead) == 0.0
    assert way(-ahead) == 1.0
    assert way(np.array([1.0, 0.0, 0.0])) > 0.0
