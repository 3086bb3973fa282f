"""Inputs of a run, to compare runs of different machines; a digest of its poses and forces; its unusual options.

Meshes are compared by hash. Trees, hands and motions come from optimisations whose last bits, and the order of equal
sibling spheres, differ between processors: they are compared by sums with a tolerance, of trees in any order.
"""

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hhsim.result.body import Body
from hhsim.result.reader import Result
from hhsim.result.schema import BODIES
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
    return RunInputs(
        schema=result.schema_version,
        mesh=str(scene.get("object_mesh") or scene["checksums"][f"{BODIES}/{result.body.name}"]),
        ticks=result.ticks,
        spheres=int(scene["object_spheres"]),
        options=options,
        solver=_solver_options(scene),
        tree=tuple(value for body in result.bodies.values() for value in _moments(body)),
        hand=_sums(result.static[name] for name in HAND),
        motion=_sums(result[name] for name in MOTION),
    )


def differences(base: RunInputs, head: RunInputs) -> list[str]:
    """Differences between two runs' inputs, a few words each; empty where they can be compared."""
    return list(named_differences(base, head).values())


def named_differences(base: RunInputs, head: RunInputs) -> dict[str, str]:
    """Differences between two runs' inputs, a few words each, by the name of what differs."""
    counts = {"schema": "result schema", "ticks": "number of ticks", "spheres": "spheres of the tree"}
    pairs = {what: (getattr(base, name), getattr(head, name)) for name, what in counts.items()}
    pairs["object mesh"] = f"{base.mesh[:12]}…", f"{head.mesh[:12]}…"
    for one, other in ((base.options, head.options), (base.solver, head.solver)):
        # Options that only one of them has came or went between two versions.
        pairs |= {name: (one[name], other[name]) for name in sorted(one.keys() & other.keys())}
    found = {name: f"{name}: {one} and {other}" for name, (one, other) in pairs.items() if _plain(one) != _plain(other)}
    sums = {"sphere tree": (base.tree, head.tree), "hand": (base.hand, head.hand)}
    sums["trajectory"] = base.motion, head.motion
    return found | {
        name: name
        for name, (one, other) in sums.items()
        if len(one) != len(other) or not (np.abs(np.subtract(one, other)) <= TOLERANCE).all()
    }


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


OF_THE_SCENE = ("level", "max_error", "rate", "samples", "seed", "ticks", "tremor_mm_deg", "hand_file")
"""Options of the scene that tell runs apart."""


def named_options(scene: Mapping[str, Any]) -> dict[str, Any]:
    """Return the options of a run by name, in order: of its scene, and of its solver."""
    return {name: scene.get(name) for name in OF_THE_SCENE} | _solver_options(scene)


def _solver_options(scene: Mapping[str, Any]) -> dict[str, Any]:
    """Return the options of a run's solver by name; those of the stiffness as `stiffness.name`."""
    found: dict[str, Any] = {}
    for name, value in scene["solver"].items():
        found |= {f"{name}.{key}": v for key, v in value.items()} if isinstance(value, dict) else {name: value}
    return found
