"""Sphere tree of a file for a replay, which takes it for one mesh alone."""

from pathlib import Path

from hhsim.errors import InputError
from hhsim.mesh.mesh import Mesh
from hhsim.trees.file import load_tree
from hhsim.trees.foreign_tree import ImportedTree, import_tree


def load_tree_for(path: str | Path, mesh: Mesh, unit_length: float = 1.0) -> ImportedTree:
    """Read the tree of a mesh for a replay, as `import_tree`; a `.h5` file of another mesh is an InputError."""
    source = Path(path)
    if source.suffix == ".h5":
        sha256 = load_tree(source).mesh_sha256
        if sha256 not in ("", mesh.sha256):
            other = f"built for the mesh {sha256[:12]}…, but {mesh.name} is {mesh.sha256[:12]}…"
            raise InputError(
                f"{source}: {other}; name the object, unit and size of the tree, or build it again, with --solid"
            )
    return import_tree(source, mesh, unit_length)
