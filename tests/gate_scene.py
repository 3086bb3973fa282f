"""A suite of one short replay, which tests of the gate share."""

from pathlib import Path

SHORT = """
title = "short"
[[phase]]
name = "approach"
duration = 0.05
[[phase]]
name = "grasp"
duration = 0.1
fingers = ["thumb", "index"]
[[phase]]
name = "hold"
duration = 0.05
"""

SUITE = """
version = 1
[limits]
penetration_max = 1e-6
stuck_ticks = 0
lag_ticks = 0
tracking_excess = 1.0
[counters]
slack = 0.005
[time]
limit = 1.0            # these tests run where others run too: what is tested is not the clock
processes = 3
[[scene]]
name = "tiny"
object = "cube"
trajectory = "short.toml"
timed = true
"""


def write_suite(folder: Path) -> Path:
    """Write the suite and its trajectory into a folder; returns the suite's file."""
    (folder / "short.toml").write_text(SHORT)
    suite = folder / "hhsim-gate.toml"
    suite.write_text(SUITE)
    return suite
