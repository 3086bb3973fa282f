"""What people call the object and the motion of a result."""

from types import SimpleNamespace
from typing import Any

import pytest

from hhsim.result.wording import motion_name, object_name


@pytest.mark.parametrize(
    ("scene", "names"),
    [
        ({"object": "meshes/mug.stl", "trajectory": "own/grasp.toml"}, ("mug.stl", "grasp.toml")),
        ({"object_name": "mug", "object": "mug.stl", "motion": "grasp", "trajectory": "x"}, ("mug", "grasp")),
        ({}, ("object", "motion")),
    ],
)
def test_a_file_is_called_by_its_name_without_its_folder(scene: dict[str, Any], names: tuple[str, str]) -> None:
    result: Any = SimpleNamespace(scene=scene | {"hand": {"side": "left"}}, other=None)
    assert (object_name(result), motion_name(result)) == names
    result.other = result
    assert motion_name(result) == f"{names[1]} (left of two hands)"
