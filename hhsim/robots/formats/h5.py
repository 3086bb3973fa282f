"""HDF5 of hhsim: the sphere tree of each link, with its proof, in a group of the link's name."""

from pathlib import Path

import numpy as np

from hhsim.errors import InputError
from hhsim.robots.formats.registry import RobotFormat, Spheres
from hhsim.robots.robot_spheres import RobotSpheres
from hhsim.trees.file import load_trees, trees_file


def write_h5(found: RobotSpheres) -> bytes:
    """Return the file; InputError for a link whose name no group can have."""
    for link in found.links:
        if "/" in link.name or link.name == ".":
            raise InputError(f"link '{link.name}': no name for a group of an HDF5 file; expected another format (--as)")
    return trees_file({link.name: link.tree for link in found.links})


def read_h5(path: Path) -> Spheres:
    """Read the leaves of each link's tree; those of a file of one tree are of no name."""
    return {name: np.column_stack([tree.leaf_center, tree.leaf_radius]) for name, tree in load_trees(path).items()}


FORMAT = RobotFormat((".h5",), b"hhsim-robot-trees", write_h5, read_h5)
