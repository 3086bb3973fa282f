"""Table of the datasets, attributes and labels that each claim judges; what none does is named in the verdict."""

from collections.abc import Iterator, Mapping, Sequence
from fnmatch import fnmatchcase
from functools import cache
from typing import Any

import h5py

from hhsim.hand.model import SIDES
from hhsim.result import schema
from hhsim.result.reader import Result
from hhsim.system.hdf5_input import open_hdf5
from hhsim.verify.claim import FAILS, HOLDS, NOT_CLAIMED, NOT_JUDGED, Claim, all_true

JUDGES: dict[str, str] = {
    "": "hand/live/[se]*@* phase/*@* tick/frame/*@* hand/skin/* "
    "summary@tracking_excess summary@force_variation_tremor* summary@free_off_max",
    "columns": "*@units *@long_name",
    "time": "tick/time scene.rate scene.solver.period",
    "between hands": "tick/between/*",
    "body poses": "tick/frame/* body/tick/position body/tick/orientation",
    "phases": "phase/*",
    "contact rows": "contact/tick contact/[ab] contact/normal",
    "hand on object": "contact/[ab] contact/point contact/normal_force contact/friction_force contact/torsional_moment "
    "body/tick/hand_wrench",
    "hands on bodies": "body/tick/hand_wrench",
    "torsion": "contact/torsional_moment body.torsion",
    "slip": "contact/slip",
    "sticks": "contact/sticks",
    "input": "hand/tick/input_seq",
    "status": "hand/tick/status",
    "lag": "hand/tick/lag",
    "abduction": "hand/tick/haptic/abduction",
    "fingertips": "hand/tick/haptic/flexion hand/tick/force/fingertip_normal scene.solver.stiffness.contact",
    "stationarity": "hand/tick/haptic/flexion scene.solver.stiffness.flexion scene.solver.surface",
    "hand's balance": "hand/tick/haptic/flexion hand/tick/force/phalanx hand/tick/force/total "
    "scene.solver.stiffness.flexion",
    "free hand": "hand/tick/haptic/flexion",
    "palm wrench": "hand/tick/haptic/position hand/tick/haptic/orientation hand/tick/force/palm_wrench "
    "scene.solver.stiffness.translation scene.solver.stiffness.rotation",
    "kinematics": "hand/tick/graphic/*",
    "depth": "hand/tick/penetration_* scene.solver.surface",
    "complementarity": "scene.solver.surface",
    "force balance": "hand/tick/force/phalanx hand/tick/force/total scene.solver.force",
    "Eq. 14": "hand/tick/force/phalanx hand/tick/force/total scene.solver.force",
    "force variation": "hand/tick/force_variation_rate hand/tick/force/total",
    "finger variation": "hand/tick/force_variation_finger hand/tick/force/phalanx",
    "durations": "hand/tick/duration/* scene.solver.method",
    "touching pairs": "hand/tick/contacts/touching",
    "candidates": "hand/tick/contacts/candidates hand/tick/work/bodies scene.solver.margin",
    "work": "hand/tick/work/[!b]* scene.solver.linearisations",
    "hand": "hand/palm_* hand/base hand/d* hand/phalanx_* hand/flexion_* hand/abduction_* "
    "scene.hand_file scene.hand.[!p]*",
    "palm": "hand/palm_*",
    "checksums": "hand/palm_* hand/base hand/d* hand/phalanx_* hand/flexion_* hand/abduction_* "
    "body/mesh/* body/tree/* body/position body/orientation scene.checksums.*",
    "records": "hand/live/*/record hand/live@lost_*",
    "missed periods": "hand/live/tick/period hand/live/tick/missed",
    "deadlines": "hand/live/tick/deadline",
    "early ticks": "hand/live/tick/early",
    "wake-up": "hand/live/tick/wakeup hand/live/tick/at_once",
    "latency": "hand/live/tick/latency",
    "causes of missed periods": "hand/live/tick/cause hand/live/tick/taken/*",
    "reasons": "hand/live/tick/safety hand/live@dry_run",
    "command bounds": "hand/live/tick/command_bend hand/live@limits",
    "stiffness": "hand/live/tick/command_stiffness",
    "samples": "hand/live/sample/seq hand/live/sample/time hand/live/sample/handed hand/live/sample/good",
    "fingers of the sample": "hand/live/sample/flexion hand/live/sample/abduction",
    "end": "hand/live@ended",
    "counters": "hand/live@counters",
    "object velocity": "body/tick/velocity body/tick/position body/tick/orientation",
    "object angular": "body/tick/angular_velocity",
    "table on object": "body/tick/table_wrench contact/point contact/normal_force contact/friction_force",
    "between bodies": "body/tick/body_wrench",
    "table": "body/tick/table_distance body.table",
    "balanced": "body/tick/friction_residual",
    "joints": "body/tick/joint body.joint* body/tick/position body/tick/orientation",
    "driven": "body/tick/recorded_*",
    "Newton": "body.mass body.damping body.velocity",
    "Euler": "body.angular_velocity",
    "solid": "body.center body.inertia* body.gravity*",
    "friction cones": "body.friction body.table_friction contact/normal_force contact/friction_force",
    "sliding": "body.torsion",
    "hinge": "body.hinge* body.angular_velocity",
    "slider": "body.slider*",
    "joint": "body.hinge* body.slider*",
    "bodies as declared": "body.friction body.torsion body.table_friction body.hinge* body.slider* body.joint* "
    "body.mass body.damping body.velocity scene.object scene.object_mesh",
    "complete": "@complete",
    "input depth": "summary@input_depth_max",
    "correction": "summary@correction_*",
    "contacts off the mesh": "summary@contact_error_max",
    "depth in itself": "summary@self_depth_*",
    "summary": "summary@*",
    "session figures": "summary@*",
    "scene": "body@kind scene.ticks scene.hand.palm_spheres scene.modelled.* scene.object_spheres scene.hands_apart "
    "scene.friction_law scene.tree_options.level scene.solver.fingers scene.solver.self_contact",
    "object": "scene.object scene.object_mesh",
    "tree": "scene.tree_options.[!l]*",
    "carried": "scene.object_pose body/tick/position body/tick/orientation",
    "motion": "scene.samples",
    "again: motion": "scene.trajectory scene.seed",
}
"""Items of a file that each claim judges, as patterns; an item that none judges is named.

Hands and bodies have no names here: hand/tick/lag. An attribute is GROUP@NAME, a label of the scene scene.NAME, one of
a body body.NAME. Nothing judges the items of the first line, whatever else they match.
"""
READ_AT_LOADING = ("@format", "@schema_version", "bodies@names", "contact@names", "@scene", "hand@scene")
"""Items without which, or with other values, a file is refused, or whose labels are items of their own."""
PHASES = ("name", "first_tick", "last_tick")
SCENE, PROPERTIES = "scene", "properties"


def items(result: Result) -> set[str]:
    """Return the datasets, attributes and labels of a hand's result, as of `JUDGES`."""
    with open_hdf5(result.path) as file:
        found = {f"@{name}" for name in file.attrs}
        file.visititems(lambda path, item: found.update(_of_item(result, path, item)))
    found |= {f"{SCENE}.{label}" for label in _labels(result.scene)}
    for body in result.bodies.values():
        found |= {f"body.{label}" for label in _labels(body.properties)}
    return found - set(READ_AT_LOADING)


def _of_item(result: Result, path: str, item: Any) -> Iterator[str]:
    top, _, rest = path.partition("/")
    own, _, rest = rest.partition("/")
    whose = {schema.HANDS: "hand", schema.BODIES: "body"}.get(top)
    if own and own in set(SIDES) - {result.name} and top in (schema.HANDS, schema.SUMMARY):
        return
    name = f"{whose}/{rest}".rstrip("/") if whose and own else top if top == schema.SUMMARY else path
    if isinstance(item, h5py.Dataset):
        yield name
    for attribute in item.attrs:
        if attribute != PROPERTIES:
            yield f"{name}@{attribute}"


def _labels(stated: Mapping[str, Any]) -> Iterator[str]:
    for name, value in stated.items():
        if isinstance(value, Mapping) and value:
            yield from (f"{name}.{label}" for label in _labels(value))
        else:
            yield name


@cache
def judges(item: str) -> frozenset[str]:
    """Return the names of the claims that may judge an item."""
    found = {claim for claim, patterns in JUDGES.items() if any(fnmatchcase(item, of) for of in patterns.split())}
    own = found - {"summary", "session figures"}
    return frozenset() if "" in found else frozenset(own or found)


def unjudged_claim(result: Result, claims: Sequence[Claim]) -> Claim:
    """Name the items of a file that none of these claims judges."""
    made = {claim.name for claim in claims if claim.verdict in (HOLDS, FAILS, NOT_CLAIMED)}
    rest = sorted(item for item in items(result) if not made & judges(item))
    return Claim("unjudged", "datasets, attributes and labels that no claim is of", NOT_JUDGED, note=", ".join(rest))


def columns_claim(result: Result) -> Claim:
    """Judge that each dataset of the file is a known one, with the unit and the description of its name."""
    known: dict[str, schema.Column | None] = dict.fromkeys(f"phase/{name}" for name in PHASES)
    for side in SIDES:
        groups = {
            "": schema.HAND_STATIC,
            "tick/": schema.hand_columns(),
            "skin/": schema.SKIN_COLUMNS,
            f"{schema.LIVE_TICK}/": schema.LIVE_TICK_COLUMNS,
            f"{schema.LIVE_SAMPLE}/": schema.sample_columns(0),
            f"{schema.LIVE_EVENT}/": schema.EVENT_COLUMNS,
        }
        known |= {f"hands/{side}/{of}{one.name}": one for of, columns in groups.items() for one in columns}
    for body in result.bodies:
        known |= {f"bodies/{body}/{column.name}": column for column in schema.BODY_STATIC}
        known |= {f"bodies/{body}/tick/{column.name}": column for column in schema.BODY_COLUMNS}
    known |= {f"contact/{column.name}": column for column in schema.CONTACT_COLUMNS}
    known |= {f"tick/{column.name}": column for column in (schema.TIME, *schema.BETWEEN_COLUMNS)}
    known |= {f"{schema.FRAME}/{column.name}": None for column in schema.POSE_COLUMNS}
    with open_hdf5(result.path) as file:
        found: dict[str, h5py.Dataset] = {}
        file.visititems(lambda path, item: found.update({path: item} if isinstance(item, h5py.Dataset) else {}))
        wrong = {
            path: path not in known
            or (
                (column := known[path]) is not None
                and (item.attrs.get("units"), item.attrs.get("long_name")) != (column.units, column.long_name)
            )
            for path, item in found.items()
        }
    note = ", ".join(path for path, differs in wrong.items() if differs)
    says = "each dataset is a known one, with the unit and the description of its name"
    return all_true("columns", says, [*wrong.values()], note=note)
