"""What a project gates on: scenes and limits, in a TOML file that it commits (`hhsim-gate.toml`).

`default_suite_text` shows every key; `docs/gate.md` explains them.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from hhsim.errors import InputError, UnknownNameError
from hhsim.gate.limits import OF_SESSIONS, OF_SUBMISSIONS, OUTSIDE_DEFAULTS, SESSION_DEFAULTS, limitable
from hhsim.gate.metrics import COUNTERS
from hhsim.metrics.run.registry import judged_metrics
from hhsim.solver.method import METHODS
from hhsim.solver.method_names import ISOLATED, method_names
from hhsim.system.toml_document import (
    check_keys,
    checked_number,
    checked_table,
    checked_text,
    parse_toml,
    read_toml_text,
)

SUITE_FILE = "hhsim-gate.toml"
"""The suite of a project, in the folder where the gate is run."""
SUITE_VERSION = 1
OWN_ARGUMENTS = ("--out", "--json", "--quiet", "-q", "--rerun", "--method", "--level")
"""Arguments of `hhsim replay` that the gate gives itself, or has a key for."""
REPLAY, SUBMISSION, SESSION = "object", "submission", "session"
"""What a scene is of, by the key that says it: a replay, the poses of other software, a recorded live session."""
KEYS = {
    REPLAY: ("object", "trajectory", "method", "level", "arguments", "timed"),
    SUBMISSION: ("submission", "arguments"),
    SESSION: ("session",),
}
"""Keys of a scene besides those that every scene has, by what it is of."""
EVERY = ("name", "motion_may_change", "limits", "counters")
ONLY_OF = {SESSION: OF_SESSIONS, SUBMISSION: OF_SUBMISSIONS}
"""Figures that only scenes of one kind have."""

_DEFAULT_SUITE = """
version = 1

[limits]                       # none may be exceeded; SI units, % for shares and rates
{limits}

[counters]                     # how much more work than the baseline is no miss, as a share
slack = 0.005

[time]                         # CPU time of a tick in contact, median of processes' p50
limit = 0.05                   # slower than the base by more than this share is a miss
recorded_limit = 0.10          # the same against a baseline recorded elsewhere, both divided by the reference workload
processes = 5                  # of each, base and head in turn

[[scene]]
name = "cube-pinch"
object = "cube"
trajectory = "pinch"
method = "coupled"
timed = true

[[scene]]
name = "bunny-grasp"
object = "bunny"
trajectory = "grasp"
method = "coupled"
timed = true

[[scene]]
name = "bunny-grasp-progressive"
object = "bunny"
trajectory = "grasp"
method = "progressive"
[scene.limits]
tracking_excess = false        # not promised: this method holds the palm where the user has it

[[scene]]
name = "cup-handle"
object = "cup"
trajectory = "handle"
method = "coupled"
"""
"""The suite of a folder that has no `hhsim-gate.toml`, but for the limits that the figures themselves state."""


@dataclass(frozen=True)
class GateScene:
    """One run of the suite: a replay, a submission that is scored, or a session that was recorded.

    Attributes:
        name: In tables and baselines; unique.
        kind: `REPLAY`, `SUBMISSION` or `SESSION`.
        object: As `hhsim replay` takes it; a mesh file is relative to the suite's folder. Of the other kinds, the file
            of the submission or of the session.
        trajectory: As `hhsim replay` takes it, a recording too; "" of the other kinds.
        method: As `hhsim replay` takes it, one from outside too.
        level: Of the sphere tree; None: the object's usual one.
        arguments: More arguments of `hhsim replay` or `hhsim score`.
        timed: Whether its time is judged.
        motion_may_change: Whether a run with another motion than the base's is judged by its limits alone, and is no
            run that cannot be compared.
        limits: Largest value of each figure that has a limit, by the names of
            `hhsim.metrics.run.registry.run_metrics`, SI or %.
        slack: Of each counter, as a share of the baseline's value.
    """

    name: str
    object: str
    trajectory: str = ""
    kind: str = REPLAY
    method: str = "coupled"
    level: int | None = None
    arguments: tuple[str, ...] = ()
    timed: bool = False
    motion_may_change: bool = False
    limits: Mapping[str, float] = field(default_factory=dict)
    slack: Mapping[str, float] = field(default_factory=dict)

    def command(self) -> list[str]:
        """Return the command of hhsim that makes its result, without the options that say where that goes.

        Empty of a session, which is judged as it was recorded.
        """
        if self.kind == SESSION:
            return []
        if self.kind == SUBMISSION:
            return ["score", self.object, *self.arguments]
        level = [] if self.level is None else ["--level", str(self.level)]
        return ["replay", self.object, self.trajectory, "--method", self.method, *level, *self.arguments]


@dataclass(frozen=True)
class GateSuite:
    """What is gated.

    Attributes:
        scenes: In the order of the file.
        folder: The file's; paths in it are relative to it.
        source: For messages.
        baseline: The recorded baseline that the file names.
        limit: Share by which head may be slower than base, both run in one job.
        recorded_limit: The same against a recorded baseline.
        processes: Timed processes of each side and scene.
        limits, slack: For every scene that has none of its own, and for results.
    """

    scenes: tuple[GateScene, ...]
    folder: Path
    source: str
    baseline: Path | None = None
    limit: float = 0.05
    recorded_limit: float = 0.10
    processes: int = 5
    limits: Mapping[str, float] = field(default_factory=dict)
    slack: Mapping[str, float] = field(default_factory=dict)

    def limits_of(self, kind: str) -> Mapping[str, float]:
        """Return the limits of a result of a kind that is no scene of the suite: every one that it can have."""
        return usual_limits(kind, self.limits)


def usual_limits(kind: str, limits: Mapping[str, float]) -> dict[str, float]:
    """Return those of the limits of all scenes that one of a kind can have."""
    others = {name for of, names in ONLY_OF.items() if of != kind for name in names}
    return {name: limit for name, limit in limits.items() if name not in others}


def load_suite(path: Path) -> GateSuite:
    """Read a suite.

    Raises:
        InputError: No such file, no TOML, or a key, a name or a value that a suite does not have.
    """
    return parse_suite(read_toml_text(path, "suite"), path.parent, str(path))


def default_suite() -> GateSuite:
    """The suite that ships."""
    return parse_suite(default_suite_text(), Path.cwd(), "the default suite")


def default_suite_text() -> str:
    """The suite that ships, as TOML."""
    judged = ((metric, metric.judged) for metric in judged_metrics().values() if not metric.free_only)
    limits = [f"{metric.name} = {by.limit:g}  # {metric.label}" for metric, by in judged if by and by.limit is not None]
    return _DEFAULT_SUITE.replace("{limits}", "\n".join(limits))


def parse_suite(text: str, folder: Path, source: str) -> GateSuite:
    """Read the text of a suite.

    Args:
        text: TOML.
        folder: That paths in it are relative to.
        source: For messages.

    Raises:
        InputError: As `load_suite`.
    """
    table = parse_toml(text, source)
    check_keys(source, table, ("version", "baseline", "limits", "counters", "time", "scene"))
    if table.get("version") != SUITE_VERSION:
        raise InputError(f"{source}: version is {table.get('version')!r}, this hhsim reads {SUITE_VERSION}")
    limits = _limits(table, source)
    slack = _slack(table, source, dict.fromkeys(COUNTERS, 0.0))
    time = checked_table(source, "time", table.get("time", {}), ("limit", "recorded_limit", "processes"))
    processes = time.get("processes", 5)
    if not isinstance(processes, int) or isinstance(processes, bool) or not 3 <= processes <= 100:
        raise InputError(f"{source}, [time]: processes is {processes!r}, expected 3 to 100")
    rows = table.get("scene", [])
    if not isinstance(rows, list) or not rows or not all(isinstance(row, dict) for row in rows):
        raise InputError(
            f"{source} has no scene: it needs [[scene]] with a name, and object and trajectory, submission, or session"
        )
    outside = {name: limit for name, limit in OUTSIDE_DEFAULTS.items() if name not in table.get("limits", {})} | limits
    usual = [limits if str(row.get("method", "coupled")) in METHODS else outside for row in rows]
    scenes = tuple(_scene(row, usual[i], slack, f"{source}, scene {i + 1}") for i, row in enumerate(rows))
    names = [scene.name for scene in scenes]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError(f"{source} has two scenes named {', '.join(twice)}: names are unique")
    return GateSuite(
        scenes=scenes,
        folder=folder,
        source=source,
        baseline=folder / checked_text(source, "baseline", table["baseline"]) if "baseline" in table else None,
        limit=checked_number(f"{source}: time", "limit", time.get("limit", 0.05), 0.0, 1.0),
        recorded_limit=checked_number(f"{source}: time", "recorded_limit", time.get("recorded_limit", 0.10), 0.0, 1.0),
        processes=processes,
        limits=limits,
        slack=slack,
    )


def _scene(row: dict[str, Any], limits: Mapping[str, float], slack: Mapping[str, float], where: str) -> GateScene:
    kinds = [kind for kind in KEYS if kind in row]
    known = KEYS[kinds[0]] if len(kinds) == 1 else {key for keys in KEYS.values() for key in keys}
    check_keys(where, row, (*EVERY, *known))
    if len(kinds) != 1:
        raise InputError(f"{where}: expected one of {', '.join(KEYS)}, which says what it is of; found {len(kinds)}")
    kind = kinds[0]
    texts = {key: row.get(key) for key in ("name", kind, *(("trajectory",) if kind == REPLAY else ()))}
    for key, text in texts.items():
        if not isinstance(text, str) or not text:
            raise InputError(f"{where}: {key} is {text!r}, expected a text")
        if key != "name" and text.startswith("-"):
            raise InputError(f"{where}: {key} is {text!r}, which is an option; options go to arguments")
    flags = {"timed": False, "motion_may_change": kind == SESSION}
    for key in flags:
        flags[key] = row.get(key, flags[key])
        if not isinstance(flags[key], bool):
            raise InputError(f"{where}: {key} is {flags[key]!r}, expected true or false")
    level = row.get("level")
    if level is not None and (type(level) is not int or not 1 <= level <= 5):
        raise InputError(f"{where}: level is {level!r}, expected 1 to 5")
    return GateScene(
        name=row["name"],
        object=row[kind],
        trajectory=row.get("trajectory", ""),
        kind=kind,
        method=_method(row.get("method", "coupled"), where),
        level=level,
        arguments=_arguments(row.get("arguments", []), where),
        limits=_limits(row, where, kind, limits),
        slack=_slack(row, where, slack),
        **flags,
    )


def _method(name: Any, where: str) -> str:
    """Check the name of a method; one from outside is imported by its own run, where its module lies."""
    if not isinstance(name, str):
        raise InputError(f"{where}: method is {name!r}, expected a text")
    if ":" not in name.removeprefix(ISOLATED) and name.removeprefix(ISOLATED) not in method_names():
        raise InputError(f"{where}: {UnknownNameError('method', name, method_names())}, or package.module:Class")
    return name


def _arguments(arguments: Any, where: str) -> tuple[str, ...]:
    if not isinstance(arguments, list) or not all(isinstance(item, str) for item in arguments):
        raise InputError(f"{where}: arguments is {arguments!r}, expected a list of texts")
    taken = [item for item in arguments if item.split("=")[0] in OWN_ARGUMENTS]
    if taken:
        raise InputError(f"{where}: {taken[0]} is no argument to give: the gate gives it, or has a key for it")
    return tuple(arguments)


def _limits(
    table: dict[str, Any], where: str, kind: str = "", usual: Mapping[str, float] | None = None
) -> dict[str, float]:
    """Limits by figure: those of a scene on top of the usual ones; false takes one away."""
    found = dict(SESSION_DEFAULTS) if usual is None else usual_limits(kind, usual)
    for name, value in checked_table(where, "limits", table.get("limits", {}), tuple(limitable())).items():
        of = next((of for of, names in ONLY_OF.items() if name in names), kind)
        if kind and kind != of:
            raise InputError(f"{where}: limits: only a {of} has {name}, and this is no scene with the key {of}")
        if value is False:
            found.pop(name, None)
        else:
            if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 <= value < math.inf:
                raise InputError(f"{where}: limits: {name} is {value!r}, expected a number from 0 on, or false")
            found[name] = float(value)
    return found


def _slack(table: dict[str, Any], where: str, usual: Mapping[str, float]) -> dict[str, float]:
    """Slack by counter; `slack` is that of all counters that are not named."""
    counters = checked_table(where, "counters", table.get("counters", {}), ("slack", *COUNTERS))
    shares = {name: checked_number(f"{where}: counters", name, share, 0.0, 1.0) for name, share in counters.items()}
    every = shares.pop("slack", None)
    return {name: shares.get(name, usual[name] if every is None else every) for name in COUNTERS}
