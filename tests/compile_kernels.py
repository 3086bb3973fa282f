"""Compile what most tests run, side by side in two processes: workers then load it instead of each compiling its own.

`python tests/compile_kernels.py`; what lies in the cache already is loaded, in a few seconds.
"""

import subprocess
import sys
from unittest.mock import patch

import numpy as np

from hhsim.mesh.catalogue import load_object
from hhsim.trees.builder import TreeOptions, cached_sphere_tree


def trees() -> None:
    """What builds trees, and closes fingers on them."""
    from hhsim.hand.model import HandModel
    from hhsim.scene.motion_catalogue import load_script
    from hhsim.scene.scene import make_scene

    mesh = load_object("cylinder").mesh
    make_scene(mesh, cached_sphere_tree(mesh, TreeOptions(level=2)), HandModel.default(), load_script("grasp"))


def ticks() -> None:
    """What a tick runs, by every method; its hand's palm is one sphere, so that no builder of trees is needed."""
    from hhsim.hand.model import HandModel
    from hhsim.solver.compile import warm_up
    from hhsim.solver.options import METHODS, THREADED_METHODS, SolverOptions
    from hhsim.trees.sphere_tree import SphereTree

    ball = SphereTree(np.zeros((1, 3)), np.full(1, 0.02), np.zeros(1, np.int64), np.full(1, -1))
    with patch("hhsim.hand.model.cached_sphere_tree", return_value=ball):
        hand = HandModel.default()
    for method in METHODS:
        warm_up(hand, SolverOptions(method=method, threads=2 if method in THREADED_METHODS else 1))


PARTS = {"ticks": ticks, "trees": trees}

if __name__ == "__main__":
    if len(sys.argv) > 1:
        PARTS[sys.argv[1]]()
    else:
        running = [subprocess.Popen([sys.executable, __file__, part]) for part in PARTS]
        sys.exit(max(process.wait() for process in running))
