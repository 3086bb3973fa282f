"""Hand stored in a result file."""

from collections.abc import Mapping

import numpy as np

from hhsim.arrays import AnyArray
from hhsim.hand.model import HandModel
from hhsim.mesh.mesh import Mesh
from hhsim.result.reader import Result
from hhsim.trees.sphere_tree import SphereTree

TREE_ARRAYS = ("center", "radius", "level", "parent")
HAND_ARRAYS = {
    **{name: name for name in ("base", "distal", "dorsal")},
    **{name: f"phalanx_{name}" for name in ("length", "radius")},
    **{name: name for name in ("flexion_min", "flexion_max", "abduction_min", "abduction_max")},
}
"""Fields of `HandModel`, and their datasets under /hand."""


def sphere_tree_of(arrays: Mapping[str, AnyArray] | Result, group: str) -> SphereTree:
    """Return the sphere tree in the datasets of a group; InputError if they are no tree."""
    center, radius, level, parent = (arrays[f"{group}/{name}"] for name in TREE_ARRAYS)
    return SphereTree(center, radius, level, parent)


def result_hand(result: Result) -> HandModel:
    """Build the stored hand, unchecked (`hhsim.replay.stored_scene.stored_hand` checks it); InputError for no hand."""
    sizes, static = result.scene["hand"], result.static
    return HandModel(
        side=sizes["side"],
        hand_length=sizes["length"],
        hand_breadth=sizes["breadth"],
        palm_mesh=Mesh(
            static["hand/palm_mesh/vertices"], static["hand/palm_mesh/faces"], name="palm", source=str(result.path)
        ),
        palm_tree=sphere_tree_of(static, "hand/palm_tree"),
        **{name: np.array(static[f"hand/{stored}"]) for name, stored in HAND_ARRAYS.items()},
    )
