"""Motions from scripts: what one may say, those that are synthesised for an object, and every one of the catalogue."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import sampled
from joint_samples import joint_sample, openxr_csv
from msgspec import structs
from recording_samples import smooth_recording
from scipy.spatial.transform import Rotation
from sphere_scenes import ball, object_tree, record_clearance, row

from hhsim.errors import TrajectoryError, UnknownNameError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.fingers import FINGERS
from hhsim.hand.forward_kinematics import forward_kinematics
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import rotation_matrix
from hhsim.kernels.hand.kinematics import PALM_BODY
from hhsim.mesh.catalogue import object_names
from hhsim.motion.analytic_motion import still
from hhsim.motion.file import save_trajectory
from hhsim.motion.sample_flags import DAMAGED, SampleFlag
from hhsim.motion.trajectory import UNCHECKED, Trajectory
from hhsim.recordings.cleaning import clean_recording
from hhsim.scene import closure_search
from hhsim.scene.closure_search import plan_finger_closure
from hhsim.scene.motion_catalogue import (
    describe,
    import_remarks,
    is_imported,
    load_script,
    resolve_trajectory,
    script_names,
    trajectory_names,
)
from hhsim.scene.script import Placement, Script, ScriptPhase, parse_script
from hhsim.scene.synthesis import Course, planned, synthesize, to_and_fro

SMALL = """
[[phase]]
name = "approach"
duration = 0.5

[[phase]]
name = "touch"
duration = 0.25
"""


def phase(name: str, more: str = "") -> str:
    return f'\n[[phase]]\nname = "{name}"\nduration = 1\n{more}'


PLACE = """
[[placement]]
object = "cup"
position = [0.1, 0.0, 0.05]
orientation = [1.0, 0.0, 0.0, 0.0]
back = [0.0, 0.6, 0.8]
"""
HELD = SMALL + phase("hold", "touch = {}")
BAD = [
    ("", r"phase is missing; expected \[\[phase\]\] tables"),
    ("depht = 0.1\n" + SMALL, "unknown key 'depht': did you mean depth"),
    ("depth = 15\n" + SMALL, "depth = 15; expected a number from 0 to 0.1"),
    ("rate = 0\n" + SMALL, "rate = 0; expected a number from 1 to 100000"),
    ("contact = false\npalm_depth = 0.01\n" + SMALL, "palm_depth = 0.01 with contact = false"),
    (SMALL.replace("touch", "tuch"), r"phase\[2\].name: unknown name 'tuch': did you mean touch"),
    (SMALL.replace("touch", "hold"), "no phase closes a finger; expected touch, pinch, grasp, or contact = false"),
    (SMALL.replace("approach", "hold"), "the first phase is 'hold'; expected approach"),
    (SMALL + "distance = 0.1", r"phase\[2\]: distance belongs to slide, carry, lift, shake, push"),
    (SMALL.replace('"touch"', '"carry"'), r"phase\[2\]: distance is missing; a carry needs it"),
    (SMALL + phase("turn"), r"phase\[3\]: turn is missing"),
    (SMALL + phase("lift", "distance = 2"), r"phase\[3\]: distance = 2; expected a number from -1 to 1"),
    (SMALL + phase("shake", "distance = 0.1\ncycles = 0"), r"phase\[3\].cycles = 0; expected a number"),
    (SMALL + phase("carry", "distance = 1") + phase("slip"), "a carry and a slip; expected one of them in a script"),
    (SMALL + phase("slide", "distance = 0") + phase("push", "distance = 1"), "a slide and a push; expected one"),
    (SMALL.replace("0.5", "0.5\nfingers = ['index']"), r"phase\[1\]: fingers belongs to touch, pinch, grasp"),
    (SMALL + "[tremor]\nposition = 100.0", r"tremor_position = 100.0; expected a number from 0 to 0.1"),
    ("rate = 1e5\n" + SMALL.replace("0.25", "3600"), "360050000 samples; expected at most 10000000"),
    (SMALL + PLACE.replace("cup", "mug"), "unknown object 'mug'"),
    (SMALL + PLACE.replace("[1.0, 0.0, 0.0, 0.0]", "[1.0, 1.0, 0.0, 0.0]"), "orientation has length 1.41; expected 1"),
    (SMALL + PLACE.replace("[0.0, 0.6, 0.8]", "[0.0, 0.0, 0.0]"), "back has length 0; expected 1"),
    (SMALL + PLACE + PLACE, "two placements on one object"),
    (SMALL + PLACE + "hands = 'both'", "hands = 'both' and no mirror; expected one"),
    (SMALL + PLACE + "mirror = [0.0, 0.0, 2.0]", "mirror has length 2; expected 1"),
    (SMALL + PLACE + "slide = [1.0, 0.0, 0.0]", "slide belongs to a script with a slide"),
    ('objects = ["cup"]' + SMALL, "no placement on cup"),
    ('objects = ["mug"]' + SMALL, "unknown object 'mug'"),
    (HELD.format('{ thumb = "handle" }'), "handle is a part of some objects"),
    (HELD.format('"handle"'), "expected a table"),
    (HELD.format('{ pinky = "handle" }'), "unknown key 'pinky'"),
    (HELD.format('{ thumb = ["handle", ""] }'), r"thumb\[2\] = ''"),
    (SMALL + phase("hold", 'hand = "left"'), "hand belongs to approach.*; this phase is a hold"),
]


@pytest.mark.parametrize(("text", "message"), BAD, ids=[message[:40] for _, message in BAD])
def test_bad_scripts_are_refused_in_one_line(text: str, message: str) -> None:
    with pytest.raises(TrajectoryError, match=message) as caught:
        parse_script(text, name="mine", where="mine.toml")
    assert str(caught.value).startswith("mine.toml: ")
    assert "\n" not in str(caught.value)


HAND = HandModel.default()
BALL, CUP = object_tree("sphere", 2), object_tree("cup", 3)


def test_a_script_that_is_made_for_one_object_says_so() -> None:
    with pytest.raises(TrajectoryError, match="script handle is made for cup, not for this object"):
        synthesize(load_script("handle"), HAND, BALL)
    with pytest.raises(TrajectoryError, match="its place on the cup is a right hand's"):
        synthesize(load_script("handle"), HandModel.default("left"), CUP)


def test_a_place_out_of_reach_is_refused() -> None:
    far = Placement("", np.array([1.0, 0.0, 0.0]), np.array([1.0, 0, 0, 0]), np.array([1.0, 0.0, 0.0]))
    for name in ("pinch", "whole-hand"):
        with pytest.raises(TrajectoryError, match="cannot reach the object from its place"):
            planned(load_script(name), HAND, BALL, placement=far)


def test_the_other_hand_s_place_is_a_mirror_image() -> None:
    placement = load_script("lift-both").placements[0]
    other = placement.mirrored()
    np.testing.assert_allclose(other.position, placement.position * [-1.0, 1.0, 1.0])
    np.testing.assert_allclose(other.back, [-1.0, 0.0, 0.0])
    flip = np.diag([-1.0, 1.0, 1.0])
    given, found = (rotation_matrix(one.orientation) for one in (placement, other))
    np.testing.assert_allclose(found, flip @ given @ flip, atol=1e-12)
    again = other.mirrored()
    np.testing.assert_allclose(again.position, placement.position)
    np.testing.assert_allclose(rotation_matrix(again.orientation), given, atol=1e-12)


def bytes_of(motion: Trajectory) -> bytes:
    return b"".join(
        getattr(motion, key).tobytes() for key in ("time", "position", "orientation", "flexion", "abduction")
    )


@pytest.mark.parametrize("name", ["touch", "pinch", "grasp", "whole-hand", "slide"])
def test_the_motion_goes_through_what_was_planned(name: str) -> None:
    script = load_script(name)
    tree = ball(0.035)
    closure = plan_finger_closure(script, HAND, tree)
    motion = synthesize(script, HAND, tree)
    assert motion.sample_count == 3000
    np.testing.assert_array_equal(motion.time, np.arange(3000) / 1000.0)
    assert [phase.name for phase in motion.phases] == [phase.name for phase in script.phases]
    assert motion.phases[0].start_time == 0.0 and motion.phases[-1].end_time == pytest.approx(3.0)
    start = closure.position + script.start_distance * closure.rotation[:, 2]
    np.testing.assert_allclose(motion.position[0], start, atol=1e-12)
    assert (motion.flexion[0] == closure.open).all()
    hold = next(phase for phase in motion.phases if phase.name == "hold")
    inside = (motion.time >= hold.start_time) & (motion.time < hold.end_time)
    # A hold without tremor is frozen to the last bit.
    for key in ("position", "orientation", "flexion", "abduction"):
        values = getattr(motion, key)[inside]
        assert (values == values[0]).all(), key
    place = closure.position - script.palm_depth * closure.rotation[:, 2]
    np.testing.assert_allclose(motion.position[inside][0], place, atol=1e-12)
    np.testing.assert_allclose(motion.flexion[inside][0], closure.command, atol=1e-12)
    matrix = Rotation.from_quat(motion.orientation[0], scalar_first=True).as_matrix()
    np.testing.assert_allclose(matrix, closure.rotation, atol=1e-12)
    np.testing.assert_allclose(motion.flexion[-1], closure.open, atol=1e-6)


def test_a_slide_goes_the_stated_distance_along_the_palm() -> None:
    script = load_script("slide")
    motion = synthesize(script, HAND, row([0.0, 1.0, 0.0]))
    slide = next(phase for phase in motion.phases if phase.name == "slide")
    first, last = (int(np.searchsorted(motion.time, time)) for time in (slide.start_time, slide.end_time))
    moved = motion.position[last] - motion.position[first - 1]
    assert np.linalg.norm(moved) == pytest.approx(0.03, abs=1e-9)
    back = Rotation.from_quat(motion.orientation[0], scalar_first=True).as_matrix()[:, 2]
    assert abs(moved @ back) < 1e-9
    # Along a bar every other way lets go of it or digs in.
    assert abs(moved[1]) > 0.9 * np.linalg.norm(moved)


def test_the_same_arguments_give_the_same_bytes_and_the_seed_only_moves_the_noise(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    script = load_script("grasp")
    quiet = []
    for seed in (0, 5):
        # It searches twice, too.
        monkeypatch.setattr(closure_search, "_found", {})
        quiet.append(bytes_of(synthesize(script, HAND, ball(0.035), seed)))
    assert quiet[0] == quiet[1]
    tremor, sensor = {"position": 1e-4, "rotation": 0.0035}, {"counts": 4096, "noise": 0.001}
    shaken = structs.replace(script, tremor=tremor, sensor=sensor)
    noisy = [synthesize(shaken, HAND, ball(0.035), seed) for seed in (0, 5)]
    assert bytes_of(noisy[0]) != bytes_of(noisy[1])
    still = synthesize(script, HAND, ball(0.035))
    excursion = np.linalg.norm(noisy[1].position - still.position, axis=1)
    assert 0.9e-4 < excursion.max() <= 1e-4 * (1 + 1e-9)


def test_any_rate_and_any_order_of_closings() -> None:
    script = parse_script(
        """
        rate = 250
        phase = [
            { name = "approach", duration = 0.5 },
            { name = "grasp", duration = 0.25 },
            { name = "touch", duration = 0.25 },
            { name = "hold", duration = 0.1 },
        ]
        """,
        name="back to one",
        where="test",
    )
    closure = plan_finger_closure(script, HAND, ball(0.035))
    motion = synthesize(script, HAND, ball(0.035))
    assert motion.sample_count == 275
    last = motion.flexion[-1]
    np.testing.assert_allclose(last[1], closure.command[1], atol=1e-12)
    np.testing.assert_allclose(np.delete(last, 1, axis=0), np.delete(closure.open, 1, axis=0), atol=1e-12)


def test_a_carry_takes_hand_and_object_along_one_arc_and_leaves_what_is_between_them() -> None:
    script = load_script("carry")
    (carry,) = (phase for phase in script.phases if phase.name == "carry")
    assert carry.distance and carry.turn
    hold = ScriptPhase("hold", carry.duration)
    still = structs.replace(script, phases=tuple(hold if p is carry else p for p in script.phases))
    motion, held = synthesize(script, HAND, ball(0.035)), synthesize(still, HAND, ball(0.035))
    assert motion.object_motion is not None and held.object_motion is None
    way = np.linalg.norm(np.diff(motion.object_motion.position, axis=0), axis=1)
    assert way.sum() == pytest.approx(carry.distance, rel=1e-5)
    begin, end = motion.object_motion.orientation[[0, -1]]
    np.testing.assert_allclose(begin, [1.0, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(end, [np.cos(0.5 * carry.turn), 0.0, 0.0, np.sin(0.5 * carry.turn)], atol=1e-12)
    # A quarter of a circle: as far across as ahead.
    radius = carry.distance / carry.turn
    np.testing.assert_allclose(motion.object_motion.position[-1], [radius, radius, 0.0], atol=1e-5)
    seen = motion.seen_from_object()
    np.testing.assert_allclose(seen.position, held.position, atol=1e-13)
    assert motion.flexion.tobytes() == held.flexion.tobytes()


MIDDLE = np.array([0.1, -0.2, 0.3])


def test_a_shake_begins_and_ends_at_rest_and_goes_nearly_as_far_as_it_says() -> None:
    share = np.linspace(-0.1, 1.1, 100_001)
    swing = to_and_fro(share, 4.0)
    assert np.abs(swing[(share < 0.0) | (share > 1.0)]).max() < 1e-30
    assert 0.95 < np.abs(swing).max() <= 1.0
    assert np.count_nonzero(np.diff(np.sign(swing[(share > 0.01) & (share < 0.99)]))) == 7
    acceleration = np.diff(swing, n=2) / np.diff(share)[0] ** 2
    assert np.abs(np.diff(acceleration)).max() < 0.005 * np.abs(acceleration).max()


def test_lifts_go_up_shakes_across_and_turns_about_the_fingers_through_the_middle() -> None:
    script = load_script("pinch")
    phases = (ScriptPhase("lift", 0.5, distance=0.1), ScriptPhase("turn", 0.5, turn=0.8))
    script = structs.replace(script, phases=(*phases, ScriptPhase("shake", 1.0, distance=0.02, cycles=2.0)))
    time = np.arange(2001) / 1000.0
    # The palm looks down, its fingers along y and a little up.
    tilt = np.array([[1.0, 0.0, 0.0], [0.0, np.cos(0.3), -np.sin(0.3)], [0.0, np.sin(0.3), np.cos(0.3)]])
    moved = Course(script, time, "right", tilt, MIDDLE).taken
    middle = moved.points(np.tile(MIDDLE, (len(time), 1))) - MIDDLE
    np.testing.assert_allclose(middle[500], [0.0, 0.0, 0.1], atol=1e-12)
    np.testing.assert_allclose(middle[500:1001], np.tile(middle[500], (501, 1)), atol=1e-12)
    assert np.abs(middle[1000:, 0]).max() > 0.017 and np.abs(middle[:, 1]).max() == 0.0
    np.testing.assert_allclose(middle[-1], [0.0, 0.0, 0.1], atol=1e-12)
    turn = rotation_matrix(moved.turn[-1])
    np.testing.assert_allclose(turn @ [0.0, 1.0, 0.0], [0.0, 1.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(turn[0, 0], np.cos(0.8), atol=1e-12)
    assert Course(load_script("grasp"), time, "right", tilt, MIDDLE).taken is None


def test_a_phase_of_one_hand_leaves_the_other_where_it_is() -> None:
    script, tree = load_script("hand-over"), ball(0.035)
    motions = [synthesize(script, HandModel.default(side), tree) for side in ("right", "left")]
    right, left = motions
    names = [phase.name for phase in script.phases]
    assert [phase.name for phase in right.phases] == [phase.name for phase in left.phases] == names
    for phase, given in zip(right.phases, script.phases, strict=True):
        inside = (right.time > phase.start_time + 1e-6) & (right.time < phase.end_time - 1e-6)
        for side, motion in zip(("right", "left"), motions):
            stands = all((values[inside] == values[inside][0]).all() for values in (motion.position, motion.flexion))
            assert stands == (phase.name == "hold" or given.hand not in (None, side)), (phase, side)


NAMES = ["touch", "pinch", "grasp", "whole-hand", "slide", "carry", "sequence", "never"]
MOVING = ["lift", "shake", "turn", "push", "slip"]
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
    motion = Trajectory(np.arange(3.0), *still(np.zeros(3), ticks=3))
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
    (tmp_path / "glove.mat").touch()
    for given, error, said in (
        ("grsp", UnknownNameError, "unknown trajectory 'grsp': did you mean grasp"),
        ("none.toml", TrajectoryError, "none.toml: no such file"),
        (tmp_path / "glove.mat", TrajectoryError, "not a trajectory by its suffix; expected .toml, .h5"),
    ):
        with pytest.raises(error, match=said):
            resolve_trajectory(given)


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


@pytest.mark.parametrize(
    ("name", "item"),
    sampled([(name, item) for name in NAMES for item in object_names()], lambda place, case: place % 22 == 0),
)
def test_every_script_does_what_it_says_on_every_object(name: str, item: str) -> None:
    script, tree = load_script(name), object_tree(item)
    hand = HandModel.default("left") if name in ("pinch", "slide") else HAND
    motion = synthesize(script, hand, tree).seen_from_object()
    placed = forward_kinematics(hand, *HandConfiguration.of(motion).at(slice(None, None, STRIDE)))
    time, distance, tips = motion.time[::STRIDE], record_clearance(hand, tree, placed), placed.joints[:, :, 3]
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
