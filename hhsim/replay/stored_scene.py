"""Object, tree, hand and options to and from a result file, bit for bit."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any

import numpy as np

from hhsim.arrays import AnyArray
from hhsim.errors import InputError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import rotation_matrix
from hhsim.kernels.hand.kinematics import PALM_BODY
from hhsim.motion.trajectory import ObjectMotion, TickInput, Trajectory
from hhsim.reproducible import matmul
from hhsim.result import schema
from hhsim.result.body import HAND_ARRAYS, result_hand
from hhsim.result.body import Body as StoredBody
from hhsim.result.reader import Result
from hhsim.scene.body import JOINT_BOUNDS, Body, BodyMotion, Driven, Fixed, Free, HalfSpace, Joint
from hhsim.scene.engine_scene import EngineScene
from hhsim.scene.scene import TABLE, Hand, Scene, all_pairs
from hhsim.solver.method import names_code
from hhsim.solver.options import SolverOptions
from hhsim.system.settings_file import typed

LAW = "Coulomb with de Saxcé's correction, cone of 4 directions turned to the load; impacts inelastic; implicit Euler"
"""Contact law, as results state it."""
STILL = ObjectMotion(np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
"""Pose of a body whose mesh is in a frame that is the world's."""
JOINT_PROPERTIES = ("type", "axis", "origin", "limits", "friction", "on", "value")
"""Properties of a driven joint in a file."""


def hand_arrays(hand: HandModel) -> dict[str, AnyArray]:
    """Return the arrays of `hhsim.result.schema.HAND_STATIC`."""
    return {
        **{stored: getattr(hand, name) for name, stored in HAND_ARRAYS.items()},
        "palm_center": hand.palm_tree.leaf_center,
        "palm_radius": hand.palm_tree.leaf_radius,
        **{f"palm_tree/{name}": getattr(hand.palm_tree, name) for name in schema.TREE_ARRAYS},
        "palm_mesh/vertices": hand.palm_mesh.vertices,
        "palm_mesh/faces": hand.palm_mesh.faces,
    }


def body_name(name: str) -> str:
    """Return the name of a body's group: that of a mesh without slashes, `object` for none."""
    return name.replace("/", "-").strip(".") or "object"


def body_parts(scene: Scene, seen: EngineScene) -> dict[str, StoredBody]:
    """Return the bodies of a scene's file by their names, mesh and tree in the world where `place` has its frame.

    Where one of several is free each has its properties; else a joint that its values drive has them.
    """
    parts, solids = seen.parts, {body.name: body for body in scene.solids}
    found: dict[str, StoredBody] = {}
    for p, body in enumerate(scene.solids if parts is None else [solids[name] for name in parts.names]):
        # Of several, none free, all are driven: one that stands may stand in a frame that a recording carries along.
        kind = type(body.motion).__name__.lower() if seen.free or parts is None else "driven"
        columns = list(schema.POSE_COLUMNS if kind != "fixed" or parts is not None else ())
        properties: dict[str, Any] = {}
        if seen.free:
            properties = body.properties(scene.plane)
            columns += (*schema.MOTION_COLUMNS, *(() if parts is None else (schema.OF_BODIES,)))
            columns += (*(schema.FREE_COLUMNS if p == 0 else ()), *(schema.DRIVEN_COLUMNS if kind == "driven" else ()))
        elif parts is not None and body.joint is not None and body.name in parts.values:
            properties = {"joint": {name: getattr(body.joint, name) for name in JOINT_PROPERTIES}}
            columns.append(schema.JOINT_COLUMN)
        alone = body_name(seen.mesh.name), seen.mesh, seen.tree, seen.place
        name, mesh, tree, place = alone if parts is None else (body.name, parts.meshes[p], parts.trees[p], STILL)
        arrays = {
            "mesh/vertices": mesh.vertices,
            "mesh/faces": mesh.faces,
            **{f"tree/{each}": getattr(tree, each) for each in schema.TREE_ARRAYS},
            **{each: np.array(values, dtype=np.float64) for each, values in place._asdict().items()},
        }
        found[name] = StoredBody(kind, arrays, tuple(columns), properties)
    return found


def describe_scene(
    seen: EngineScene, hand: HandModel, options: SolverOptions, bodies: Mapping[str, StoredBody]
) -> dict[str, Any]:
    """Return the description of a scene for the result's file as plain values."""
    palm, leaves = hand.palm_tree.leaf_count, seen.tree.leaf_count
    return {
        **({} if seen.free is None else {"friction_law": LAW}),
        "solver": options.to_json(),
        "hand": {"side": hand.side, "length": hand.hand_length, "breadth": hand.hand_breadth, "palm_spheres": palm},
        "object_name": seen.mesh.name,
        "object_spheres": leaves,
        "modelled": {
            "fingers": list(options.fingers),
            "phalanges": int(options.modelled()[:PALM_BODY].sum()),
            "palm_spheres": palm,
            "object_spheres": leaves,
            "all_pairs": all_pairs(hand, seen.tree),
            "not_modelled": [
                *([] if seen.free else ["friction", "dynamics"]),
                "deformation",
                *([] if options.self_contact else ["finger-to-finger contact"]),
            ],
        },
        "checksums": checksums(hand.side, hand_arrays(hand), {name: body.static for name, body in bodies.items()}),
    }


def checksums(side: str, hand: Mapping[str, AnyArray], bodies: Mapping[str, Mapping[str, AnyArray]]) -> dict[str, str]:
    """Return the SHA-256 of a hand and of mesh and tree of each body, by group: of datasets' little-endian bytes."""
    digests: dict[str, Any] = {}
    arrays = {f"{schema.HANDS}/{side}/{name}": array for name, array in hand.items()}
    arrays |= {f"{schema.BODIES}/{body}/{name}": array for body, its in bodies.items() for name, array in its.items()}
    for name in sorted(arrays):
        top, own, rest = name.split("/", 2)
        part = f"{top}/{own}{'/tree' if top == schema.BODIES and rest.startswith('tree/') else ''}"
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
    return (
        f"the {name} hand" if top == schema.HANDS else f"the sphere tree of {name}" if rest else f"the mesh of {name}"
    )


def result_scene(hands: Sequence[Result], most: int | None = None) -> Scene:
    """Make the scene that a result holds, with these of its hands and its first `most` ticks, by default all.

    Raises InputError for a body, a tree or a hand that is not the run's.
    """
    result, bodies = hands[0], list(hands[0].bodies.values())
    count = min(most or result.ticks, *(hand.ticks for hand in hands))
    rows = slice(count)
    names = ("time", "input_seq", *(f"haptic/{name}" for name in HandConfiguration._fields))
    frame = result.poses(schema.FRAME, rows) if result.frame == schema.FRAME else None
    if len(bodies) == 1 and bodies[0].kind == "driven":
        frame = bodies[0].poses(rows)
    made = []
    for hand in hands:
        ticks = {name.rpartition("/")[2]: values for name, values in next(hand.blocks(names, count)).items()}
        given = TickInput(**ticks, phases=hand.phases, rate=hand.rate, object_motion=frame)
        place = bodies[0].place._asdict() if len(bodies) == 1 else {}
        about = {"name": str(hand.scene["motion"]), **{f"object_{name}": of for name, of in place.items()}}
        still = np.zeros((1, 3)), STILL.orientation[None], np.zeros((1, 5, 3)), np.zeros((1, 5))
        made.append(Hand(stored_hand(hand), Trajectory(np.zeros(1), *still, **about), given))
    own: list[Body | HalfSpace] = [_scene_body(body, rows) for body in bodies]
    table = next((body.properties["table"] for body in bodies if body.is_free), None)
    if table is not None:
        name = next(name for name in (TABLE, f"{TABLE}-under-all") if name not in result.bodies)
        own.append(HalfSpace(name, table, bodies[0].properties["table_friction"]))
    return Scene(tuple(made), tuple(own), result.scene)


def _scene_body(body: StoredBody, rows: slice) -> Body:
    """Return a body of a result as one of a scene."""
    mesh, tree, place, own = body.mesh, body.tree, body.place, body.properties
    begin, about = place, {name: own[name] for name in ("friction", "torsion") if name in own}
    motion: BodyMotion = Fixed()
    if body.is_free:
        free = {each.name: own[each.name] for each in fields(Free) if each.name in own}
        motion = typed(free, Free, f"{body.name}: free object")
        for kind in JOINT_BOUNDS:
            if isinstance(own.get(kind), Mapping):
                about["joint"] = typed({"type": kind, **own[kind]}, Joint, f"{body.name}: {kind}")
    elif "recorded_position" in body:
        motion = Driven(ObjectMotion(*(np.asarray(body[f"recorded_{name}"][rows]) for name in ObjectMotion._fields)))
    elif body.kind == "driven":
        poses = body.poses(rows)
        motion, begin = Driven(poses, np.asarray(body["joint"][rows]) if "joint" in body else None), poses.at(0)
        if joint := dict(own.get("joint", {})):
            about["joint"] = Joint(start=joint.pop("value"), **joint)
    # Mesh and tree are stored in the world; a body of a scene has them in its own frame.
    own_mesh, own_tree = mesh, tree
    if not all(map(np.array_equal, place, STILL)):
        back = rotation_matrix(place.orientation).T
        to = back, matmul(back, -place.position)
        own_mesh, own_tree = mesh.transformed(*to), tree.transformed(*to)
    made = Body(body.name, own_mesh, own_tree, *begin, motion, **about)
    if all(map(np.array_equal, begin, place)):
        # As stored: there and back would round.
        vars(made).update(placed_mesh=mesh, placed_tree=tree)
    return made


def stored_hand(result: Result) -> HandModel:
    """Return the hand of a run; InputError if it, or a body, or its tree, is not the one of the run."""
    stated = result.scene.get("checksums", {})
    for part, digest in stored_checksums(result).items():
        if digest != stated.get(part):
            raise InputError(f"{result.path} cannot be run again: {part_words(part)} in the file is another (checksum)")
    return result_hand(result)


def stored_options(result: Result, trust: bool = False) -> SolverOptions:
    """Return the solver's options; InputError if hhsim has no such options, or without `trust` of code it names."""
    if names_code(result.method) and not trust:
        raise InputError(
            f"{result.path} names a method by its code, {result.method}, which would be imported and run: --trust, if "
            "you trust the file"
        )
    try:
        return SolverOptions.from_json(result.scene["solver"])
    except (KeyError, InputError) as error:
        raise InputError(f"{result.path}: its solver options cannot be read: {error}") from error
