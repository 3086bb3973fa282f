"""Inputs of a run, in a form that compares runs of different machines; its poses and forces; its unusual options.

Meshes are compared by hash. Trees, hands and motions come from optimisations whose last bits, and the order of equal
sibling spheres, differ between processors: they are compared by sums with a tolerance, of trees in any order.
"""

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import FloatArray, IntArray
from hhsim.errors import HhsimError
from hhsim.hand.fingers import FINGERS
from hhsim.mesh.catalogue import usual_level
from hhsim.result.body import Body
from hhsim.result.reader import Result
from hhsim.result.schema import BODIES
from hhsim.solver.method import names_code
from hhsim.solver.options import SolverOptions, Stiffness
from hhsim.system.plain_json import plain_json

TOLERANCE = 1e-7
"""Largest difference of a sum, weights from 1 to 2: 0.1 µm or µrad at a single tick, radius or centre."""
OPTION_DIGITS = 12
"""Digits by which options are compared: 0.7 mm is 0.0007 m in one file and 0.0006999999999999999 m in another."""
GOLDEN = 0.6180339887498949
HAND = ("hand/phalanx_radius", "hand/phalanx_length", "hand/palm_center", "hand/palm_radius")
MOTION = ("haptic/position", "haptic/orientation", "haptic/flexion", "haptic/abduction")
OF_THE_MOTION = ("motion", "samples", "rate", "seed", "tremor_mm_deg", "place_object")
"""Options of a replay that choose the motion."""
INPUT_OPTIONS = ("level", "max_error", "unit", "size_mm", *OF_THE_MOTION)
"""Options of a replay that choose the input; names of files do not."""
OF_THE_MESH = ("center", "inertia")
"""Properties of a free object that follow from mesh and mass; a zero among them differs in all its digits."""

OF_THE_HAND = (
    *("graphic/position", "graphic/orientation", "graphic/flexion", "graphic/abduction"),
    *("force/palm_wrench", "force/phalanx", "force/total"),
)
DIGITS = 16
"""Hexadecimal digits of a digest."""
ShownPoses = Mapping[str, FloatArray]
"""Places [m], and the total force [N], by name, world, each (T, 3)."""
KEPT = 16
"""Ticks that a baseline keeps of each run."""
FORCE = "total force"
SAME_POSE = {"m": 1e-9, "N": 1e-6}
"""Differences of ticks that are rounding; a baseline keeps whole nanometres."""


@dataclass(frozen=True)
class RunInputs:
    """Inputs of a run."""

    schema: int  # version of the result file
    mesh: str  # SHA-256 of the object's mesh
    ticks: int  # number of ticks
    spheres: int  # number of leaves of the object's tree
    options: Mapping[str, Any]  # options of the replay, by name; numbers of a free object as `free name`
    solver: Mapping[str, Any]  # options of the solver, by name; those of the stiffness as `stiffness.name`
    tree: tuple[float, ...]  # sums that differ for different ones
    hand: tuple[float, ...]
    motion: tuple[float, ...]


def run_inputs(result: Result) -> RunInputs:
    """Collect the inputs of a result; the motion is in the object's frame, unless the object is free."""
    result = result if result.body.is_free else result.seen_from_object
    scene = result.scene
    # A free object's properties but those of its mesh.
    free = {f"free {name}": value for name, value in result.body.properties.items() if name not in OF_THE_MESH}
    options = (
        {name: scene.get(name) for name in INPUT_OPTIONS}
        | {"free object": "yes" if result.body.is_free else "no"}
        | free
    )
    solver: dict[str, Any] = {}
    for name, value in scene["solver"].items():
        solver |= {f"{name}.{key}": v for key, v in value.items()} if isinstance(value, dict) else {name: value}
    return RunInputs(
        schema=result.schema_version,
        mesh=str(scene.get("object_mesh") or scene["checksums"][f"{BODIES}/{result.body.name}"]),
        ticks=result.ticks,
        spheres=int(scene["object_spheres"]),
        options=options,
        solver=solver,
        tree=tuple(value for body in result.bodies.values() for value in _moments(body)),
        hand=_sums(result.static[name] for name in HAND),
        motion=_sums(result[name] for name in MOTION),
    )


def differences(base: RunInputs, head: RunInputs) -> list[str]:
    """Differences between two runs' inputs, a few words each; empty where they can be compared."""
    found = []
    for name, what in (("schema", "result schema"), ("ticks", "number of ticks"), ("spheres", "spheres of the tree")):
        if getattr(base, name) != getattr(head, name):
            found.append(f"{what}: {getattr(base, name)} and {getattr(head, name)}")
    if base.mesh != head.mesh:
        found.append(f"object mesh: {base.mesh[:12]}… and {head.mesh[:12]}…")
    for kind in ("options", "solver"):
        one, other = getattr(base, kind), getattr(head, kind)
        # Options that only one of them has came or went between two versions.
        both = sorted(one.keys() & other.keys())
        unlike = [name for name in both if _plain(one[name]) != _plain(other[name])]
        found += [f"{name}: {one[name]} and {other[name]}" for name in unlike]
    for name, what in (("tree", "sphere tree"), ("hand", "hand"), ("motion", "trajectory")):
        if not _alike(getattr(base, name), getattr(head, name)):
            found.append(what)
    return found


def new_options(base: RunInputs, head: RunInputs) -> list[str]:
    """Names of solver options that only one of two runs has."""
    return sorted(base.solver.keys() ^ head.solver.keys())


def _moments(body: Body) -> tuple[float, ...]:
    """First and second moments of a body's spheres about the origin, which do not depend on their order."""
    center, radius = (np.asarray(body.static[f"tree/{name}"], np.float64) for name in ("center", "radius"))
    spheres = np.concatenate([center, radius[:, None]], axis=1)
    square = spheres.T @ spheres
    return tuple(float(value) for value in (*spheres.sum(axis=0), *square[np.triu_indices(4)]))


def _sums(arrays: Iterable[ArrayLike]) -> tuple[float, ...]:
    """Sums of each array's columns, weighted by row with weights from 1 to 2."""
    found: list[float] = []
    for values in arrays:
        # The solver holds input that is not finite.
        array = np.nan_to_num(np.asarray(values, dtype=np.float64), nan=0.0, posinf=0.0, neginf=0.0)
        weight = 1.0 + (np.arange(len(array)) * GOLDEN) % 1.0
        found += (array.reshape(len(array), -1) * weight[:, None]).sum(axis=0).tolist()
    return tuple(found)


def _alike(one: tuple[float, ...], other: tuple[float, ...]) -> bool:
    return len(one) == len(other) and bool(np.all(np.abs(np.subtract(one, other)) <= TOLERANCE))


def _plain(value: Any) -> Any:
    """Value of an option for comparison: a baseline keeps fewer digits than a result."""
    return plain_json(value, lambda number: float(f"{number:.{OPTION_DIGITS}g}"))


def tick_digest(result: Result) -> str:
    """Compute a digest of the shown hand's poses, its forces, and the poses of a free object, of all ticks.

    It is the same for the same bits, whatever else the file holds.
    """
    found = hashlib.sha256()
    of_body = (result.body[name] for name in ("position", "orientation") if result.body.is_free)
    for values in (*(result[name] for name in OF_THE_HAND), *of_body):
        found.update(np.ascontiguousarray(values, np.float64).tobytes())
    return found.hexdigest()[:DIGITS]


def shown_poses(result: Result) -> dict[str, FloatArray]:
    """Return the shown palm and fingertips, the place of a free object and the total force at each tick."""
    tips = {f"tip of the {name}": result["graphic/joints"][:, finger, -1] for finger, name in enumerate(FINGERS)}
    free = {"object": result.body["position"]} if result.body.is_free else {}
    return {"palm": result["graphic/position"], **tips, **free, FORCE: result["force/total"]}


def kept_ticks(ticks: int) -> IntArray:
    """Return the ticks of which a baseline keeps the poses."""
    return np.linspace(0, ticks - 1, min(ticks, KEPT)).astype(np.int64)


def told_difference(head: ShownPoses, base: ShownPoses) -> tuple[str, bool]:
    """Return the largest differences in words, and True if all ticks are known to differ by rounding alone.

    Where one side is a baseline's, the ticks that it keeps are compared.
    """
    apart: dict[str, float] = {}
    where = "" if len(head[FORCE]) == len(base.get(FORCE, ())) else f" at the {KEPT} ticks that the baseline keeps"
    for name in (name for name in head if name in base):
        one, other = (values[kept_ticks(len(values))] if where else values for values in (head[name], base[name]))
        apart[name] = float(np.nan_to_num(np.linalg.norm(one - other, axis=1), nan=np.inf).max(initial=0.0))
    if not apart:
        return "by how much is not known, since the baseline keeps no poses", False
    force, place = apart.pop(FORCE, 0.0), max(apart, key=lambda name: apart[name])
    told = [f"{place} by up to {1e3 * apart[place]:.3g} mm"] if apart[place] > SAME_POSE["m"] else []
    told += [f"{FORCE} by up to {force:.3g} N"] if force > SAME_POSE["N"] else []
    # Else it may be elsewhere: in a turn, in a knuckle, in the force of a phalanx, or between the kept ticks.
    rounding = not told and not where and apart[place] > 0.0
    same = "by rounding alone" if rounding else f"palm, fingertips and {FORCE} are the same"
    return f"{', '.join(told) or same}{where}", rounding


OF_THE_SCENE = ("level", "max_error", "rate", "samples", "seed", "ticks", "tremor_mm_deg", "hand_file")
"""Options of the scene that are named; the level where it is not the object's own."""
USUAL_SCENE: dict[str, Any] = {"rate": 1000.0, "samples": "interpolate", "seed": 0}
"""Defaults of a scene; the level's default depends on the object."""


def unusual_options(scene: Mapping[str, Any]) -> dict[str, Any]:
    """Return the options of a scene by name that are not usual, in order; of the stiffness as `stiffness.name`."""
    solver = dict(scene.get("solver", {}))
    usual_scene = {**USUAL_SCENE, "level": usual_level(str(scene.get("object") or ""))}
    stated = {name: scene[name] for name in OF_THE_SCENE if scene.get(name) is not None}
    found = {name: value for name, value in stated.items() if usual_scene.get(name) != value}
    usual = _usual_solver(solver, float(scene.get("rate") or USUAL_SCENE["rate"]))
    told = {name: value for name, value in _flat(solver).items() if value != usual.get(name)}
    return found | {name: value for name, value in told.items() if name not in ("method", "surface", "period")}


def _usual_solver(solver: Mapping[str, Any], rate: float) -> dict[str, Any]:
    try:
        method, surface = str(solver.get("method", "coupled")), str(solver.get("surface", "spheres"))
        # A class from outside has the usual defaults: to read a result imports no code that it names.
        options = SolverOptions(method="coupled" if names_code(method) else method, surface=surface)
    except HhsimError:
        # The method is not installed here, or unknown: the defaults of the others.
        options = SolverOptions()
    found = options.at_rate(rate).to_json()
    return _flat({**found, "fingers": list(found["fingers"]), "stiffness": dict(vars(Stiffness()))})


def _flat(options: Mapping[str, Any]) -> dict[str, Any]:
    stiffness = options.get("stiffness", {})
    rest = {name: value for name, value in options.items() if name != "stiffness"}
    return rest | {f"stiffness.{name}": value for name, value in stiffness.items()}
