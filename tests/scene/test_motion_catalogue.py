"""The catalogue, and every script of it on every object of the other one."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from joint_samples import joint_sample, openxr_csv
from recording_samples import smooth_recording
from sampled import sampled
from sphere_scenes import object_tree, record_clearance

from hhsim.arrays import FloatArray
from hhsim.errors import TrajectoryError, UnknownNameError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.fingers import FINGERS
from hhsim.hand.forward_kinematics import forward_kinematics
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import rotation_matrix
from hhsim.kernels.hand.kinematics import PALM_BODY
from hhsim.mesh.catalogue import object_names
from hhsim.motion.file import save_trajectory
from hhsim.motion.sample_flags import DAMAGED, SampleFlag
from hhsim.motion.trajectory import UNCHECKED, Trajectory
from hhsim.recordings.cleaning import clean_recording
from hhsim.scene.motion_catalogue import (
    describe,
    import_remarks,
    is_imported,
    load_script,
    resolve_trajectory,
    script_names,
    trajectory_names,
)
from hhsim.scene.script import Script
from hhsim.scene.synthesis import synthesize
from hhsim.trees.sphere_tree import SphereTree

NAMES = ["touch", "pinch", "grasp", "whole-hand", "slide", "carry", "sequence", "never"]
MOVING = ["lift", "shake", "turn", "push", "slip"]
HAND = HandModel.default()
STRIDE = 20
"""Every how many samples the hand is looked at."""


def test_the_catalogue_is_what_the_contract_names() -> None:
    general = NAMES + MOVING
    assert script_names()[: len(general)] == general
    assert not any(describe(name).objects for name in general)


def test_names_scripts_and_recordings_are_resolved(tmp_path: Path) -> None:
    named = resolve_trajectory("grasp")
    assert isinstance(named, Script) and named.name == "grasp"
    own = tmp_path / "own.toml"
    own.write_text('[[phase]]\nname = "approach"\nduration = 1\n[[phase]]\nname = "grasp"\nduration = 1\n')
    script = resolve_trajectory(own)
    assert isinstance(script, Script) and script.name == "own"
    motion = Trajectory(
        np.arange(3.0), np.zeros((3, 3)), np.tile([1.0, 0, 0, 0], (3, 1)), np.zeros((3, 5, 3)), np.zeros((3, 5))
    )
    for name in ("m.h5", "m.csv", "M.CSV"):
        save_trajectory(motion, tmp_path / name)
        recording = resolve_trajectory(str(tmp_path / name))
        assert isinstance(recording, Trajectory) and recording.sample_count == 3


def test_a_table_of_another_maker_is_imported_by_its_columns(tmp_path: Path) -> None:
    path = tmp_path / "quest.csv"
    path.write_text(openxr_csv(joint_sample()))
    motion = resolve_trajectory(path)
    assert is_imported(path) and isinstance(motion, Trajectory) and motion.flags is not None
    assert np.abs(motion.flexion - joint_sample().motion.flexion).max() < 1e-5
    path.write_text("time,a,b\n0,1,2\n1,2,3\n")
    assert not is_imported(path)
    with pytest.raises(TrajectoryError, match=r"no column px, .*\(hhsim import reads other tables, and mends\)"):
        resolve_trajectory(path)


def test_a_recording_that_was_imported_on_the_way_in_is_said_to_be(tmp_path: Path) -> None:
    motion = replace(clean_recording(smooth_recording()).trajectory, flags=np.zeros(300, dtype=np.uint32))
    assert import_remarks(motion, "take.npz") == [
        "the recording was imported on the way in: hhsim import tells what it was taken for"
    ]
    assert import_remarks(motion, "take.h5") == import_remarks(None, "") == []
    touched = replace(motion, flags=np.full(300, SampleFlag.LIMITED.value, dtype=np.uint32))
    assert import_remarks(touched, "take.npz") == [
        "300 of 300 samples were mended on the way in: hhsim import tells what"
    ]
    assert import_remarks(touched, "take.h5") == []
    # Text has no checksums, which matters where damage is found.
    path = tmp_path / "quest.csv"
    path.write_text(openxr_csv(joint_sample()))
    unchecked = resolve_trajectory(path)
    assert unchecked.checksums == "missing" and import_remarks(unchecked, str(path))[1:] == []
    for flag in SampleFlag:
        found = replace(unchecked, flags=np.full(unchecked.sample_count, flag.value, dtype=np.uint32))
        assert (UNCHECKED in import_remarks(found, str(path))) == (flag in DAMAGED)
        assert UNCHECKED not in import_remarks(replace(found, checksums="held"), str(path))


def test_what_is_no_trajectory_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError, match="unknown trajectory 'grsp': did you mean grasp"):
        resolve_trajectory("grsp")
    with pytest.raises(TrajectoryError, match=r"none.toml: no such file"):
        resolve_trajectory("none.toml")
    with pytest.raises(TrajectoryError, match=r"none.csv: no such file"):
        resolve_trajectory("none.csv")
    other = tmp_path / "glove.mat"
    other.touch()
    with pytest.raises(TrajectoryError, match=r"not a trajectory by its suffix; expected .toml, .h5"):
        resolve_trajectory(other)


def test_the_recorded_tap_of_the_catalogue_goes_into_its_object() -> None:
    assert trajectory_names() == [*script_names(), "finger-tap"]
    with pytest.raises(UnknownNameError, match="unknown trajectory 'finger-tap'"):
        load_script("finger-tap")
    entry, motion = describe("finger-tap"), resolve_trajectory("finger-tap")
    assert isinstance(motion, Trajectory) and (motion.name, motion.hand) == ("finger-tap", "right")
    assert entry.objects == ("bunny",) and 53.0 < entry.rate < 55.0 and entry.title
    there = object_tree("bunny").transformed(rotation_matrix(motion.object_orientation), motion.object_position)
    distance = record_clearance(HAND, there, forward_kinematics(HAND, *HandConfiguration.of(motion)))
    index = distance[:, 3:6].min(axis=1)
    assert -0.03 < index.min() < -0.004 and distance[0].min() > 0.002 and distance[:, PALM_BODY].min() > 0.0
    assert (index < 0.0).mean() < 0.5, "a tap is no hold"


def look(motion: Trajectory, tree: SphereTree, hand: HandModel) -> tuple[FloatArray, FloatArray, FloatArray]:
    """At every STRIDE-th sample: time (K,), body distances (K, 16), fingertip centres (K, 5, 3)."""
    placed = forward_kinematics(hand, *HandConfiguration.of(motion).at(slice(None, None, STRIDE)))
    return motion.time[::STRIDE], record_clearance(hand, tree, placed), placed.joints[:, :, 3]


@pytest.mark.parametrize(
    ("name", "item"),
    sampled([(name, item) for name in NAMES for item in object_names()], lambda place, case: place % 22 == 0),
)
def test_every_script_does_what_it_says_on_every_object(name: str, item: str) -> None:
    script, tree = load_script(name), object_tree(item)
    hand = HandModel.default("left") if name in ("pinch", "slide") else HAND
    motion = synthesize(script, hand, tree).seen_from_object()
    time, distance, tips = look(motion, tree, hand)
    assert np.linalg.norm(np.diff(tips, axis=0), axis=2).max() / (STRIDE / script.rate) < 1.5
    assert distance[0].min() > 0.05 and distance[-1].min() > 0.05
    if not script.contact:
        assert distance.min() >= script.clearance
        return
    fingers = distance[:, :PALM_BODY].reshape(-1, 5, 3).min(axis=2)
    for f, finger in enumerate(FINGERS):
        if finger not in script.fingers:
            assert fingers[:, f].min() > script.clearance, finger
    if script.palm_depth == 0.0 and name != "slide":
        assert distance[:, PALM_BODY].min() >= script.clearance - 1e-9
    closed: tuple[str, ...] = ()
    slid = False
    for phase, played in zip(script.phases, motion.phases):
        closed = phase.fingers or closed
        slid |= phase.name == "slide"
        if phase.name == "hold":
            inside = (time >= played.start_time) & (time < played.end_time)
            assert inside.any()
            holding = {finger for f, finger in enumerate(FINGERS) if fingers[inside, f].max() < 0.0}
            free = {finger for f, finger in enumerate(FINGERS) if fingers[inside, f].min() > 0.0}
            if slid:
                # What the object offers at the end of the slide is its own affair; most fingers keep hold.
                assert len(holding) >= 4
            else:
                assert holding == set(closed)
                assert free == set(FINGERS) - set(closed)
            assert (distance[inside, PALM_BODY].max() < 0.0) == (script.palm_depth > 0.0)
