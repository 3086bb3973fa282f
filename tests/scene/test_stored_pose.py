"""A hand's place that is kept with a script, and closing there."""

import tomllib
from dataclasses import replace

import numpy as np
import pytest

from hhsim.errors import InputError, TrajectoryError
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import quaternion_from_matrix
from hhsim.mesh.catalogue import load_object
from hhsim.scene.closure_search import plan_finger_closure
from hhsim.scene.finger_closure import close_placed, find_placement
from hhsim.scene.motion_catalogue import load_script
from hhsim.scene.script import Placement, PlacementTable, Script, parse_script
from hhsim.scene.synthesis import synthesize
from hhsim.system.settings_file import typed
from hhsim.trees.cache import cached_sphere_tree
from hhsim.trees.options import TreeOptions

HAND = HandModel.default()
BALL = cached_sphere_tree(load_object("sphere").mesh, TreeOptions(level=2))
CUP = cached_sphere_tree(load_object("cup").mesh, TreeOptions(level=3))

PLACE = {"object": "cup", "position": [0.1, 0.0, 0.05], "orientation": [1.0, 0.0, 0.0, 0.0], "back": [0.0, 0.6, 0.8]}


def test_a_table_is_read_and_written() -> None:
    table = PLACE | {"open": [0.1, 0.0, 0.2, 0.0, 0.0], "abduction": [0.0, 0.05, 0.0, 0.0, -0.1]}
    one = typed(table, PlacementTable, "x").placement()
    assert one.object_name == "cup" and np.array_equal(one.position, [0.1, 0.0, 0.05])
    assert not one.slide.any()
    (again,) = (typed(given, PlacementTable, "x").placement() for given in tomllib.loads(one.to_toml())["placement"])
    for name in ("position", "orientation", "back", "open", "abduction", "slide"):
        assert getattr(again, name) == pytest.approx(getattr(one, name), abs=1e-4)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"object": "mug"}, "unknown object 'mug'"),
        ({"position": [0.1, 0.0]}, r"position = \[0.1, 0.0\]; expected a list of 3"),
        ({"position": [0.1, 0.0, float("nan")]}, r"position\[3\] = nan; expected a number"),
        ({"position": [0.1, 0.0, True]}, r"position\[3\] = True; expected a number"),
        ({"orientation": [1.0, 1.0, 0.0, 0.0]}, "orientation has length 1.41; expected 1"),
        ({"back": [0.0, 0.0, 0.0]}, "back has length 0; expected 1"),
        ({"plase": 1}, "unknown key 'plase'"),
    ],
)
def test_what_is_no_placement_is_refused(change: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        typed(PLACE | change, PlacementTable, "x")


def test_a_place_needs_all_that_has_no_default_and_is_one_for_each_object() -> None:
    for key in ("object", "position", "orientation", "back"):
        with pytest.raises(InputError, match=f"{key} is missing"):
            typed({k: v for k, v in PLACE.items() if k != key}, PlacementTable, "x")
    place = f"[[placement]]\n{chr(10).join(f'{key} = {value!r}' for key, value in PLACE.items())}\n"
    for tables, message in (
        (place + place, "two placements on one object"),
        (f"{place}slide = [1.0, 0.0, 0.0]\n", "slide belongs to a script with a slide"),
        ("placement = 1", "expected .*placement.* tables"),
    ):
        with pytest.raises(TrajectoryError, match=message):
            script(tables)


SCRIPT = """
{head}
[[phase]]
name = "approach"
duration = 0.5
[[phase]]
name = "pinch"
duration = 0.5
[[phase]]
name = "hold"
duration = 0.5
{touch}
"""


def script(head: str = "", touch: str = "") -> Script:
    return parse_script(SCRIPT.format(head=head, touch=touch), name="mine", where="mine.toml")


@pytest.mark.parametrize(
    ("head", "touch", "message"),
    [
        ('objects = ["cup"]', "", "no placement on cup"),
        ('objects = ["mug"]', "", "unknown object 'mug'"),
        ("objects = 1", "", "expected a list"),
        ("", 'touch = { thumb = "handle" }', "handle is a part of some objects"),
    ],
)
def test_a_script_that_names_parts_or_objects_is_placed_on_them(head: str, touch: str, message: str) -> None:
    with pytest.raises(TrajectoryError, match=message):
        script(head, touch)


def test_only_a_hold_says_what_it_touches() -> None:
    text = SCRIPT.format(head="", touch="").replace('name = "pinch"', 'name = "pinch"\ntouch = { thumb = "anywhere" }')
    with pytest.raises(TrajectoryError, match=r"phase\[2\]: touch belongs to hold"):
        parse_script(text, name="mine", where="mine.toml")


def test_a_hold_demands_what_closed_and_a_hold_after_a_slide_nothing() -> None:
    touches = load_script("sequence").hold_touches
    assert [len(one) for one in touches] == [1, 2, 5, 2, 1]
    assert [touch.part for touch in touches[1]] == ["thumb", "index"]
    assert [touch.part for touch in load_script("whole-hand").hold_touches[0]][-1] == "palm"
    assert [len(one) for one in load_script("slide").hold_touches] == [5, 0]
    assert load_script("never").hold_touches == ((),)


def test_closing_where_the_search_ended_gives_the_same_hand() -> None:
    for name in ("pinch", "whole-hand"):
        motion = load_script(name)
        best = plan_finger_closure(motion, HAND, BALL)
        place = Placement("", best.position, quaternion_from_matrix(best.rotation), best.rotation[:, 2])
        closure = close_placed(motion, HAND, BALL, place)
        assert closure.position == pytest.approx(best.position, abs=1e-4)
        assert closure.rotation == pytest.approx(best.rotation, abs=1e-12)
        for key in ("contact", "command"):
            assert getattr(closure, key) == pytest.approx(getattr(best, key), abs=5e-3)
        assert closure.reached == best.reached


def test_a_placed_script_moves_with_the_object() -> None:
    motion = load_script("handle")
    angle = 0.7
    turn = np.array([[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])
    shift = np.array([0.3, -0.2, 0.1])
    here = synthesize(motion, HAND, CUP)
    there = synthesize(
        motion,
        HAND,
        CUP.transformed(turn, shift),
        object_position=shift,
        object_orientation=quaternion_from_matrix(turn),
    )
    assert there.position == pytest.approx(here.position @ turn.T + shift, abs=1e-4)
    assert there.flexion == pytest.approx(here.flexion, abs=5e-3)


def test_a_script_that_is_made_for_one_object_says_so() -> None:
    with pytest.raises(TrajectoryError, match="script handle is made for cup, not for this object"):
        synthesize(load_script("handle"), HAND, BALL)
    with pytest.raises(TrajectoryError, match="its place on the cup is a right hand's"):
        synthesize(load_script("handle"), HandModel.default("left"), CUP)


def test_a_script_for_any_object_keeps_its_search_where_it_has_no_place() -> None:
    assert find_placement(load_script("whole-hand"), HAND, BALL) is None
    assert find_placement(load_script("handle"), HAND, CUP) is not None
    shamrock = replace(CUP, mesh_sha256=load_object("shamrock").mesh.sha256)
    assert find_placement(load_script("whole-hand"), HAND, shamrock) is not None
    assert find_placement(load_script("whole-hand"), HandModel.default("left"), shamrock) is None
    with pytest.raises(TrajectoryError, match="made for cup"):
        find_placement(load_script("handle"), HAND, replace(CUP, mesh_sha256=""))


def test_a_place_out_of_reach_is_refused() -> None:
    far = Placement("", np.array([1.0, 0.0, 0.0]), np.array([1.0, 0, 0, 0]), np.array([1.0, 0.0, 0.0]))
    with pytest.raises(TrajectoryError, match="cannot reach the object from its place"):
        close_placed(load_script("pinch"), HAND, BALL, far)
    with pytest.raises(TrajectoryError, match="cannot reach the object from its place"):
        close_placed(load_script("whole-hand"), HAND, BALL, far)
