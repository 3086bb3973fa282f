"""Scenes of several things: what their files may say, and where the things are."""

from pathlib import Path

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


@pytest.mark.parametrize("name", ["blocks", "peg", "pot", "door", "drawer"])
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
        ("fixed = true", "fixed = true\nhinge.axis = [0.0, 0.0, 1.0]", "'wall' is fixed and has a hinge"),
        ("mass = 0.05", "slider.axis = [0.0, 0.0, 0.0]", "the axis of the slider has no direction"),
        ("mass = 0.05", "slider.axis = [0.0, 0.0, 1.0]\nslider.limits = [0.1, 1.0]", "slider limits 0.1 to 1 m"),
        ("mass = 0.05", 'slider.axis = [0.0, 0.0, 1.0]\nslider.on = "post"', "unknown thing 'post'"),
        ("fixed = true", "fixed = true\nslider.axis = [0.0, 0.0, 1.0]", "'wall' is fixed and has a slider"),
        (
            "mass = 0.05",
            "hinge.axis = [0.0, 0.0, 1.0]\nslider.axis = [0.0, 0.0, 1.0]",
            "'peg' has both a hinge and a slider",
        ),
        ("box = [0.1, 0.1, 0.1]", "box = [0.1, 0.1, 0.0]", "box"),
    ],
)
def test_bad_files_of_things_are_refused_in_one_line(tmp_path: Path, before: str, after: str, message: str) -> None:
    assert before in TWO
    with pytest.raises(InputError, match=message) as refused:
        load_things(written(tmp_path, TWO.replace(before, after)))
    assert "\n" not in str(refused.value)
