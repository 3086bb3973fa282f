"""The paper's scenes, and that in each the named fingers touch the named parts of the object."""

from functools import cache

import numpy as np
import pytest
from conftest import sampled

from hhsim.bench.paper.run import check_holds, paper_scenarios
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.fingers import FINGERS
from hhsim.hand.model import HandModel
from hhsim.mesh.catalogue import load_object
from hhsim.motion.trajectory import Trajectory
from hhsim.scene.contact_goals import TOUCHING
from hhsim.scene.motion_catalogue import load_script
from hhsim.scene.synthesis import synthesize
from hhsim.solver.options import SolverOptions
from hhsim.trees.cache import cached_sphere_tree
from hhsim.trees.options import TreeOptions
from hhsim.trees.sphere_tree import SphereTree

HAND = HandModel.default()
SIMPLE = ["sphere", "cylinder", "triangular-prism", "cube", "hexagonal-prism"]
COMPLEX = ["rock", "shamrock", "cup", "teapot", "bunny"]
PLAYED = sorted({(s.object_name, s.motion) for s in paper_scenarios()})
LEVEL = 3
"""Of the trees of the simple objects, as in the paper; the finer ones of the others take long to build."""
THIN = ("cup", "wall")
"""Between the spheres of a coarse tree, the fingers do not meet on the cup's wall."""
AT_LEVELS = [
    *sampled(
        [(*played, 4 if played == THIN else LEVEL) for played in PLAYED],
        lambda place, case: place % 6 == 0 or case[:2] == THIN,
    ),
    *(pytest.param(*played, 4, marks=pytest.mark.soak) for played in PLAYED if played[0] in COMPLEX and played != THIN),
]


@cache
def object_tree(name: str, level: int) -> SphereTree:
    return cached_sphere_tree(load_object(name).mesh, TreeOptions(level=level))


@cache
def motion_of(object_name: str, motion: str, level: int) -> Trajectory:
    return synthesize(load_script(motion), HAND, object_tree(object_name, level))


@pytest.mark.parametrize(("object_name", "motion", "level"), AT_LEVELS)
def test_every_scene_touches_what_it_names(object_name: str, motion: str, level: int) -> None:
    script, tree = load_script(motion), object_tree(object_name, level)
    trajectory = motion_of(object_name, motion, level)
    found = check_holds(script, object_name, HAND, tree, trajectory, SolverOptions())
    demanded = [str(touch) for touches in script.hold_touches for touch in touches]
    missed = [
        f"{touch}: {1e6 * distance:.1f} µm"
        for touch, distance in zip(demanded, np.concatenate(found))
        if not distance < TOUCHING
    ]
    assert demanded and missed == []


@pytest.mark.parametrize(("object_name", "motion"), [p for p in PLAYED if load_script(p[1]).objects])
def test_a_placed_hand_comes_free_and_its_idle_fingers_stay_free(object_name: str, motion: str) -> None:
    from hhsim.hand.forward_kinematics import forward_kinematics, hand_shape
    from hhsim.metrics.metrics import hand_clearance

    script, tree = load_script(motion), object_tree(object_name, LEVEL)
    trajectory = motion_of(object_name, motion, LEVEL)
    # A hand goes no farther than a millimetre or two in five samples.
    chosen = np.unique(np.append(np.arange(0, trajectory.sample_count, 5), trajectory.sample_count - 1))
    time = trajectory.time[chosen]
    approach = time < script.phases[0].duration
    placed = forward_kinematics(HAND, *HandConfiguration.of(trajectory).at(chosen))
    palm, fingers = hand_clearance(tree.arrays(), hand_shape(HAND), placed, limit=0.1)
    assert min(palm[approach].min(), fingers[approach].min()) > 0.0
    idle = [f for f, finger in enumerate(FINGERS) if finger not in script.fingers]
    held = time < sum(phase.duration for phase in script.phases[:3])
    assert fingers[held][:, idle].min(initial=np.inf) > 0.0
    assert min(palm[0], fingers[0].min()) > 0.02 and min(palm[-1], fingers[-1].min()) > 0.02
