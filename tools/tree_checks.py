"""A second opinion on a sphere tree: gap, protrusion and enclosure of every level (`hhsim.verify.tree_checks`).

python -m tools.tree_checks bunny --size 100 --level 3
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from hhsim.errors import HhsimError
from hhsim.mesh.catalogue import load_object
from hhsim.mesh.mesh import Mesh, load_mesh
from hhsim.trees.cache import cached_sphere_tree
from hhsim.trees.file import load_tree
from hhsim.trees.options import TreeOptions
from hhsim.trees.sphere_tree import SphereTree
from hhsim.verify.tree_checks import MESH_POINTS, Verdict, referee


def moved_at_random(mesh: Mesh, seed: int) -> tuple[Mesh, float]:
    """The mesh turned anyhow, 0.1 to 10 times as large and shifted by up to about its size; and the scale."""
    from scipy.spatial.transform import Rotation

    rng = np.random.default_rng(seed)
    scale = float(10.0 ** rng.uniform(-1.0, 1.0))
    shift = scale * float(mesh.extent.max()) * rng.normal(size=3)
    return mesh.scaled(scale).transformed(Rotation.random(rng=rng).as_matrix(), shift), scale


def sticking_out(tree: SphereTree, level: int, *, leaves_only: bool = False) -> float:
    """Return the maximum by which a deeper sphere sticks out of its ancestor on a level [m]; negative for none."""
    worst = -np.inf
    nodes = np.flatnonzero(tree.level > level)
    if leaves_only:
        nodes = nodes[tree.level[nodes] == tree.depth]
    ancestor = nodes.copy()
    while (tree.level[ancestor] > level).any():
        ancestor = np.where(tree.level[ancestor] > level, tree.parent[ancestor], ancestor)
    if nodes.size:
        away = np.linalg.norm(tree.center[nodes] - tree.center[ancestor], axis=1)
        worst = float((away + tree.radius[nodes] - tree.radius[ancestor]).max())
    return worst


def table(tree: SphereTree, verdicts: Sequence[Verdict], scale: float = 1.0) -> str:
    """The verdicts on a tree as a table for people, all lengths divided by `scale`."""
    lines = ["level  spheres  protrusion max [mm]  mean [mm]  gap [nm]  deepest leaf outside an ancestor [nm]"]
    for item in verdicts:
        most, mean, gap = (x / scale for x in (item.protrusion, item.protrusion_mean, item.gap))
        leaf = sticking_out(tree, item.level, leaves_only=True)
        out = "—" if leaf == -np.inf else f"{1e9 * max(0.0, leaf) / scale:.3f}"
        lines.append(
            f"{item.level:5d}  {item.spheres:7,d}  {1e3 * most:19.4f}  {1e3 * mean:9.4f}  {1e9 * gap:8.2f}  {out:>37s}"
        )
    return "\n".join(lines)


def main(arguments: Sequence[str]) -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(prog="python -m tools.tree_checks", description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("object", metavar="OBJECT|MESH")
    parser.add_argument("--size", type=float, metavar="MM", help="scale to this longest extent first [mm]")
    parser.add_argument("--level", type=int, default=3, help="of the leaves; default: 3")
    parser.add_argument("--leaves", type=int, metavar="N", help="most leaves; default: 8 to the level")
    parser.add_argument(
        "--moved",
        type=int,
        metavar="SEED",
        help="turn, shift and scale the mesh at random first; the table then is of the original size",
    )
    parser.add_argument("--tree", type=Path, metavar="FILE.h5", help="judge this tree instead of building one")
    parser.add_argument("--points", type=int, default=MESH_POINTS, help="on the mesh, and on the spheres of a level")
    parser.add_argument("--seed", type=int, default=0, help="of the points; default: 0")
    options = parser.parse_args(arguments)
    try:
        named = load_mesh(options.object) if "." in options.object else load_object(options.object).mesh
        mesh = named if options.size is None else named.scaled(1e-3 * options.size / float(named.extent.max()))
        scale = 1.0
        if options.moved is not None:
            mesh, scale = moved_at_random(mesh, options.moved)
        if options.tree is None:
            tree = cached_sphere_tree(mesh, TreeOptions(level=options.level, leaves=options.leaves))
        else:
            tree = load_tree(options.tree)
        count = options.points
        print(table(tree, referee(mesh, tree, mesh_points=count, sphere_points=count, seed=options.seed), scale))
    except HhsimError as error:
        raise SystemExit(str(error)) from error


if __name__ == "__main__":
    main(sys.argv[1:])
