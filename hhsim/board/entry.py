"""One run on the board: scene, method, machine and figures."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from hhsim.errors import HhsimError
from hhsim.mesh.catalogue import usual_level
from hhsim.metrics.run.registry import run_metrics
from hhsim.replay.summary_table import stored_rows
from hhsim.replay.verdict import verdict
from hhsim.result.reader import Result
from hhsim.result.wording import motion_name, object_name
from hhsim.solver.options import SolverOptions, Stiffness
from hhsim.sweep.plan import BOTH, USUAL_SCENE

TOLD = ("level", "max_error", "rate", "samples", "seed", "ticks", "tremor_mm_deg", "hand_file")
"""Options of the scene that are named; the level where it is not the object's own."""


@dataclass(frozen=True)
class Entry:
    """One run."""

    object: str
    motion: str
    method: str
    surface: str
    options: str  # options that are not the usual ones, in words; "" where all are
    machine: str  # processor, cores, system and Python, as JSON: times compare within a machine
    hhsim: str = ""  # version and commit
    created: str = ""  # time, UTC
    own_core: bool = False  # True if its ticks had a core of their own: else its times say little
    verdict: str = ""  # word of the verdict; "failed" where there is no result
    # SI or %, by the names of `hhsim.metrics.run.registry.run_metrics`; times are means over the runs.
    figures: Mapping[str, float] = field(default_factory=dict)
    # Standard deviation of times over several runs, by the same names.
    deviations: Mapping[str, float] = field(default_factory=dict)
    option_set: str = ""  # name of a sweep's set of options; "" of any other result
    runs: int = 1  # number of runs of the same cell, or by `hhsim replay --repeat`
    source: str = ""
    reason: str = ""  # why it failed, or ""

    @property
    def scene(self) -> tuple[str, str]:
        """Object and motion."""
        return self.object, self.motion

    @property
    def key(self) -> tuple[str, str, str, str, str]:
        """Identity of a run, apart from its machine."""
        return self.object, self.motion, self.method, self.surface, self.options

    @property
    def option_sets(self) -> list[str]:
        """Names of its set of options."""
        return self.option_set.split(BOTH) if self.option_set else []


FAILED = "failed"


def shown_options(name: str, options: str) -> str:
    """Return the name of a set of options, and what is not usual in it."""
    return ": ".join(part for part in (name, options) if part) or "usual"


def entry_of_row(row: Mapping[str, Any], source: Path) -> Entry:
    """Return the entry of a sweep's cell, done or failed."""
    cell = row["cell"]
    common = {name: cell[name] for name in ("object", "motion", "method", "surface")}
    common |= {"machine": json.dumps(row.get("machine", {}), sort_keys=True), "source": str(source)}
    if "summary" not in row:
        options = "" if cell["options"] == "usual" else str(cell["options"])
        return Entry(**common, options=options, verdict=FAILED, reason=str(row.get("reason", "")))
    return Entry(
        **common,
        options=option_words(row["scene"]),
        option_set=str(cell["options"]),
        hhsim=_hhsim(row.get("hhsim_version"), row.get("git_revision"), row.get("git_dirty")),
        created=str(row.get("created_utc", "")),
        own_core=bool(row.get("own_core")),
        verdict=str(row.get("verdict", "")),
        **_figures(row["summary"], row.get("repeated", {})),
    )


def entry_of_result(result: Result) -> Entry:
    """Return the entry of a single replay, a session, or a submission, by the name that it has."""
    submitter = result.scene.get("submission")
    if isinstance(submitter, Mapping):
        submitter = submitter.get("name") or submitter.get("method") or result.path.stem
    return Entry(
        object=object_name(result),
        motion=motion_name(result),
        method=str(submitter or result.method),
        surface=result.surface,
        options=option_words(result.scene),
        machine=json.dumps(result.machine, sort_keys=True),
        hhsim=_hhsim(result.hhsim_version, result.git_revision, result.git_dirty),
        created=result.created_utc,
        verdict=verdict(result, stored_rows(result.summary, result.rate)).word,
        **_figures(result.summary, result.repeated),
        source=str(result.path),
    )


def option_words(scene: Mapping[str, Any]) -> str:
    """Return the options of a scene that are not usual for its method and surface, as `name=value`, in order."""
    solver = dict(scene.get("solver", {}))
    rate = float(scene.get("rate") or 1000.0)
    told = {name: scene.get(name) for name in TOLD if scene.get(name) is not None}
    told = {name: value for name, value in told.items() if USUAL_SCENE.get(name) != value}
    if "level" in told and told["level"] == usual_level(str(scene.get("object") or "")):
        del told["level"]
    usual = _usual_options(solver, rate)
    stiffness, usual_stiffness = dict(solver.pop("stiffness", {})), usual.pop("stiffness")
    for name, value in (*solver.items(), *((f"stiffness.{name}", value) for name, value in stiffness.items())):
        part = name.removeprefix("stiffness.")
        before = usual_stiffness.get(part) if part != name else usual.get(name)
        if name not in ("method", "surface", "period") and value != before:
            told[name] = value
    return ", ".join(f"{name}={_spelled(value)}" for name, value in told.items())


def _usual_options(solver: Mapping[str, Any], rate: float) -> dict[str, Any]:
    try:
        method, surface = str(solver.get("method", "coupled")), str(solver.get("surface", "spheres"))
        options = SolverOptions(method=method, surface=surface)
    except HhsimError:
        # The method is not installed here, or unknown: the defaults of the others.
        options = SolverOptions()
    found = options.at_rate(rate).to_json()
    return {**found, "fingers": list(found["fingers"]), "stiffness": dict(vars(Stiffness()))}


def _figures(summary: Mapping[str, Any], repeated: Mapping[str, Any]) -> dict[str, Any]:
    """Return an entry's figures: those of the last run, but the mean of times over several."""
    times = repeated.get("times", {})
    found = {**summary, **{name: time["mean"] for name, time in times.items()}}
    return {
        "figures": {
            name: float(found[name])
            for name in run_metrics()
            if name in found and found[name] is not None and found[name] == found[name]
        },
        "deviations": {name: float(time["std"]) for name, time in times.items()},
        "runs": int(repeated.get("runs", 1)),
    }


def _hhsim(version: Any, commit: Any, dirty: Any) -> str:
    short = str(commit or "")[:8]
    known = short if short and short != "unknown" else ""
    return " ".join(part for part in (str(version or ""), known + ("+" if known and dirty is True else "")) if part)


def _spelled(value: Any) -> str:
    if isinstance(value, list | tuple):
        return "/".join(_spelled(item) for item in value)
    return f"{value:g}" if isinstance(value, float) else str(value)
