"""Claims of where the parts of a scene come from: object, tree and palm; and what no file can show of itself."""

from dataclasses import fields
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import HhsimError, MeshError
from hhsim.kernels.rotation import quaternion_to_matrix
from hhsim.mesh.catalogue import load_object, names_a_file, object_names, resolve_object
from hhsim.mesh.mesh import Mesh
from hhsim.result.reader import Result
from hhsim.trees.cache import cached_sphere_tree, shipped_tree
from hhsim.trees.options import TreeOptions
from hhsim.trees.sphere_tree import SphereTree
from hhsim.trees.triangle_tree import OPTIONS, triangle_tree
from hhsim.verify.claim import NOT_JUDGED, Claim, judged
from hhsim.verify.file_checks import COVER, outside_spheres

SAME_PLACE = 1e-12
"""Places that differ by this [m] are the same: what turning a mesh about rounds to."""
WHY_SAME_PLACE = "rounding of a world frame"
TREE_ARRAYS = ("center", "radius", "level", "parent")


def origin_claims(result: Result, again: bool = False) -> list[Claim]:
    """Object, tree and palm, and what is not judged.

    Args:
        result: Of a replay or a session.
        again: Whether mesh files are read and trees are built for it.
    """
    mesh = own_object(result, again)
    tree = None if mesh is None else own_tree(result, mesh, again)
    return [_object(result, mesh, again), _tree(result, mesh, tree, again), _palm(result), *_beyond_a_file()]


def own_object(result: Result, again: bool) -> Mesh | None:
    """The object's mesh in its own frame, from where the scene has it; None where it is not to be had."""
    scene = result.scene
    word, stated = str(scene.get("object") or ""), scene.get("object_mesh")
    try:
        if not names_a_file(word):
            word = word or str(scene.get("object_name"))
            mesh = load_object(word).mesh if word in object_names() else None
        elif again:
            size, thickness = (
                None if scene.get(name) is None else 1e-3 * float(scene[name]) for name in ("size_mm", "thickness_mm")
            )
            mesh, _ = resolve_object(word, scene.get("unit"), size, thickness, solid=result.surface != "mesh")
        else:
            mesh = None
    except HhsimError:
        return None
    return mesh if mesh is not None and mesh.sha256 == stated else None


def own_tree(result: Result, mesh: Mesh, again: bool) -> SphereTree | None:
    """The tree that hhsim has or makes of a mesh in its own frame, by the options of the scene; None for another's."""
    stated = result.scene.get("tree_options") or {}
    if again and {name: stated.get(name) for name in OPTIONS} == OPTIONS:
        return triangle_tree(mesh, int(stated["level"]))
    options = _tree_options(result)
    if options is None:
        return None
    try:
        tree = cached_sphere_tree(mesh, options) if again else shipped_tree(mesh, options)
    except HhsimError:
        return None
    return tree


def _tree_options(result: Result) -> TreeOptions | None:
    stated: dict[str, Any] = dict(result.scene.get("tree_options") or {})
    if not stated or result.scene.get("tree") is not None:
        return None
    known = {field.name for field in fields(TreeOptions)}
    try:
        options = TreeOptions(**{name: value for name, value in stated.items() if name in known})
    except (HhsimError, TypeError):
        return None
    # Another version of the builder makes another tree.
    return options if options.recorded() == {**options.recorded(), **stated} else None


def _object(result: Result, mesh: Mesh | None, again: bool) -> Claim:
    name, says = "object", "the object is the one that the scene names"
    if mesh is None:
        where = "it is no object of the catalogue" + ("" if again else "; --again reads mesh files")
        return Claim(name, says, NOT_JUDGED, unit="m", note=f"{where}, and its mesh file is not in the result")
    placed = mesh.transformed(*_placement(result))
    vertices, faces = result.static["object/vertices"], result.static["object/faces"]
    same = placed.vertices.shape == vertices.shape and np.array_equal(placed.faces, faces)
    off = np.linalg.norm(placed.vertices - vertices, axis=1) if same else np.array([np.inf])
    return judged(name, says, off, SAME_PLACE, "m", WHY_SAME_PLACE)


def _tree(result: Result, mesh: Mesh | None, tree: SphereTree | None, again: bool) -> Claim:
    name, says = "tree", "the sphere tree is the one that hhsim makes of the object"
    if tree is None:
        if mesh is None or _tree_options(result) is None:
            note = "the object or the tree is not hhsim's own"
        else:
            note = "it cannot be built" if again else "it does not ship with hhsim; --again builds it"
        return Claim(name, says, NOT_JUDGED, unit="m", note=note)
    placed = tree.transformed(*_placement(result))
    stored = [result.static[f"object/tree/{part}"] for part in TREE_ARRAYS]
    same = stored[0].shape == placed.center.shape and all(
        np.array_equal(getattr(placed, part), values) for part, values in zip(TREE_ARRAYS[2:], stored[2:])
    )
    off = np.array([np.inf])
    if same:
        off = np.maximum(np.linalg.norm(placed.center - stored[0], axis=1), np.abs(placed.radius - stored[1]))
    return judged(name, says, off, SAME_PLACE, "m", WHY_SAME_PLACE)


def _placement(result: Result) -> tuple[FloatArray, FloatArray]:
    rotation = np.empty((3, 3))
    quaternion_to_matrix(np.array(result.static["object/orientation"]), rotation)
    return rotation, np.array(result.static["object/position"])


def _palm(result: Result) -> Claim:
    """The palm's spheres against its tree and its mesh, which are in the file besides."""
    static = result.static
    center, radius = static["hand/palm_center"], static["hand/palm_radius"]
    level = static["hand/palm_tree/level"]
    leaf = level == level.max(initial=0)
    says = "the palm's spheres are the leaves of its tree, and cover its mesh"
    of_tree = static["hand/palm_tree/center"][leaf], static["hand/palm_tree/radius"][leaf]
    if not (np.array_equal(of_tree[0], center) and np.array_equal(of_tree[1], radius)):
        return judged("palm", says, [np.inf], COVER, "m", "exact", note="its tree has other leaves")
    vertices, faces = static["hand/palm_mesh/vertices"], static["hand/palm_mesh/faces"]
    try:
        gap = outside_spheres(np.array(vertices), np.array(faces), np.array(center), np.array(radius))
    except MeshError as error:
        return judged("palm", says, [np.inf], COVER, "m", "exact", note=str(error))
    return judged("palm", says, gap, COVER, "m", "less than any figure is stated to")


def _beyond_a_file() -> list[Claim]:
    """What a file says of itself, and what nothing in it could contradict: it is no part of a verdict."""
    return [
        Claim("times", "how long ticks took", NOT_JUDGED, note="no second measurement gives the same times"),
        Claim(
            "machine and versions",
            "the machine, the packages, hhsim's version and the date",
            NOT_JUDGED,
            note="a file cannot show where and by what it was made",
        ),
        Claim("names", "names, sources and the command", NOT_JUDGED, note="words that no number follows from"),
    ]
