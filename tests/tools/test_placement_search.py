"""The search for a hand's place: on a case that is quick, it finds one where the touch happens, the same each time."""

import numpy as np
import pytest

from hhsim.hand.model import HandModel
from hhsim.mesh.catalogue import load_object
from hhsim.scene.contact_goals import TOUCHING
from hhsim.scene.script import parse_script
from hhsim.trees.cache import cached_sphere_tree
from hhsim.trees.options import TreeOptions
from tools import placement_search
from tools.placement_search import PlacementSearch

SCRIPT = """
objects = ["shamrock"]
[[phase]]
name = "approach"
duration = 0.2
[[phase]]
name = "touch"
duration = 0.2
[[phase]]
name = "hold"
duration = 0.1
touch = { index = "stem" }
"""


@pytest.mark.soak
def test_a_place_is_found_where_the_finger_touches_the_part_and_again(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in (("DRAWS", 300), ("LEADERS", 6), ("STEPS", 40), ("PLAYED", 6), ("PLAYED_STEPS", 4)):
        monkeypatch.setattr(placement_search, name, value)
    script = parse_script(SCRIPT, name="stem", where="stem.toml", unplaced=True)
    tree = cached_sphere_tree(load_object("shamrock").mesh, TreeOptions(level=3))
    towards = np.array([0.0, -1.0, 0.0])
    found = [PlacementSearch(script, "shamrock", HandModel.default(), tree, towards, seed=1).run() for _ in range(2)]
    (place, distance), (again, _) = found
    assert distance <= TOUCHING
    assert place.to_toml() == again.to_toml()
    assert place.back @ towards >= np.cos(np.radians(35.1))
