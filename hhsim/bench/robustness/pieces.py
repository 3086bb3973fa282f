"""Convex pieces of an object, leaf spheres or triangles, and those near a hand, by the search of `hhsim verify`."""

from typing import NamedTuple

import numpy as np

from hhsim.errors import InputError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.fingers import FINGERS
from hhsim.hand.model import HandModel
from hhsim.mesh.mesh import Mesh
from hhsim.trees.sphere_tree import SphereTree
from hhsim.verify import contacts
from hhsim.verify.kinematics import OwnHand, Posed, pose


class Pieces(NamedTuple):
    """Pieces of an object's surface, world; `triangles` is None for leaf spheres."""

    places: contacts.Places
    triangles: contacts.ReadyTriangles | None

    def near(self, hand: HandModel, at: HandConfiguration, limit: float) -> tuple[contacts.Pairs, Posed]:
        """Return all pairs of a body of a hand and a piece no more than `limit` [m] apart, and the posed hand."""
        palm = hand.palm_tree
        sizes = (getattr(hand, name) for name in OwnHand._fields[:7])
        own = OwnHand._make([*sizes, palm.leaf_center, palm.leaf_radius, hand.abduction_sign])
        posed, fingers = pose(own, at), np.ones(len(FINGERS), bool)
        if self.triangles is None:
            return contacts.near_pairs(own, posed, self.places, fingers, limit), posed
        return contacts.near_triangle_pairs(own, posed, self.triangles, self.places, fingers, limit), posed


def pieces_of(surface: str, mesh: Mesh | None, tree: SphereTree | None) -> Pieces:
    """Return the pieces of a surface by its name, in the frame of mesh and tree; InputError if there is no such one."""
    if surface == "spheres" and tree is not None:
        return Pieces(contacts.ball_places(np.asarray(tree.leaf_center), np.asarray(tree.leaf_radius)), None)
    if surface == "mesh" and mesh is not None:
        return Pieces(contacts.triangle_places(mesh.triangles), contacts.ready_triangles(mesh.triangles))
    raise InputError(f"this object has no {surface}")
