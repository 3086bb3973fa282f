import numpy as np
import pytest
from sphere_scenes import object_tree

from hhsim.errors import TrajectoryError
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import rotation_matrix
from hhsim.motion.tremor import Disturbance
from hhsim.scene.motion_catalogue import load_script
from hhsim.scene.script import Placement, Script, ScriptPhase, parse_script
from hhsim.scene.synthesis import planned, synthesize

SMALL = """
[[phase]]
name = "approach"
duration = 0.5

[[phase]]
name = "touch"
duration = 0.25
"""


def parse(text: str) -> Script:
    return parse_script(text, name="mine", where="mine.toml")


def test_a_short_script_takes_the_documented_defaults() -> None:
    script = parse(SMALL)
    assert script.name == "mine"
    assert script.phases == (ScriptPhase("approach", 0.5), ScriptPhase("touch", 0.25, ("index",)))
    assert (script.rate, script.contact, script.depth, script.clearance) == (1000.0, True, 0.015, 0.005)
    assert (script.palm_gap, script.palm_depth, script.start_distance, script.curl) == (0.005, 0.0, 0.12, 1.0)
    assert script.disturbance == Disturbance()
    assert (script.duration, script.sample_count, script.fingers) == (0.75, 750, ("index",))


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
        parse(text)
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
