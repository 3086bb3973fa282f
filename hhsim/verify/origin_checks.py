"""Claims of the origin of object, tree and hand, and a list of what no file can show."""

from dataclasses import fields
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import HhsimError
from hhsim.hand.model import HandModel
from hhsim.linkage.file import resolve_object, solid_for
from hhsim.mesh.catalogue import load_object, names_a_file, object_names
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.run_ticks import leaves_in_reach
from hhsim.result.body import Body
from hhsim.result.reader import Result
from hhsim.result.schema import BETWEEN_COLUMNS, HANDS_APART, TREE_ARRAYS
from hhsim.result.stored_hand import HAND_ARRAYS
from hhsim.solver.free_object import LAW
from hhsim.trees.cache import cached_sphere_tree, shipped_tree
from hhsim.trees.options import TreeOptions
from hhsim.trees.sphere_tree import SphereTree
from hhsim.trees.triangle_tree import OPTIONS, triangle_tree
from hhsim.verify.claim import NOT_JUDGED, Claim, all_true, judged
from hhsim.verify.contacts import PALM
from hhsim.verify.file_checks import COVER, covered
from hhsim.verify.kinematics import rotations

SAME_PLACE = 1e-12
"""Tolerance of places [m]: rounding of a rotated mesh."""
WHY_SAME_PLACE = "rounding of a world frame"


def origin_claims(result: Result, again: bool = False) -> list[Claim]:
    """Judge object, tree and hand; `again` reads mesh files and builds trees for it."""
    mesh = own_object(result, again)
    tree = None if mesh is None else own_tree(result, mesh, again)
    return [
        # Several bodies are judged as their file declares them.
        *([_object(result, mesh, again)] if len(result.bodies) == 1 else []),
        _tree(result, mesh, tree, again),
        *(judge(result) for judge in (_hand, _palm, _described)),
        *_beyond_a_file(result, again),
    ]


def own_object(result: Result, again: bool) -> Mesh | None:
    """Mesh of the one body that the scene names, in its own frame; None where it is not available."""
    if len(result.bodies) > 1:
        return None
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
            mesh, _ = resolve_object(word, scene.get("unit"), size, thickness, solid=solid_of(result))
        else:
            mesh = None
    except HhsimError:
        return None
    return mesh if mesh is not None and mesh.sha256 == stated else None


def solid_of(result: Result) -> bool | None:
    """Return the argument `solid` that the meshes of a result's objects were loaded with."""
    of_one = len(result.bodies) == 1 and result.surface == "spheres" and result.body.is_free
    return solid_for(result.surface, bool(result.scene.get("solid")) or of_one)


def own_tree(result: Result, mesh: Mesh, again: bool) -> SphereTree | None:
    """Tree of a mesh in its own frame by the scene's options, shipped or built; None for another's."""
    stated = result.scene.get("tree_options") or {}
    if again and {name: stated.get(name) for name in OPTIONS} == OPTIONS:
        return triangle_tree(mesh, int(stated["level"]))
    options = _tree_options(result)
    if options is None:
        return None
    try:
        return cached_sphere_tree(mesh, options) if again else shipped_tree(mesh, options)
    except HhsimError:
        return None


def _tree_options(result: Result) -> TreeOptions | None:
    stated: dict[str, Any] = dict(result.scene.get("tree_options") or {})
    if not stated or result.scene.get("tree") is not None:
        return None
    known = {field.name for field in fields(TreeOptions)}
    try:
        options = TreeOptions(**{name: value for name, value in stated.items() if name in known})
    except (HhsimError, TypeError):
        return None
    # The options record the version of the builder.
    return options if options.recorded() == {**options.recorded(), **stated} else None


def _object(result: Result, mesh: Mesh | None, again: bool) -> Claim:
    name, says = "object", "the object is the one that the scene names"
    if mesh is None:
        where = "it is no object of the catalogue" + ("" if again else "; --again reads mesh files")
        return Claim(name, says, NOT_JUDGED, unit="m", note=f"{where}, and its mesh file is not in the result")
    placed = mesh.transformed(*_placement(result))
    vertices, faces = result.body.vertices, result.body.faces
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
    stored = [result.body.static[f"tree/{part}"] for part in TREE_ARRAYS]
    same = stored[0].shape == placed.center.shape and all(
        np.array_equal(getattr(placed, part), values) for part, values in zip(TREE_ARRAYS[2:], stored[2:])
    )
    off = np.array([np.inf])
    if same:
        off = np.maximum(np.linalg.norm(placed.center - stored[0], axis=1), np.abs(placed.radius - stored[1]))
    return judged(name, says, off, SAME_PLACE, "m", WHY_SAME_PLACE)


def _placement(result: Result) -> tuple[FloatArray, FloatArray]:
    position, orientation = result.body.place
    return rotations(np.array(orientation)[None])[0].as_matrix()[0], np.array(position)


def _hand(result: Result) -> Claim:
    name, says = "hand", "the hand is the one of its side, length and breadth, joint limits and all"
    sizes, static = result.scene["hand"], result.static
    other = Claim(name, says, NOT_JUDGED, unit="m, rad", note="its sizes were given, and are not in the result")
    if result.scene.get("hand_file") is not None:
        return other
    try:
        hand = HandModel.default(sizes["side"], float(sizes["length"]), float(sizes["breadth"]))
    except HhsimError as error:
        return judged(name, says, [np.inf], SAME_PLACE, "m, rad", WHY_SAME_PLACE, note=str(error))
    own = {f"hand/{stored}": np.asarray(getattr(hand, field)) for field, stored in HAND_ARRAYS.items()}
    own |= {f"hand/palm_tree/{part}": getattr(hand.palm_tree, part) for part in TREE_ARRAYS}
    own |= {f"hand/palm_mesh/{part}": getattr(hand.palm_mesh, part) for part in ("vertices", "faces")}
    off = [
        np.abs(values - static[column]).max(initial=0.0) if values.shape == static[column].shape else np.inf
        for column, values in own.items()
    ]
    claim = judged(name, says, off, SAME_PLACE, "m, rad", WHY_SAME_PLACE)
    # A program that calls the library says nothing of a hand of its own.
    return other if claim.failed and "hand_file" not in result.scene else claim


def _described(result: Result) -> Claim:
    scene, static, solver = result.scene, result.static, result.scene["solver"]
    modelled = scene["modelled"]
    leaf, palm, phalanges = leaves_in_reach(result), len(static["hand/palm_radius"]), 3 * len(solver["fingers"])
    depth = max(int(body.static["tree/level"].max(initial=0)) for body in result.bodies.values())
    stated = {
        "object_spheres": (scene["object_spheres"], leaf),
        "hand.palm_spheres": (scene["hand"]["palm_spheres"], palm),
        "modelled.fingers": (modelled["fingers"], solver["fingers"]),
        "modelled.phalanges": (modelled["phalanges"], phalanges),
        "modelled.palm_spheres": (modelled["palm_spheres"], palm),
        "modelled.object_spheres": (modelled["object_spheres"], leaf),
        "modelled.all_pairs": (modelled["all_pairs"], (PALM + palm) * leaf),
        "modelled.not_modelled": (modelled["not_modelled"], _left_out(result)),
        "friction_law": (scene.get("friction_law"), LAW if result.body.is_free else None),
        "tree_options.level": ((scene.get("tree_options") or {}).get("level", depth), depth),
        "hand.side": (scene["hand"]["side"], result.name),
        "bodies": ([body.name for body in result.bodies.values() if not _is_of_kind(body)], []),
        **_apart(result),
        **({"ticks": (scene["ticks"], result.ticks)} if result.complete and "ticks" in scene else {}),
    }
    wrong = {name: pair for name, pair in stated.items() if pair[0] != pair[1]}
    note = "; ".join(f"{name} is stated as {given}, there are {own}" for name, (given, own) in wrong.items())
    says = "spheres, fingers and pairs are as many as the scene says"
    return all_true("scene", says, np.isin(list(stated), list(wrong)), note=note)


def _left_out(result: Result) -> list[str]:
    own = [*([] if result.body.is_free else ["friction", "dynamics"]), "deformation"]
    return own if result.scene["solver"].get("self_contact") else [*own, "finger-to-finger contact"]


def _apart(result: Result) -> dict[str, tuple[bool, bool]]:
    """Return whether two hands are said to keep out of each other, and whether these options keep them so."""
    if result.other is None or BETWEEN_COLUMNS[0].name not in result or "recording" in result.scene:
        return {}
    solver = result.scene["solver"]
    own = result.body.is_free or (solver["method"] in ("coupled", "progressive") and solver["qp"] == "active-set")
    return {HANDS_APART: (bool(result.scene.get(HANDS_APART)), own)}


def _is_of_kind(body: Body) -> bool:
    """Return True if a body has poses, or stands still, as its kind says."""
    still = all(np.abs(values - values[:1]).max(initial=0.0) <= SAME_PLACE for values in body.moved())
    return still if body.kind == "fixed" else body.moves


def _palm(result: Result) -> Claim:
    static = result.static
    center, radius = static["hand/palm_center"], static["hand/palm_radius"]
    level = static["hand/palm_tree/level"]
    leaf = level == level.max(initial=0)
    says = "the palm's spheres are the leaves of its tree, and cover its mesh"
    of_tree = static["hand/palm_tree/center"][leaf], static["hand/palm_tree/radius"][leaf]
    if not (np.array_equal(of_tree[0], center) and np.array_equal(of_tree[1], radius)):
        return judged("palm", says, [np.inf], COVER, "m", "exact", note="its tree has other leaves")
    vertices, faces = static["hand/palm_mesh/vertices"], static["hand/palm_mesh/faces"]
    return covered("palm", says, tuple(map(np.array, (vertices, faces, center, radius))))


def _beyond_a_file(result: Result, again: bool) -> list[Claim]:
    """Statements of a file that nothing in it could contradict."""
    beyond = {
        "times": ("how long ticks took", "no second measurement gives the same times"),
        "machine and versions": (
            "the machine, the packages, hhsim's version and the date",
            "a file cannot show where and by what it was made",
        ),
        "names": ("names, sources and the command", "words that no number follows from"),
    }
    if result.live is not None:
        beyond["glove's own words"] = (
            "raw channels, the glove's stamps, numbers and battery, what it is, and who ended the session",
            "nothing in the file follows from them but the angles, by a calibration that it does not hold",
        )
    if not again:
        beyond["second run"] = (
            "the input, run once more, gives these ticks",
            "--again makes the motion and the ticks once more; without it nothing shows a hand and its user moved "
            "together where nothing touches, work counters within their bounds, how much was left to go in a tick that "
            "lags, or options that only decide how the solver gets there",
        )
    return [Claim(name, says, NOT_JUDGED, note=note) for name, (says, note) in beyond.items()]
