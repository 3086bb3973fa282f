"""Suite of a gate: scenes and limits, in a TOML file that a project commits (`hhsim-gate.toml`, see docs/gate.md)."""

from collections import Counter
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any, Literal

from msgspec import Meta, field, structs

from hhsim.errors import InputError, UnknownNameError, check_known
from hhsim.gate.metrics import COUNTERS, OF_SESSIONS, OF_SUBMISSIONS, OUTSIDE_DEFAULTS, SESSION_DEFAULTS, limitable
from hhsim.metrics.run.registry import judged_metrics
from hhsim.solver.method import METHODS, method_names
from hhsim.system.settings_file import Settings, Version, between, parse_settings, read_toml_text

SUITE_FILE = "hhsim-gate.toml"
"""Suite of a project, in the folder where the gate is run."""
OWN_ARGUMENTS = ("--out", "--json", "--quiet", "-q", "--rerun", "--method", "--level")
"""Arguments of `hhsim replay` that the gate sets itself, or has a key for."""
REPLAY, SUBMISSION, SESSION = "replay", "submission", "session"
"""Kinds of results: of a replay, which a scene is, of the poses of other software, and of a live session."""
ONLY_OF = {SESSION: OF_SESSIONS, SUBMISSION: OF_SUBMISSIONS}
"""Figures that only one kind of result has."""
BOTH = "both"
"""Value of --hand, among a scene's arguments, for two hands."""
SCENES = "[[scene]] tables, each with a name, an object and a trajectory"
Share = Annotated[float, between(0.0, 1.0)]
Word = Annotated[str, Meta(pattern="^[^-]", description="text that is no option: options go to arguments")]
SLACK = 0.005
"""Growth of a counter that is no miss, as a share, where a suite has none."""
DEFAULT_SUITE = "default-suite.toml"
"""File beside this module with the default suite, without the limits that the figures themselves state."""


class _Judged(Settings, frozen=True, kw_only=True, rename={"slack": "counters"}):
    """Tables that a suite and each of its scenes have."""

    # Largest values of figures by the names of `hhsim.metrics.run.registry.run_metrics`, SI or %.
    limits: dict[str, Annotated[float, between(0.0)] | Literal[False]] = field(default_factory=dict)
    slack: dict[str, Share] = field(default_factory=dict)  # allowed growth of each counter, relative to the baseline

    def check(self) -> None:
        check_known("key in limits", self.limits, limitable())
        check_known("key in counters", self.slack, ("slack", *COUNTERS))

    def on_top_of(self, limits: Mapping[str, float], slack: Mapping[str, float]) -> dict[str, Any]:
        """Return limits and slack, overridden by its own; false is no limit, nor one that follows from the base."""
        every = {name: self.slack.get("slack", share) for name, share in slack.items()}
        return {
            "limits": {**limits, **self.limits},
            "slack": {name: self.slack.get(name, share) for name, share in every.items()},
        }


class GateScene(_Judged, frozen=True, kw_only=True, rename={"slack": "counters"}):
    """One replay of the suite."""

    name: Annotated[str, Meta(min_length=1)]  # unique name in tables and baselines
    object: Word  # as `hhsim replay` takes it; a mesh file is relative to the suite's folder
    trajectory: Word  # as `hhsim replay` takes it, a recording too
    method: str = "coupled"  # as `hhsim replay` takes it, one from outside too
    level: Annotated[int, between(1, 5)] | None = None  # level of the sphere tree; None: the object's default
    # Hand that is judged of a run with `--hand both`; None for the only one.
    hand: Literal["right", "left"] | None = None
    arguments: tuple[str, ...] = ()  # more arguments of `hhsim replay`
    timed: bool = False  # True if its time is judged

    def check(self) -> None:
        """Check the limits, the method's name and the arguments."""
        super().check()
        for kind, names in ONLY_OF.items():
            for name in names.intersection(self.limits):
                raise InputError(f"limits: only a {kind} has {name}, and a scene is a replay; expected it in [limits]")
        # A method from outside is imported by its own run, where its module lies.
        if ":" not in self.method and self.method not in method_names():
            raise InputError(f"{UnknownNameError('method', self.method, method_names())}, or package.module:Class")
        if (self.hand is not None) != (BOTH in self.arguments):
            raise InputError(f'hand is of a run of two, whose arguments have "{BOTH}": which of them is judged')
        for item in self.arguments:
            if item.split("=")[0] in OWN_ARGUMENTS:
                raise InputError(f"{item} is no argument to give: the gate gives it, or has a key for it")

    def command(self) -> list[str]:
        """Return the command that makes its result, without the output options."""
        level = [] if self.level is None else ["--level", str(self.level)]
        return ["replay", self.object, self.trajectory, "--method", self.method, *level, *self.arguments]


class GateTime(Settings, frozen=True):
    """Judgement of times."""

    limit: Share = 0.05  # relative slowdown allowed against a base run in the same job
    processes: Annotated[int, between(3, 100)] = 5  # timed processes of each side and scene


class _SuiteTable(_Judged, frozen=True, kw_only=True, rename={"slack": "counters", "scenes": "scene"}):
    version: Version
    scenes: Annotated[tuple[GateScene, ...], Meta(min_length=1, description=SCENES)]
    baseline: Annotated[str, Meta(min_length=1)] | None = None
    time: GateTime = GateTime()

    def check(self) -> None:
        super().check()
        twice = [name for name, count in Counter(scene.name for scene in self.scenes).items() if count > 1]
        if twice:
            raise InputError(f"two scenes named {', '.join(twice)}: names are unique")


class GateSuite(_SuiteTable, frozen=True, kw_only=True):
    """Suite of scenes, in the order of the file; `limits` and `slack` are defaults of scenes, and hold for results."""

    folder: Path  # folder of the file, to which paths are relative
    source: str  # name for messages


def usual_limits(kind: str, limits: Mapping[str, float]) -> dict[str, float]:
    """Return those of a suite's limits that a result of a kind can have."""
    others = {name for of, names in ONLY_OF.items() if of != kind for name in names}
    return {name: limit for name, limit in limits.items() if name not in others}


def load_suite(path: Path) -> GateSuite:
    """Read a suite; InputError for no such file, no TOML, or an unknown key, name or value."""
    return parse_suite(read_toml_text(path, "suite"), path.parent, str(path))


def default_suite() -> GateSuite:
    """Return the default suite."""
    return parse_suite(default_suite_text(), Path.cwd(), "the default suite")


def default_suite_text() -> str:
    """Return the default suite as TOML."""
    judged = ((metric, metric.judged) for metric in judged_metrics().values() if not metric.free_only)
    limits = [f"{metric.name} = {by.limit:g}  # {metric.label}" for metric, by in judged if by and by.limit is not None]
    suite = (files("hhsim.gate") / DEFAULT_SUITE).read_text(encoding="utf-8")
    return suite.replace("# {limits}", "\n".join(limits))


def parse_suite(text: str, folder: Path, source: str) -> GateSuite:
    """Parse a suite's TOML, with paths relative to `folder`; `source` is for messages. InputError as `load_suite`."""
    table = parse_settings(text, _SuiteTable, source)
    usual, scenes = table.on_top_of(SESSION_DEFAULTS, dict.fromkeys(COUNTERS, SLACK)), []
    for scene in table.scenes:
        limits = dict(usual["limits"])
        if scene.method not in METHODS:
            limits = {name: limit for name, limit in OUTSIDE_DEFAULTS.items() if name not in table.limits} | limits
        scenes.append(structs.replace(scene, **scene.on_top_of(usual_limits(REPLAY, limits), usual["slack"])))
    return GateSuite(**{**structs.asdict(table), **usual, "scenes": tuple(scenes)}, folder=folder, source=source)
