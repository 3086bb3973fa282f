"""Options of a run that are not usual for its object, its method and its surface: what names it among others."""

from collections.abc import Mapping
from typing import Any

from hhsim.errors import HhsimError
from hhsim.mesh.catalogue import usual_level
from hhsim.solver.known_methods import names_code
from hhsim.solver.options import SolverOptions, Stiffness

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
