"""Check of a sphere tree's claims on a mesh: its covers, their proofs, and their bounds.

It shares nothing with the builder: the proofs are followed by code of their own, the depths are measured again.
"""

from typing import TYPE_CHECKING

import numpy as np

from hhsim.kernels.cover import check_certificate
from hhsim.kernels.mesh.bvh import mesh_signed_distance
from hhsim.mesh.mesh import Mesh, most_protrusion
from hhsim.mesh.signed_bvh import signed_bvh

if TYPE_CHECKING:
    from hhsim.trees.sphere_tree import LevelCover

_ROUNDING = 1e-14
_DEPTH_ROUNDING = 1e-9

_WRONG = {
    check_certificate.NO_SUCH_SPHERE: "names a sphere that does not exist",
    check_certificate.CORNER_OUTSIDE: "puts a corner into a sphere that does not contain it",
    check_certificate.NO_SUCH_CODE: "has a code without a meaning",
    check_certificate.TOO_SHORT: "ends too early",
    check_certificate.TOO_LONG: "goes on after the last face",
    check_certificate.TOO_DEEP: "halves a face too often",
}


def faults(mesh: Mesh, covers: "tuple[LevelCover, ...]") -> tuple[str, ...]:
    """Return the faults of the covers of levels 0 and on for a mesh, a plain sentence each; empty if there are none."""
    if not any(cover.proved for cover in covers):
        return ("the tree holds no proof that it covers the mesh",)
    corner = mesh.triangles.reshape(-1, 9)
    bvh = signed_bvh(mesh)
    found = []
    for level, cover in enumerate(covers):
        size = max(float(np.abs(corner).max()), float(np.abs(cover.center).max()))
        grown = cover.radius + cover.gap
        if not cover.proved:
            found.append(f"level {level}: no proof that it covers the mesh")
        else:
            what, face, code = check_certificate.check_proof(corner, cover.center, grown, _ROUNDING * size, cover.proof)
            if what != check_certificate.HOLDS:
                found.append(f"level {level}: the proof {_WRONG[what]}, face {face}, code {code}")
        height = mesh_signed_distance(bvh, cover.center)
        out = float((cover.radius + height).max())
        if out > most_protrusion(mesh):
            found.append(
                f"level {level}: a sphere may stick {out:.3g} m out of a mesh {most_protrusion(mesh):.3g} m across"
            )
        short = cover.depth + height
        if not short.max() <= _DEPTH_ROUNDING * size:
            sphere = int(np.argmax(short))
            found.append(f"level {level}: the centre of sphere {sphere} is {short[sphere]:.3g} m less deep than stated")
    return tuple(found)
