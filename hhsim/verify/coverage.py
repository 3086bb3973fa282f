"""What each claim judges: datasets, attributes and labels of a result; what none does is named in the verdict."""

from collections.abc import Iterator, Mapping, Sequence
from fnmatch import fnmatchcase
from typing import Any

import h5py

from hhsim.result import schema
from hhsim.result.reader import Result
from hhsim.system.hdf5_input import open_hdf5
from hhsim.verify.claim import FAILS, HOLDS, NOT_CLAIMED, NOT_JUDGED, Claim, all_true

JUDGED_BY: dict[str, str] = {
    "hand/live/[se]*@*": "",
    "phase/*@*": "",
    "tick/frame/*@*": "",
    "*@units": "columns",
    "*@long_name": "columns",
    "tick/time": "time",
    "tick/between/*": "between hands",
    "tick/frame/*": "body poses",
    "phase/*": "phases",
    "contact/tick": "contact rows",
    "contact/a": "hand on object, contact rows",
    "contact/b": "hand on object, contact rows",
    "contact/point": "hand on object",
    "contact/normal": "contact rows",
    "contact/normal_force": "hand on object",
    "contact/friction_force": "hand on object",
    "contact/torsional_moment": "hand on object, torsion",
    "contact/slip": "slip",
    "contact/sticks": "sticks",
    "hand/tick/input_seq": "input",
    "hand/tick/status": "status",
    "hand/tick/lag": "lag",
    "hand/tick/haptic/abduction": "abduction",
    "hand/tick/haptic/flexion": "fingertips, stationarity, hand's balance, free hand",
    "hand/tick/haptic/*": "palm wrench",
    "hand/tick/graphic/*": "kinematics",
    "hand/tick/penetration_*": "depth",
    "hand/tick/force/palm_wrench": "palm wrench",
    "hand/tick/force/fingertip_normal": "fingertips",
    "hand/tick/force/*": "force balance, hand's balance, Eq. 14",
    "hand/tick/force_variation_rate": "force variation",
    "hand/tick/force_variation_finger": "finger variation",
    "hand/tick/duration/*": "durations",
    "hand/tick/contacts/touching": "touching pairs",
    "hand/tick/contacts/candidates": "candidates",
    "hand/tick/work/bodies": "candidates",
    "hand/tick/work/*": "work",
    "hand/palm_*": "palm, checksums",
    "hand/live/tick/record": "records",
    "hand/live/tick/period": "missed periods",
    "hand/live/tick/deadline": "deadlines",
    "hand/live/tick/early": "early ticks",
    "hand/live/tick/wakeup": "wake-up",
    "hand/live/tick/at_once": "wake-up",
    "hand/live/tick/latency": "latency",
    "hand/live/tick/missed": "missed periods",
    "hand/live/tick/cause": "causes of missed periods",
    "hand/live/tick/taken/*": "causes of missed periods",
    "hand/live/tick/safety": "reasons",
    "hand/live/tick/command_bend": "command bounds",
    "hand/live/tick/command_stiffness": "stiffness",
    "hand/live/sample/record": "records",
    "hand/live/sample/seq": "samples",
    "hand/live/sample/time": "samples",
    "hand/live/sample/handed": "samples",
    "hand/live/sample/good": "samples",
    "hand/live/sample/flexion": "fingers of the sample",
    "hand/live/sample/abduction": "fingers of the sample",
    "hand/live@lost_*": "records",
    "hand/live@ended": "end",
    "hand/live@counters": "counters",
    "hand/live@limits": "command bounds",
    "hand/live@dry_run": "reasons",
    "hand/skin/*": "",
    "hand/live/*": "",
    "hand/*": "hand, checksums",
    "body/mesh/*": "checksums",
    "body/tree/*": "checksums",
    "body/position": "checksums",
    "body/orientation": "checksums",
    "body/tick/position": "body poses",
    "body/tick/orientation": "body poses",
    "body/tick/velocity": "object velocity",
    "body/tick/angular_velocity": "object angular",
    "body/tick/hand_wrench": "hand on object, hands on bodies",
    "body/tick/table_wrench": "table on object",
    "body/tick/body_wrench": "between bodies",
    "body/tick/table_distance": "table",
    "body/tick/friction_residual": "balanced",
    "body/tick/joint": "joints",
    "body/tick/recorded_*": "driven",
    "body@kind": "scene",
    "body.mass": "Newton",
    "body.center": "solid",
    "body.inertia*": "solid",
    "body.gravity*": "solid",
    "body.damping": "Newton",
    "body.velocity": "Newton",
    "body.angular_velocity": "Euler, hinge",
    "body.friction": "friction cones, bodies as declared",
    "body.torsion": "torsion, bodies as declared",
    "body.table": "table",
    "body.table_friction": "friction cones, bodies as declared",
    "body.hinge*": "hinge, joint, bodies as declared",
    "body.slider*": "slider, joint, bodies as declared",
    "body.joint*": "joints, bodies as declared",
    "@complete": "complete",
    "summary@*": "summary, session figures",
    "scene.rate": "time",
    "scene.ticks": "scene",
    "scene.hand_file": "hand",
    "scene.hand.palm_spheres": "scene",
    "scene.hand.*": "hand",
    "scene.checksums.*": "checksums",
    "scene.modelled.*": "scene",
    "scene.object_spheres": "scene",
    "scene.hands_apart": "scene",
    "scene.friction_law": "scene",
    "scene.object": "object, bodies as declared",
    "scene.object_mesh": "object, bodies as declared",
    "scene.object_pose": "carried",
    "scene.samples": "motion",
    "scene.trajectory": "again: motion",
    "scene.seed": "again: motion",
    "scene.tree_options.level": "scene",
    "scene.tree_options.*": "tree",
    "scene.solver.method": "durations",
    "scene.solver.surface": "depth",
    "scene.solver.force": "force balance, Eq. 14",
    "scene.solver.fingers": "scene",
    "scene.solver.margin": "candidates",
    "scene.solver.touch": "touching pairs",
    "scene.solver.period": "time",
    "scene.solver.self_contact": "scene",
    "scene.solver.stiffness.translation": "palm wrench",
    "scene.solver.stiffness.rotation": "palm wrench",
    "scene.solver.stiffness.contact": "fingertips",
    "scene.solver.stiffness.flexion": "stationarity, hand's balance",
    "scene.solver.linearisations": "work",
}
"""Claims of each item of a file, the first pattern that it matches; one that none of them judges is named.

Hands and bodies have no names here: hand/tick/lag. An attribute is GROUP@NAME, a label of the scene scene.NAME, one of
a body body.NAME.
"""
READ_AT_LOADING = ("@format", "@schema_version", "bodies@names", "contact@names", "@scene", "hand@scene")
"""Items without which, or with other values, a file is refused, or whose labels are items of their own."""
SCENE, PROPERTIES = "scene", "properties"


def items(result: Result) -> set[str]:
    """Return the datasets, attributes and labels of a hand's result, as of `JUDGED_BY`."""
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
    if own and own in set(schema.SIDES) - {result.name} and top in (schema.HANDS, schema.SUMMARY):
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


def judges(item: str) -> frozenset[str]:
    """Return the names of the claims that may judge an item."""
    found = next((claims for pattern, claims in JUDGED_BY.items() if fnmatchcase(item, pattern)), "")
    return frozenset(found.split(", ")) - {""}


def unjudged_claim(result: Result, claims: Sequence[Claim]) -> Claim:
    """Name the items of a file that none of these claims judges."""
    made = {claim.name for claim in claims if claim.verdict in (HOLDS, FAILS, NOT_CLAIMED)}
    rest = sorted(item for item in items(result) if not made & judges(item))
    return Claim("unjudged", "datasets, attributes and labels that no claim is of", NOT_JUDGED, note=", ".join(rest))


def columns_claim(result: Result) -> Claim:
    """Judge units and description of each dataset of the file."""
    known = {f"hands/{result.name}/{column.name}": column for column in schema.HAND_STATIC}
    known |= {f"hands/{result.name}/tick/{column.name}": column for column in schema.hand_columns()}
    known |= {f"hands/{result.name}/{schema.LIVE_TICK}/{column.name}": column for column in schema.LIVE_TICK_COLUMNS}
    for body in result.bodies:
        known |= {f"bodies/{body}/{column.name}": column for column in schema.BODY_STATIC}
        known |= {f"bodies/{body}/tick/{column.name}": column for column in schema.BODY_COLUMNS}
    known |= {f"contact/{column.name}": column for column in schema.CONTACT_COLUMNS}
    known |= {f"tick/{column.name}": column for column in (schema.TIME, *schema.BETWEEN_COLUMNS)}
    with open_hdf5(result.path) as file:
        wrong = {
            path: (item.attrs.get("units"), item.attrs.get("long_name")) != (column.units, column.long_name)
            for path, column in known.items()
            if isinstance(item := file.get(path), h5py.Dataset)
        }
    note = ", ".join(path for path, differs in wrong.items() if differs)
    return all_true(
        "columns", "each dataset has the unit and the description of its name", [*wrong.values()], note=note
    )
