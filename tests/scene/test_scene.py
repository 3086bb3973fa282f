"""A scene puts object, tree, hand and motion into one world frame."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation
from sphere_scenes import bumpy_ball

from hhsim.arrays import FloatArray
from hhsim.hand.model import HandModel
from hhsim.metrics.metrics import hand_clearance
from hhsim.motion.trajectory import Trajectory
from hhsim.motion.tremor import Disturbance
from hhsim.scene.motion_catalogue import load_script
from hhsim.scene.scene import make_scene
from tools.shapes.generators import sphere

HAND = HandModel.default("right")
MESH = sphere(0.076, 2)
TREE = bumpy_ball(200)


def recording(position: FloatArray, orientation: FloatArray) -> Trajectory:
    """Five samples at 100 Hz beside an object at this pose."""
    return Trajectory(
        time=np.arange(5) / 100.0,
        position=np.linspace([0.0, 0.0, 0.3], [0.0, 0.0, 0.26], 5),
        orientation=np.tile([1.0, 0.0, 0.0, 0.0], (5, 1)),
        flexion=np.zeros((5, 5, 3)),
        abduction=np.zeros((5, 5)),
        object_position=position,
        object_orientation=orientation,
        name="five samples",
    )


def test_a_recording_says_where_the_object_is() -> None:
    turn = Rotation.from_rotvec([0.3, -0.5, 0.2])
    shift = np.array([0.1, -0.2, 0.05])
    scene = make_scene(MESH, TREE, HAND, recording(shift, turn.as_quat(scalar_first=True)))
    np.testing.assert_allclose(scene.mesh.vertices, turn.apply(MESH.vertices) + shift, atol=1e-12)
    np.testing.assert_array_equal(scene.mesh.faces, MESH.faces)
    np.testing.assert_allclose(scene.tree.center, turn.apply(TREE.center) + shift, atol=1e-12)
    np.testing.assert_array_equal(scene.tree.radius, TREE.radius)
    assert scene.trajectory.name == "five samples"


def test_the_motion_is_brought_to_the_ticks() -> None:
    still = np.array([1.0, 0.0, 0.0, 0.0])
    motion = recording(np.zeros(3), still)
    scene = make_scene(MESH, TREE, HAND, motion, rate=1000.0)
    assert scene.ticks.rate == 1000.0
    assert scene.ticks.tick_count == 41
    held = make_scene(MESH, TREE, HAND, motion, rate=1000.0, mode="hold")
    np.testing.assert_array_equal(held.ticks.position[:10], np.tile(motion.position[0], (10, 1)))
    assert len(np.unique(scene.ticks.position[:10, 2])) == 10


def test_a_script_closes_on_the_object() -> None:
    scene = make_scene(MESH, TREE, HAND, load_script("touch"))
    ticks = scene.ticks
    assert {phase.name for phase in ticks.phases} >= {"approach", "hold"}
    np.testing.assert_array_equal(scene.tree.center, TREE.center)
    joints = np.array(
        [
            HAND.joints(*(values[t] for values in (ticks.position, ticks.orientation, ticks.flexion, ticks.abduction)))
            for t in range(0, ticks.tick_count, 50)
        ]
    )
    palm = HAND.palm_tree
    position, orientation = ticks.position[::50], ticks.orientation[::50]
    _, finger = hand_clearance(
        TREE.arrays(), HAND.radius, palm.leaf_center, palm.leaf_radius, joints, position, orientation, 1.0
    )
    assert finger[0].min() > 0.0, "it starts outside"
    assert finger.min() < 0.0, "and commands a finger into the object"


def test_the_seed_is_of_the_tremor_only() -> None:
    script = load_script("touch")
    shaken = replace(script, disturbance=Disturbance(tremor_position=1e-4))
    one, two = (make_scene(MESH, TREE, HAND, script, seed=seed).ticks for seed in (1, 2))
    np.testing.assert_array_equal(one.position, two.position)
    first, again, other = (make_scene(MESH, TREE, HAND, shaken, seed=seed).ticks for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.position, again.position)
    assert 1e-6 < np.abs(first.position - other.position).max() < 1e-3
    assert 1e-6 < np.abs(first.position - one.position).max() < 1e-3
