"""The commands that belong to a result: the one that made it, and those that look at it again."""

import math
import shlex
from collections.abc import Mapping
from typing import Any

from hhsim.hand.fingers import FINGERS
from hhsim.replay.stored_scene import WHOLE_SINCE
from hhsim.result.reader import Result
from hhsim.solver.method import METHODS
from hhsim.solver.options import SolverOptions, Stiffness

RATE = 1000.0
"""Ticks per second of a replay that is told none [Hz]."""


def command_of(result: Result) -> str:
    """The command that makes such a result again; "" where the library was called by another program.

    Of a session it is the one that was typed. Of a replay it is made from the options in the file: those that are not
    the usual ones, and the tree level in any case.
    """
    if result.live is not None:
        return shlex.join(_typed(str(result.live.get("command", ""))))
    scene = result.scene
    if not (scene.get("object") and scene.get("trajectory")):
        return ""
    words = ["hhsim", "replay", str(scene["object"]), str(scene["trajectory"])]
    for option, value in _options(scene).items():
        words += [option, value]
    return shlex.join(words)


def looking_again(result: Result) -> list[str]:
    """Commands that show a result, check it, and run it again."""
    name = shlex.quote(result.path.name)
    commands = [f"hhsim view {name}"]
    if result.schema_version >= WHOLE_SINCE:
        commands += [f"hhsim verify {name}", f"hhsim replay {name}"]
    return commands


def _typed(text: str) -> list[str]:
    import json

    try:
        words = json.loads(text)
    except ValueError:
        return []
    return [str(word) for word in words] if isinstance(words, list) else []


def _options(scene: Mapping[str, Any]) -> dict[str, str]:
    """Options of `hhsim replay` that are not the usual ones."""
    solver: Mapping[str, Any] = scene.get("solver", {})
    method = str(solver.get("method", "coupled"))
    usual = {**{name: getattr(SolverOptions(), name) for name in ("qp", "tolerance", "frustum_ends", "threads")}}
    usual |= {"budget": None, **METHODS[method].defaults}
    found: dict[str, str] = {}

    def tell(option: str, value: Any, default: Any = None) -> None:
        if value is not None and value != default:
            found[option] = f"{value:.12g}" if isinstance(value, float) else str(value)

    def of_solver(option: str, name: str, scale: float = 1.0) -> None:
        value = solver.get(name, usual[name])
        if value != usual[name] and value is not None:
            tell(option, scale * value if isinstance(value, float) else value)

    tell("--method", method, "coupled")
    of_solver("--qp", "qp")
    of_solver("--force", "force")
    if scene.get("tree"):
        tell("--tree", scene["tree"])
    elif scene.get("max_error") is not None:
        found["--level"], found["--max-error"] = "auto", f"{1e3 * scene['max_error']:.12g}mm"
    else:
        tell("--level", scene.get("level"))
    fingers = [finger for finger in FINGERS if finger in solver.get("fingers", FINGERS)]
    tell("--fingers", ",".join(fingers), ",".join(FINGERS))
    tell("--rate", scene.get("rate"), RATE)
    tell("--samples", scene.get("samples"), "interpolate")
    tell("--place-object", scene.get("place_object"), "recorded")
    tell("--hand", scene.get("hand", {}).get("side"), "right")
    tell("--hand-file", scene.get("hand_file"))
    coupling, default = solver.get("stiffness", {}), Stiffness()
    names = ("translation", "rotation", "flexion")
    values = [coupling.get(name, getattr(default, name)) for name in names]
    if values != [getattr(default, name) for name in names]:
        found["--stiffness"] = ",".join(f"{value:.12g}" for value in values)
    if method == "penalty":
        tell("--penalty-stiffness", coupling.get("penalty"), default.penalty)
    of_solver("--margin", "margin", 1e3)
    of_solver("--linearisations", "linearisations")
    of_solver("--budget", "budget")
    of_solver("--tolerance", "tolerance")
    of_solver("--frustum-ends", "frustum_ends")
    of_solver("--threads", "threads")
    tremor = scene.get("tremor_mm_deg")
    if tremor and all(math.isfinite(value) for value in tremor):
        found["--tremor"] = ",".join(f"{value:.12g}" for value in tremor)
    tell("--unit", scene.get("unit"))
    tell("--size", scene.get("size_mm"))
    tell("--thickness", scene.get("thickness_mm"))
    tell("--seed", scene.get("seed"), 0)
    return found
