"""Recordings that touch any object: the shipped one on every object of the catalogue, and TOML of one's own."""

from pathlib import Path
from typing import cast

import pytest
from sampled import sampled
from sphere_scenes import object_tree, record_clearance

from hhsim.arrays import FloatArray
from hhsim.errors import TrajectoryError, UnknownNameError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.fingers import FINGERS
from hhsim.hand.forward_kinematics import forward_kinematics
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import rotation_matrix
from hhsim.mesh.catalogue import object_names
from hhsim.motion.trajectory import Trajectory
from hhsim.scene.demonstration import Demonstration, Wanted, parse_demonstration
from hhsim.scene.motion_catalogue import describe, load_script, resolve_trajectory, script_names, trajectory_names
from hhsim.trees.sphere_tree import SphereTree

HAND = HandModel.default()
TAP = cast(Demonstration, resolve_trajectory("finger-tap"))


def distances(motion: Trajectory, tree: SphereTree) -> FloatArray:
    """Of the 16 bodies at every sample, the object where the motion says it is."""
    there = tree.transformed(rotation_matrix(motion.object_orientation), motion.object_position)
    return record_clearance(HAND, there, forward_kinematics(HAND, *HandConfiguration.of(motion)))


@pytest.mark.parametrize("name", sampled(object_names(), lambda place, name: place in (0, 9)))
def test_the_finger_taps_every_object(name: str) -> None:
    tree = object_tree(name)
    motion = TAP.placed(HAND, tree)
    distance = distances(motion, tree)
    index = distance[:, 3:6].min(axis=1)
    assert distance[0].min() > 0.002, "the hand begins free"
    assert index.min() < -0.004, "the index finger goes in"
    assert index.min() > -0.03
    assert (index < 0.0).mean() < 0.5, "a tap is no hold"
    assert distance[:, 15].min() > 0.0, "the palm stays away"
    assert "the object placed so that the index goes 15 mm into it" in motion.source
    assert motion.position.tobytes() == TAP.motion.position.tobytes()


def test_the_catalogue_tells_scripts_and_recordings_apart() -> None:
    assert trajectory_names() == [*script_names(), "finger-tap"]
    assert "finger-tap" not in script_names()
    description = describe("finger-tap")
    assert description.fingers == ("index",) and 53.0 < description.rate < 55.0 and description.title
    assert TAP.name == "finger-tap" and TAP.hand == "right"
    with pytest.raises(UnknownNameError, match="unknown trajectory 'finger-tap'"):
        load_script("finger-tap")


def test_a_demonstration_of_ones_own(tmp_path: Path, repository: Path) -> None:
    (tmp_path / "tap.h5").write_bytes((repository / "trajectories" / "finger-tap.h5").read_bytes())
    own = tmp_path / "own.toml"
    own.write_text('recording = "tap.h5"\n[touch]\nfinger = "middle"\ndepth = 0.01\n')
    motion = resolve_trajectory(own)
    assert isinstance(motion, Demonstration) and motion.name == "own" and FINGERS.index(motion.touch.finger) == 2
    motion.placed(HAND, object_tree("sphere"))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("recording = 3", "recording = 3; expected the name"),
        ("recording = 'none.h5'\ntouch = { finger = 'index', depth = 0.01 }", "no recording none.h5 beside it"),
        ("recording = 'tap.h5'\ntouch = { finger = 'toe', depth = 0.01 }", "touch.finger: unknown finger 'toe'"),
        ("recording = 'tap.h5'\ntouch = { finger = 'index' }", "touch: depth is missing"),
    ],
)
def test_demonstrations_that_are_none(tmp_path: Path, repository: Path, text: str, words: str) -> None:
    (tmp_path / "tap.h5").write_bytes((repository / "trajectories" / "finger-tap.h5").read_bytes())
    with pytest.raises(TrajectoryError, match=words) as error:
        parse_demonstration(text, name="own", folder=tmp_path, where="own.toml")
    assert "\n" not in str(error.value)
    (tmp_path / "own.toml").write_text(text)
    with pytest.raises(TrajectoryError):
        resolve_trajectory(tmp_path / "own.toml")


def test_where_no_place_is_free_it_says_so() -> None:
    still = Trajectory(TAP.motion.time[:1], *HandConfiguration.of(TAP.motion).part(0, 1))
    with pytest.raises(TrajectoryError, match="cannot be placed at this object"):
        Demonstration(still, Wanted("index", 0.01)).placed(HAND, object_tree("cube"))
