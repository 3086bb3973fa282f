"""The suites by name."""

from importlib.resources import files
from typing import TYPE_CHECKING

from hhsim.registry import Registry

if TYPE_CHECKING:
    from hhsim.bench.suite import Suite

ORDER = ("paper", "speed-error", "peers", "manipulation", "hard", "stress", "recorded", "trees")
SUITES: Registry["Suite"] = Registry("hhsim.bench.suites", "SUITE", "suite", first=ORDER)
"""Suites by name."""


def suite_lines() -> dict[str, str]:
    """Return one line about each suite: the first one of its module, which is read and not imported."""
    folder = files("hhsim.bench.suites")
    texts = {name: (folder / f"{name.replace('-', '_')}.py").read_text(encoding="utf-8") for name in SUITES.names()}
    return {name: text.partition('"""')[2].partition("\n")[0] for name, text in texts.items()}
