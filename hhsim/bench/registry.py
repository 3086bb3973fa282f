"""The suites by name."""

from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from hhsim.registry import Registry

if TYPE_CHECKING:
    from hhsim.bench.suite import Suite

ORDER = ("paper", "speed-error", "peers", "manipulation", "hard", "stress", "recorded", "trees")
SUITES: Registry["Suite"] = Registry("hhsim.bench.suites", "SUITE", "suite", first=ORDER)
"""Suites by name."""


def suite_lines() -> dict[str, str]:
    """Return one line about each suite: the first one of its module, which is read and not imported."""
    lines = {}
    for name in SUITES.names():
        spec = find_spec(f"hhsim.bench.suites.{name.replace('-', '_')}")
        text = Path(spec.origin).read_text(encoding="utf-8") if spec and spec.origin else ""
        lines[name] = text.partition('"""')[2].partition("\n")[0].removesuffix('"""')
    return lines
