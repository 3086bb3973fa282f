"""What ships so that a first run needs no builder: the trees of the catalogue, of bodies and of the default palms.

    python -m tools.build_trees

builds them anew and writes them to objects/. It is due when a mesh of the catalogue, the default hand or the builder
changed (`hhsim.trees.options.BUILDER_VERSION` is then to be raised too); tests say so.
"""

from collections.abc import Iterator

import numpy as np

from hhsim.hand.model import MIRROR, HandModel
from hhsim.linkage.file import solid_for
from hhsim.mesh.catalogue import BODIES, MESH_LEVEL, load_object, object_names
from hhsim.mesh.mesh import Mesh
from hhsim.scene.declared_bodies import load_object as load_bodies
from hhsim.trees.builder import build_sphere_tree, proved_anew
from hhsim.trees.cache import SHIPPED_SUFFIX, shipped_name
from hhsim.trees.file import save_tree
from hhsim.trees.options import TreeOptions
from hhsim.trees.sphere_tree import SphereTree
from tools.import_graph import REPOSITORY

PALM_LEVEL = 2
"""Of the default hand."""
BODIES_WITH_TREES = {"laptop": "spheres", "peg": "mesh"}
"""Files of bodies whose trees ship, which take longest, and the surface that their meshes are loaded for: free bodies
are made solids for spheres alone. With all of 0.7 MB each the wheel would be over 15 MB."""


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


def body_meshes() -> dict[str, Mesh]:
    """Return the meshes of bodies whose trees ship, by the names of the files."""
    loaded = [load_bodies(name, solid=solid_for(surface)) for name, surface in BODIES_WITH_TREES.items()]
    meshes = [mesh for bodies in loaded for mesh in bodies.meshes.values()]
    return {shipped_name(mesh): mesh for mesh in meshes}


def body_tree(mesh: Mesh) -> SphereTree:
    """Build a body's tree, at the finest level that a scene has it at."""
    return build_sphere_tree(mesh, TreeOptions(level=MESH_LEVEL))


def main() -> None:
    """Write all trees."""
    folder = REPOSITORY / "objects"
    trees = {f"{name}{SHIPPED_SUFFIX}": object_tree(name) for name in object_names()}
    trees |= {f"{mesh.name}{SHIPPED_SUFFIX}": tree for mesh, tree in palm_trees()}
    trees |= {f"{BODIES}/{name}": body_tree(mesh) for name, mesh in body_meshes().items()}
    for old in folder.rglob(f"*{SHIPPED_SUFFIX}"):
        old.unlink()
    for name, tree in trees.items():
        path = folder / name
        save_tree(tree, path)
        print(f"{path.relative_to(REPOSITORY)} {tree.leaf_count:,} leaves, {path.stat().st_size:,} bytes")


if __name__ == "__main__":
    main()
