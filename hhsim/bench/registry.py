"""The suites by name."""

from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from hhsim.bench.plan import read_plan
from hhsim.registry import Registry

if TYPE_CHECKING:
    from hhsim.bench.suite import Suite

ORDER = ("paper", "speed-error", "peers", "hard", "stress")
SUITES: Registry[type["Suite"]] = Registry("hhsim.bench.suites", "SUITE", "suite", first=ORDER)
"""Suites by name."""


def suite_lines() -> dict[str, str]:
    """Return one line about each suite, of its plan; no suite is imported."""
    specs = {name: find_spec(f"hhsim.bench.suites.{name.replace('-', '_')}") for name in SUITES.names()}
    return {name: read_plan(Path(str(spec and spec.origin)).with_suffix(".toml")).line for name, spec in specs.items()}
