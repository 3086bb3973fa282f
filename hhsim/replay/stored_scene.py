"""Object, tree, hand and options to and from a result file, bit for bit."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import AnyArray
from hhsim.errors import InputError
from hhsim.hand.model import HandModel
from hhsim.kernels.hand.kinematics import PALM_BODY
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.moving_parts import MovingParts
from hhsim.result.body import Body
from hhsim.result.reader import Result
from hhsim.result.schema import (
    BODIES,
    DRIVEN_COLUMNS,
    FREE_COLUMNS,
    HANDS,
    JOINT_COLUMN,
    MOTION_COLUMNS,
    OF_BODIES,
    POSE_COLUMNS,
)
from hhsim.result.stored_hand import HAND_ARRAYS, TREE_ARRAYS, result_hand, sphere_tree_of
from hhsim.result.writer import BodyPart
from hhsim.scene.free_object import LAW, FreeObject
from hhsim.scene.scene import Scene, all_pairs
from hhsim.solver.free_engine import Thing
from hhsim.solver.options import SolverOptions
from hhsim.trees.contact_surface import ContactSurface, contact_surface
from hhsim.trees.sphere_tree import SphereTree

STILL = (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)
"""Pose of a body whose mesh is in a frame that is the world's."""


def hand_arrays(hand: HandModel) -> dict[str, AnyArray]:
    """Return the arrays of `hhsim.result.schema.HAND_STATIC`."""
    return {
        **{stored: getattr(hand, name) for name, stored in HAND_ARRAYS.items()},
        "palm_center": hand.palm_tree.leaf_center,
        "palm_radius": hand.palm_tree.leaf_radius,
        **{f"palm_tree/{name}": getattr(hand.palm_tree, name) for name in TREE_ARRAYS},
        "palm_mesh/vertices": hand.palm_mesh.vertices,
        "palm_mesh/faces": hand.palm_mesh.faces,
    }


def body_arrays(
    mesh: Mesh, tree: SphereTree, position: ArrayLike = STILL[0], orientation: ArrayLike = STILL[1]
) -> dict[str, AnyArray]:
    """Return the arrays of `hhsim.result.schema.BODY_STATIC`: mesh and tree in the world [m].

    The origin of the body's own frame [m], (3,), and its orientation (w, x, y, z), (4,), are in the world.
    """
    return {
        "mesh/vertices": mesh.vertices,
        "mesh/faces": mesh.faces,
        **{f"tree/{name}": getattr(tree, name) for name in TREE_ARRAYS},
        "position": np.array(position, dtype=np.float64),
        "orientation": np.array(orientation, dtype=np.float64),
    }


def body_name(name: str) -> str:
    """Return the name of a body's group: that of a mesh without slashes, `object` for none."""
    return name.replace("/", "-").strip(".") or "object"


def one_body(
    mesh: Mesh,
    tree: SphereTree,
    position: ArrayLike,
    orientation: ArrayLike,
    *,
    driven: bool = False,
    free: FreeObject | None = None,
) -> dict[str, BodyPart]:
    """Return the body of a scene with one, at its place of the first tick, by its name."""
    kind = "driven" if driven else "fixed" if free is None else "free"
    columns = (*(POSE_COLUMNS if driven or free else ()), *((*MOTION_COLUMNS, *FREE_COLUMNS) if free else ()))
    properties = {} if free is None else free.to_json()
    part = BodyPart(kind, body_arrays(mesh, tree, position, orientation), columns, properties)
    return {body_name(mesh.name): part}


def several_bodies(parts: MovingParts, others: Sequence[tuple[FreeObject, bool]] = ()) -> dict[str, BodyPart]:
    """Return the bodies of a scene of several by their names, in frames of their own.

    `others` has the physical properties of each where one is free, and True for one that is fixed.
    """
    found: dict[str, BodyPart] = {}
    for k, (name, mesh, tree) in enumerate(zip(parts.names, parts.meshes, parts.trees, strict=True)):
        columns, kind, properties = [*POSE_COLUMNS, *((JOINT_COLUMN,) if name in parts.values else ())], "driven", {}
        if others:
            free, fixed = others[k]
            kind = "fixed" if fixed else "driven" if name in parts.driven else "free"
            columns += [*MOTION_COLUMNS, OF_BODIES, *(() if k else FREE_COLUMNS)]
            columns += DRIVEN_COLUMNS if name in parts.driven else ()
            properties = free.to_json()
        found[name] = BodyPart(kind, body_arrays(mesh, tree), columns, properties)
    return found


def with_joints(parts: Mapping[str, BodyPart], scene: Scene) -> dict[str, BodyPart]:
    """Return bodies with the joints that driven ones hang on; those of free ones state them already."""
    joints = {body.name: {"joint": asdict(body.joint)} for body in scene.solids if body.joint is not None}
    own = {name: part.properties or joints.get(name, {}) for name, part in parts.items()}
    return {name: replace(part, properties=own[name]) for name, part in parts.items()}


def describe_scene(
    mesh: Mesh,
    tree: SphereTree,
    hand: HandModel,
    options: SolverOptions,
    bodies: Mapping[str, BodyPart],
    free: FreeObject | None = None,
) -> dict[str, Any]:
    """Return the description of a scene for the result's file as plain values."""
    return {
        **({} if free is None else {"friction_law": LAW}),
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
        "checksums": checksums(hand.side, hand_arrays(hand), {name: body.static for name, body in bodies.items()}),
    }


def checksums(side: str, hand: Mapping[str, AnyArray], bodies: Mapping[str, Mapping[str, AnyArray]]) -> dict[str, str]:
    """Return the SHA-256 of a hand and of mesh and tree of each body, by group: of datasets' little-endian bytes."""
    digests: dict[str, Any] = {}
    arrays = {f"{HANDS}/{side}/{name}": array for name, array in hand.items()}
    arrays |= {f"{BODIES}/{body}/{name}": array for body, its in bodies.items() for name, array in its.items()}
    for name in sorted(arrays):
        top, own, rest = name.split("/", 2)
        part = f"{top}/{own}{'/tree' if top == BODIES and rest.startswith('tree/') else ''}"
        array = np.ascontiguousarray(arrays[name])
        digests.setdefault(part, hashlib.sha256())
        digests[part].update(f"{rest} {array.shape} ".encode())
        digests[part].update(array.astype(array.dtype.newbyteorder("<"), copy=False).tobytes())
    return {part: digest.hexdigest() for part, digest in digests.items()}


def stored_checksums(result: Result) -> dict[str, str]:
    """Return the checksums of what a result holds."""
    hand = {name.removeprefix("hand/"): array for name, array in result.static.items()}
    return checksums(result.name, hand, {name: body.static for name, body in result.bodies.items()})


def part_words(part: str) -> str:
    """Return what a part with a checksum is, in words."""
    top, name, *rest = part.split("/")
    return f"the {name} hand" if top == HANDS else f"the sphere tree of {name}" if rest else f"the mesh of {name}"


def require_whole(result: Result) -> None:
    """Raise InputError if a body, its tree or the hand of a result is not the one of its run."""
    stated = result.scene.get("checksums", {})
    for part, digest in stored_checksums(result).items():
        if digest != stated.get(part):
            raise InputError(f"{result.path} cannot be run again: {part_words(part)} in the file is another (checksum)")


def stored_mesh(body: Body) -> Mesh:
    """Return the mesh of a body, where it is stored [m]."""
    return Mesh(body.vertices, body.faces, name=body.name, source=str(body.result.path))


def stored_tree(body: Body) -> SphereTree:
    """Return the sphere tree of a body, where it is stored [m]; InputError if the arrays are no tree."""
    return sphere_tree_of(body.static, "tree")


def stored_surface(result: Result) -> ContactSurface:
    """Return the surface of the first body that the hand touched, world [m]; InputError if hhsim has none such."""
    return contact_surface(result.surface, stored_mesh(result.body), stored_tree(result.body))


def stored_others(result: Result, parts: MovingParts) -> list[Thing]:
    """Return the bodies beside a free one of a result; none of driven ones alone."""
    found = []
    for surface, body in list(zip(parts.surfaces(result.surface), result.bodies.values()))[1:]:
        if result.free:
            own = FreeObject.from_json(body.properties)
            found.append(Thing(surface, own, body.kind == "fixed", body.name, parts.driven.get(body.name)))
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
