"""What ships so that a first run needs no builder: the trees of the catalogue and of the default palms.

    python -m tools.build_trees

builds them anew and writes them to objects/. It is due when a mesh of the catalogue, the default hand or the builder
changed (`hhsim.trees.options.BUILDER_VERSION` is then to be raised too); tests say so.
"""

from collections.abc import Iterator

import numpy as np

from hhsim.hand.model import MIRROR, HandModel
from hhsim.mesh.catalogue import load_object, object_names
from hhsim.mesh.mesh import Mesh
from hhsim.trees.builder import build_sphere_tree, proved_anew
from hhsim.trees.cache import SHIPPED_SUFFIX
from hhsim.trees.file import save_tree
from hhsim.trees.options import TreeOptions
from hhsim.trees.sphere_tree import SphereTree
from tools.import_graph import REPOSITORY

PALM_LEVEL = 2
"""Of the default hand."""


def object_tree(name: str) -> SphereTree:
    """Build the tree of an object of the catalogue, at the level that it is used at."""
    item = load_object(name)
    return build_sphere_tree(item.mesh, TreeOptions(level=item.level))


def palm_trees() -> Iterator[tuple[Mesh, SphereTree]]:
    """Build the trees of the default palms, right and left."""
    right, left = (HandModel.default(side).palm_mesh for side in ("right", "left"))
    tree = build_sphere_tree(right, TreeOptions(level=PALM_LEVEL))
    yield right, tree
    yield left, proved_anew(tree.transformed(np.diag(MIRROR), np.zeros(3)), left)


def main() -> None:
    """Write all trees."""
    folder = REPOSITORY / "objects"
    trees = {name: object_tree(name) for name in object_names()} | {mesh.name: tree for mesh, tree in palm_trees()}
    for old in folder.glob(f"*{SHIPPED_SUFFIX}"):
        old.unlink()
    for name, tree in trees.items():
        path = folder / f"{name}{SHIPPED_SUFFIX}"
        save_tree(tree, path)
        print(f"{path.relative_to(REPOSITORY)} {tree.leaf_count:,} leaves, {path.stat().st_size:,} bytes")


if __name__ == "__main__":
    main()
