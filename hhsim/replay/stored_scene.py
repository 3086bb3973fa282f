"""Object, tree, hand and options to and from a result file, bit for bit."""

import hashlib
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import AnyArray
from hhsim.errors import InputError
from hhsim.hand.model import HandModel
from hhsim.kernels.hand.kinematics import PALM_BODY
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.moving_parts import MovingParts
from hhsim.result.reader import Result
from hhsim.result.schema import (
    DRIVEN_COLUMNS,
    JOINT_COLUMN,
    OWN_COLUMNS,
    PART_COLUMNS,
    PART_STATIC_COLUMNS,
    THINGS,
    Column,
)
from hhsim.result.stored_hand import HAND_ARRAYS, TREE_ARRAYS, result_hand, sphere_tree_of
from hhsim.scene.free_object import LAW, FreeObject
from hhsim.scene.scene import all_pairs
from hhsim.solver.free_engine import Thing
from hhsim.solver.options import SolverOptions
from hhsim.trees.contact_surface import ContactSurface, contact_surface
from hhsim.trees.sphere_tree import SphereTree

PARTS = {
    "object": "the object's mesh",
    "tree": "the object's sphere tree",
    "hand": "the hand",
    THINGS: "a part of the thing",
}
"""Groups of datasets with a checksum, and their names in messages; the last are of a thing of several parts."""


def static_arrays(
    mesh: Mesh,
    tree: SphereTree,
    hand: HandModel,
    object_position: ArrayLike = (0.0, 0.0, 0.0),
    object_orientation: ArrayLike = (1.0, 0.0, 0.0, 0.0),
) -> dict[str, AnyArray]:
    """Return the arrays of `hhsim.result.schema.STATIC_COLUMNS`: mesh and tree in the world [m].

    The origin of the object's own frame [m], (3,), and its orientation (w, x, y, z), (4,), are in the world.
    """
    return {
        "object/vertices": mesh.vertices,
        "object/faces": mesh.faces,
        "object/position": np.array(object_position, dtype=np.float64),
        "object/orientation": np.array(object_orientation, dtype=np.float64),
        **{f"object/tree/{name}": getattr(tree, name) for name in TREE_ARRAYS},
        **{f"hand/{stored}": getattr(hand, name) for name, stored in HAND_ARRAYS.items()},
        "hand/palm_center": hand.palm_tree.leaf_center,
        "hand/palm_radius": hand.palm_tree.leaf_radius,
        **{f"hand/palm_tree/{name}": getattr(hand.palm_tree, name) for name in TREE_ARRAYS},
        "hand/palm_mesh/vertices": hand.palm_mesh.vertices,
        "hand/palm_mesh/faces": hand.palm_mesh.faces,
    }


def part_tables(parts: MovingParts) -> dict[str, tuple[Column, ...]]:
    """Return the columns of each part's table in a result, by its group."""
    return {
        f"{THINGS}/{parts.name}/{name}": (
            *PART_COLUMNS,
            *((JOINT_COLUMN,) if name in parts.values else ()),
            *(OWN_COLUMNS if parts.free else ()),
            *(DRIVEN_COLUMNS if name in parts.driven else ()),
        )
        for name in parts.names
    }


def part_arrays(parts: MovingParts | None) -> dict[str, dict[str, AnyArray]]:
    """Return the arrays of `PART_STATIC_COLUMNS` of each part, by its group; none for one object."""
    if parts is None:
        return {}
    bodies = zip(part_tables(parts), parts.meshes, parts.trees)
    return {
        group: {
            "vertices": mesh.vertices,
            "faces": mesh.faces,
            **{f"tree/{name}": getattr(tree, name) for name in TREE_ARRAYS},
        }
        for group, mesh, tree in bodies
    }


def describe_scene(
    mesh: Mesh,
    tree: SphereTree,
    hand: HandModel,
    options: SolverOptions,
    static: Mapping[str, AnyArray],
    free: FreeObject | None = None,
) -> dict[str, Any]:
    """Return the description of a scene for the result's file as plain values; `static` is of `static_arrays`."""
    return {
        **({} if free is None else {"free": free.to_json(), "friction_law": LAW}),
        "solver": options.to_json(),
        "hand": {
            "side": hand.side,
            "length": hand.hand_length,
            "breadth": hand.hand_breadth,
            "palm_spheres": hand.palm_tree.leaf_count,
        },
        "object_name": mesh.name,
        "object_spheres": tree.leaf_count,
        "modelled": {
            "fingers": list(options.fingers),
            "phalanges": int(options.modelled()[:PALM_BODY].sum()),
            "palm_spheres": hand.palm_tree.leaf_count,
            "object_spheres": tree.leaf_count,
            "all_pairs": all_pairs(hand, tree),
            "not_modelled": [
                *([] if free else ["friction", "dynamics"]),
                "deformation",
                *([] if options.self_contact else ["finger-to-finger contact"]),
            ],
        },
        "checksums": checksums(static),
    }


def checksums(static: Mapping[str, AnyArray]) -> dict[str, str]:
    """Return the SHA-256 of each of `PARTS` that there is: of its datasets' little-endian bytes, by name."""
    digests: dict[str, Any] = {}
    for name in sorted(static):
        part = "tree" if name.startswith("object/tree/") else name.split("/")[0]
        array = np.ascontiguousarray(static[name])
        digests.setdefault(part, hashlib.sha256())
        digests[part].update(f"{name} {array.shape} ".encode())
        digests[part].update(array.astype(array.dtype.newbyteorder("<"), copy=False).tobytes())
    return {part: digest.hexdigest() for part, digest in digests.items()}


def require_whole(result: Result) -> None:
    """Raise InputError if the object, the tree or the hand of a result is not the one of its run."""
    found = checksums(stored_arrays(result))
    stated = result.scene.get("checksums", {})
    for part, digest in found.items():
        if digest != stated.get(part):
            raise InputError(f"{result.path} cannot be run again: {PARTS[part]} in the file is another one (checksum)")


def stored_arrays(result: Result) -> dict[str, AnyArray]:
    """Return the arrays with a checksum: of object, tree and hand, and of a thing's parts."""
    of_parts = (f"{part}/{column.name}" for part in result.parts for column in PART_STATIC_COLUMNS)
    return {**result.static, **{name: result[name] for name in of_parts}}


def stored_mesh(result: Result) -> Mesh:
    """Return the object's mesh, world [m]."""
    name = str(result.scene.get("object_name") or result.scene.get("object") or "object")
    return Mesh(result.static["object/vertices"], result.static["object/faces"], name=name, source=str(result.path))


def stored_tree(result: Result) -> SphereTree:
    """Return the object's sphere tree, world [m]; InputError if the arrays are no tree."""
    return sphere_tree_of(result.static, "object/tree")


def stored_surface(result: Result) -> ContactSurface:
    """Return the surface of one object that the hand touched, world [m]; InputError if hhsim has no such surface."""
    return contact_surface(result.surface, stored_mesh(result), stored_tree(result))


def stored_others(result: Result, parts: MovingParts) -> list[Thing]:
    """Return the things beside the first one of a result; none of a thing of several parts."""
    surfaces = parts.surfaces(result.surface)[1:]
    found = []
    for surface, stated, name in zip(surfaces, result.scene.get("others", ()), parts.names[1:]):
        free = {key: value for key, value in stated.items() if key != "fixed"}
        found.append(Thing(surface, FreeObject.from_json(free), stated["fixed"], name, parts.driven.get(name)))
    return found


def stored_hand(result: Result) -> HandModel:
    """Return the hand of a run; InputError if it is not the one of the run."""
    require_whole(result)
    return result_hand(result)


def stored_options(result: Result) -> SolverOptions:
    """Return the solver's options; InputError if hhsim has no such options."""
    try:
        return SolverOptions.from_json(result.scene["solver"])
    except (KeyError, InputError) as error:
        raise InputError(f"{result.path}: its solver options cannot be read: {error}") from error
