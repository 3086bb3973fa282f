"""Hand stored in a result file."""

from collections.abc import Mapping

import numpy as np

from hhsim.arrays import AnyArray
from hhsim.hand.model import HandModel
from hhsim.mesh.mesh import Mesh
from hhsim.result.reader import Result
from hhsim.result.schema import TREE_ARRAYS
from hhsim.trees.sphere_tree import SphereTree

HAND_ARRAYS = {
    **{name: name for name in ("base", "distal", "dorsal")},
    **{name: f"phalanx_{name}" for name in ("length", "radius")},
    **{name: name for name in ("flexion_min", "flexion_max", "abduction_min", "abduction_max")},
}
"""Fields of `HandModel`, and their datasets under `hands/NAME`."""


def sphere_tree_of(arrays: Mapping[str, AnyArray], group: str) -> SphereTree:
    """Return the sphere tree in the datasets of a group; InputError if they are no tree."""
    center, radius, level, parent = (arrays[f"{group}/{name}"] for name in TREE_ARRAYS)
    return SphereTree(center, radius, level, parent)


def result_hand(result: Result) -> HandModel:
    """Build the stored hand, unchecked (`hhsim.replay.stored_scene.stored_hand` checks it); InputError for no hand."""
    arrays = {name.removeprefix("hand/"): array for name, array in result.static.items()}
    sizes, surface = result.scene["hand"], (arrays["palm_mesh/vertices"], arrays["palm_mesh/faces"])
    return HandModel(
        side=sizes["side"],
        hand_length=sizes["length"],
        hand_breadth=sizes["breadth"],
        palm_mesh=Mesh(*surface, name="palm", source=str(result.path)),
        palm_tree=sphere_tree_of(arrays, "palm_tree"),
        **{name: np.array(arrays[stored]) for name, stored in HAND_ARRAYS.items()},
    )
