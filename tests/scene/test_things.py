"""Scenes of several things: what their files may say, and where the things are."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from hhsim.errors import InputError
from hhsim.scene.scene import open_scene
from hhsim.scene.things import load_things, names_things

TWO = """
[[thing]]
name = "peg"
box = [0.02, 0.02, 0.06]
position = [0.0, 0.0, 0.03]
mass = 0.05

[[thing]]
name = "wall"
box = [0.1, 0.1, 0.1]
position = [0.2, 0.0, 0.05]
fixed = true
"""
DRIVEN = """driven.type = "slider"
driven.axis = [0.0, 2.0, 0.0]
driven.limits = [0.0, 0.2]
driven.motion = [[0.0, 0.02], [1.0, 0.1]]"""


def written(folder: Path, text: str) -> str:
    path = folder / "two.toml"
    path.write_text(text)
    return str(path)


def test_a_file_of_things_makes_a_scene_of_all_of_them(tmp_path: Path) -> None:
    word = written(tmp_path, TWO)
    assert names_things(word) and not names_things("laptop") and names_things("blocks")
    scene = open_scene(word, "never", solid=False, level=2)
    assert scene.free is not None and scene.free.mass == 0.05
    (wall,) = scene.others
    assert wall.fixed and wall.name == "wall" and wall.free.mass == pytest.approx(1.0)
    assert scene.free.table == wall.free.table == pytest.approx(0.0, abs=1e-6)
    np.testing.assert_allclose(wall.mesh.bounds, [[0.15, -0.05, 0.0], [0.25, 0.05, 0.1]], atol=1e-12)
    assert scene.parts is not None and scene.parts.names == ("peg", "wall") and scene.parts.free


@pytest.mark.parametrize("name", ["blocks", "peg", "pot", "door", "drawer", "chest"])
def test_the_shipped_things_begin_apart(name: str) -> None:
    things = load_things(name)
    assert len(things.meshes) == len(things.settings.thing) > 1


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        ('name = "wall"', 'name = "peg"', "two things have the name 'peg'"),
        ("mass = 0.05", "mass = 0.05\ndensity = 900.0", "both a mass and a density"),
        ("mass = 0.05", "fixed = true", "the first thing, 'peg', is fixed"),
        ("[0.2, 0.0, 0.05]", "[0.05, 0.0, 0.05]", r"begins .* mm inside"),
        ("mass = 0.05", "mass = -1.0", "mass"),
        ("fixed = true", "glued = true", "glued"),
        ("mass = 0.05", "hinge.axis = [0.0, 0.0, 0.0]", "the axis of the hinge has no direction"),
        ("mass = 0.05", "hinge.axis = [0.0, 0.0, 1.0]\nhinge.limits = [0.1, 1.0]", "hinge limits 0.1 to 1 rad"),
        ("mass = 0.05", 'hinge.axis = [0.0, 0.0, 1.0]\nhinge.on = "post"', "unknown thing 'post'"),
        ("mass = 0.05", 'hinge.axis = [0.0, 0.0, 1.0]\nhinge.on = "peg"', "joints in a circle: peg on peg"),
        ("fixed = true", "fixed = true\nhinge.axis = [0.0, 0.0, 1.0]", "'wall' has both fixed and hinge"),
        ("mass = 0.05", "slider.axis = [0.0, 0.0, 0.0]", "the axis of the slider has no direction"),
        ("mass = 0.05", "slider.axis = [0.0, 0.0, 1.0]\nslider.limits = [0.1, 1.0]", "slider limits 0.1 to 1 m"),
        ("mass = 0.05", 'slider.axis = [0.0, 0.0, 1.0]\nslider.on = "post"', "unknown thing 'post'"),
        ("fixed = true", "fixed = true\nslider.axis = [0.0, 0.0, 1.0]", "'wall' has both fixed and slider"),
        (
            "mass = 0.05",
            "hinge.axis = [0.0, 0.0, 1.0]\nslider.axis = [0.0, 0.0, 1.0]",
            "'peg' has both hinge and slider",
        ),
        ("mass = 0.05", DRIVEN, "the first thing, 'peg', is driven"),
        ("fixed = true", f"fixed = true\n{DRIVEN}", "'wall' has both fixed and driven"),
        ("fixed = true", DRIVEN.replace("0.1]]", "0.3]]"), r"motion\[2\] has the value 0.3, beyond the limits"),
        ("fixed = true", 'poses = { file = "gone.npy", rate = 30.0 }', "gone.npy: no such file"),
        ("box = [0.1, 0.1, 0.1]", "box = [0.1, 0.1, 0.0]", "box"),
    ],
)
def test_bad_files_of_things_are_refused_in_one_line(tmp_path: Path, before: str, after: str, message: str) -> None:
    assert before in TWO
    with pytest.raises(InputError, match=message) as refused:
        load_things(written(tmp_path, TWO.replace(before, after)))
    assert "\n" not in str(refused.value)


def test_a_driven_thing_begins_where_its_joint_has_it_and_goes_on_from_there(tmp_path: Path) -> None:
    word = written(tmp_path, TWO.replace("fixed = true", DRIVEN))
    scene = open_scene(word, "never", solid=False, level=2)
    (wall,) = scene.others
    assert not wall.fixed
    np.testing.assert_allclose(wall.mesh.bounds, [[0.15, -0.03, 0.0], [0.25, 0.07, 0.1]], atol=1e-12)
    assert scene.parts is not None
    motion = scene.parts.driven["wall"]
    wanted = np.interp(scene.ticks.time, [0.0, 1.0], [0.0, 0.08])
    np.testing.assert_allclose(motion.shift, wanted[:, None] * [0.0, 1.0, 0.0], atol=1e-12)
    assert (motion.turn == [1.0, 0.0, 0.0, 0.0]).all()
    moved = load_things(word, SimpleNamespace(name="", joints=(("wall", ((0.0, 0.0), (1.0, 0.2))),)), solid=False)
    (drive,) = filter(None, moved.drives)
    np.testing.assert_allclose(drive(np.array([0.5])).position, [[0.2, 0.1, 0.05]])
    with pytest.raises(InputError, match="unknown joint 'lid'"):
        load_things(word, SimpleNamespace(name="", joints=(("lid", ((0.0, 0.0),)),)), solid=False)


def test_a_thing_is_driven_by_poses_of_a_file_and_stands_before_and_after(tmp_path: Path) -> None:
    angle, rows = np.linspace(0.0, 1.0, 31), np.tile(np.eye(4), (31, 1, 1))
    rows[:, 0, 0] = rows[:, 1, 1] = np.cos(angle)
    rows[:, 1, 0], rows[:, 0, 1] = np.sin(angle), -np.sin(angle)
    rows[:, 0, 3] = 0.2 + 0.1 * angle
    np.save(tmp_path / "wall.npy", rows)
    given = TWO.replace("fixed = true", 'poses = { file = "wall.npy", rate = 30.0, unit = "m" }')
    word = written(tmp_path, given.replace("[0.2, 0.0, 0.05]", "[0.0, 0.0, 0.05]"))
    (drive,) = filter(None, load_things(word, solid=False).drives)
    found = drive(np.array([-1.0, 0.0, 0.5, 1.0, 9.0]))
    np.testing.assert_allclose(found.position, [[x, 0.0, 0.05] for x in (0.2, 0.2, 0.25, 0.3, 0.3)], atol=1e-9)
    turned = 2.0 * np.arctan2(found.orientation[:, 3], found.orientation[:, 0])
    np.testing.assert_allclose(turned, [0.0, 0.0, 0.5, 1.0, 1.0], atol=1e-9)
    rows[7] = np.nan
    np.save(tmp_path / "wall.npy", rows)
    with pytest.raises(InputError, match="lacks the pose of row 7"):
        load_things(word, solid=False)
    with pytest.raises(InputError, match=r"has no stamps; expected rate = 30\.0"):
        load_things(written(tmp_path, given.replace(", rate = 30.0", "")), solid=False)
