"""The suites of `hhsim bench` by name, and a suite's plan: a TOML file of its words, its settings and its figures."""

from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import msgspec

from hhsim.registry import Registry
from hhsim.system.settings_file import Settings, read_settings

if TYPE_CHECKING:
    from hhsim.bench.suite import Suite


class Option(Settings, frozen=True):
    """Setting of a suite as its command has it; without a help it is the option of that name of other commands."""

    default: Any = None
    help: str = ""
    flag: str = ""  # as of the setting where it is not given
    metavar: str = ""
    is_argument: bool = False
    is_hidden: bool = False  # True if the command does not have it


class Figure(Settings, frozen=True):
    """Column of a suite's table; one without a meaning is the figure of that name of a replay's table."""

    says: str = ""
    unit: str = ""  # as people read it
    total: Literal["", "worst", "mean", "sum"] = ""  # what sums it up over runs


class Preset(Settings, frozen=True):
    """Values of the settings that a flag stands for; those that are given count more."""

    flag: str
    help: str
    values: dict[str, Any]


class Plan(Settings, frozen=True):
    """Plan of a suite: words and options of its command, and the figures of its table."""

    line: str
    help: str  # of its command, after the line: paragraphs and examples
    options: dict[str, Option]
    figures: dict[str, str | Figure] = msgspec.field(default_factory=dict)  # a text is the meaning
    preset: Preset | None = None
    # What people read: columns as of `Table.of_records`, the column that they are sorted by, that of which each value
    # has a table of its own, and headings of columns that a narrow terminal leaves out.
    shown: str = ""
    sort: str = ""
    by: str = ""
    optional: tuple[str, ...] = ()

    @property
    def columns(self) -> dict[str, Figure]:
        """Figures by the names of their columns."""
        return {name: Figure(one) if isinstance(one, str) else one for name, one in self.figures.items()}


@cache
def read_plan(path: Path) -> Plan:
    """Read the plan of a suite."""
    return read_settings(path, Plan, "plan of a suite")


ORDER = ("paper", "speed-error", "peers", "hard", "stress")
SUITES: Registry[type["Suite"]] = Registry("hhsim.bench.suites", "SUITE", "suite", first=ORDER)
"""Suites by name."""


def suite_lines() -> dict[str, str]:
    """Return one line about each suite, of its plan; no suite is imported."""
    specs = {name: find_spec(f"hhsim.bench.suites.{name.replace('-', '_')}") for name in SUITES.names()}
    return {name: read_plan(Path(str(spec and spec.origin)).with_suffix(".toml")).line for name, spec in specs.items()}
