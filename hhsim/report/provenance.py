"""Facts of a result for the tables of a report: what was run, on what, and where it comes from."""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hhsim.errors import InputError
from hhsim.hand.fingers import FINGERS
from hhsim.metrics.session_faults import how_it_ended
from hhsim.replay.stored_scene import PARTS
from hhsim.result.reader import Result
from hhsim.result.schema import is_one_of_two
from hhsim.result.wording import commit, motion_name, object_name
from hhsim.system.counted import counted
from hhsim.system.input_file import open_input

NONE = "—"
"""Stands for what a result does not say."""

AS_GIVEN = "as the motion has it"
DRIVEN = "moves as the motion has it; figures and pictures are seen from it"
FORCES = {"kkt": "multipliers of the program (kkt)", "paper": "Eq. 14 of the paper"}
COUPLING = {"translation": "N/m", "rotation": "N·m/rad", "flexion": "N·m/rad"}


def run_facts(result: Result) -> dict[str, str]:
    """Return object, motion, hand and method."""
    scene, static = result.scene, result.static
    solver: Mapping[str, Any] = scene.get("solver", {})
    low, high = static["object/vertices"].min(axis=0), static["object/vertices"].max(axis=0)
    extent = " × ".join(f"{1e3 * side:.0f}" for side in high - low)
    level = static["object/tree/level"]
    depth = int(level.max(initial=0))
    hand = scene.get("hand") or {"side": NONE}
    side, fingers = str(hand.get("side", "")), result.fingers
    stiffness = solver.get("stiffness", {})
    coupling = [f"{name} {stiffness[name]:g} {unit}" for name, unit in COUPLING.items() if name in stiffness]
    facts = {
        "object": object_name(result),
        "object, extent": f"{extent} mm, {counted(len(static['object/faces']), 'triangle')}",
        "repairs of its mesh": "; ".join(scene.get("object_repairs") or []) or "none",
        "sphere tree": f"level {depth}, {counted(int((level == depth).sum()), 'leaf sphere')}",
        "what the hand touches": f"the {result.surface}",
        "motion": motion_name(result),
        "its source": str(scene.get("motion_source") or NONE),
        "the object's place": str(
            (scene.get("placement") or {}).get("text") or (DRIVEN if result.driven else AS_GIVEN)
        ),
        "ticks": f"{result.ticks:,} at {result.rate:,g} Hz, {result.ticks / result.rate:,.2f} s",
        "hand": f"{side}, {1e3 * hand['length']:.0f} mm long" if "length" in hand else side,
        "fingers": "all five" if len(fingers) == len(FINGERS) else ", ".join(fingers) or "none",
        "method": str(solver.get("method", NONE)),
        "QP solver": str(solver.get("qp", NONE)),
        "forces": FORCES.get(str(solver.get("force")), NONE),
        "linearisations of a tick, most": f"{solver.get('linearisations', NONE)}",
        "margin": f"{1e3 * solver['margin']:g} mm" if "margin" in solver else NONE,
        "coupling": ", ".join(coupling) or NONE,
        "not modelled": ", ".join(scene.get("modelled", {}).get("not_modelled", [])) or NONE,
    }
    if result.live is not None:
        facts |= _session(result, result.live)
    return facts


def machine_facts(result: Result) -> dict[str, str]:
    """Return machine and versions."""
    machine = {str(name): str(value) for name, value in result.machine.items()}
    packages = ", ".join(f"{name} {version}" for name, version in sorted(result.packages.items()))
    return {
        "processor": machine.get("cpu", NONE),
        "cores": machine.get("cores", NONE),
        "system": machine.get("system", NONE),
        "Python": machine.get("python", NONE),
        "threads of a tick": str(result.scene.get("solver", {}).get("threads", NONE)),
        "hhsim": result.hhsim_version,
        "commit": commit(result),
        "packages": packages or NONE,
    }


def origin_facts(result: Result) -> dict[str, str]:
    """Return the file, its state and its checksums."""
    stated: Mapping[str, Any] = result.scene.get("checksums", {})
    return {
        "file": result.path.name,
        "SHA-256 of the file": file_digest(result.path),
        "written": result.created_utc,
        "complete": "yes" if result.complete else "no: the run was stopped, its ticks so far are sound",
        "schema": f"{result.schema_version}",
        "object's mesh as it was read": str(result.scene.get("object_mesh") or NONE),
        **{f"SHA-256 of {what}": str(stated[part]) for part, what in PARTS.items() if part in stated},
    }


def option_facts(result: Result) -> dict[str, str]:
    """Return every option of the solver as it stands in the file."""
    solver = result.scene.get("solver", {})
    return {name: json.dumps(value, ensure_ascii=False) for name, value in sorted(solver.items())}


def file_digest(path: Path) -> str:
    """Return the SHA-256 of a file in hexadecimal digits; raise InputError if it cannot be read."""
    try:
        with open_input(path.parent if is_one_of_two(path) else path) as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}") from error


def _session(result: Result, live: Mapping[str, Any]) -> dict[str, str]:
    from hhsim.live.real_time import described

    device = _json(live.get("device"))
    mode = _json(live.get("real_time"))
    try:
        real_time = described(mode) if mode else NONE
    except (KeyError, TypeError, ValueError):
        real_time = "damaged"
    return {
        "glove": str(device.get("name") or device.get("kind") or NONE),
        "palm's pose from": str(live.get("pose") or NONE),
        "glove was told": "nothing (dry run)" if live.get("dry_run") else "where to stop and how hard",
        "real time": real_time,
        "refused by the system": "; ".join(mode.get("refused", [])) or "nothing",
        "ended": how_it_ended(result),
    }


def _json(text: Any) -> dict[str, Any]:
    try:
        found = json.loads(text or "{}")
    except (TypeError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}
