"""A small plan that several test modules sweep: a short motion of its own folder on simple objects."""

from pathlib import Path

import h5py
from short_grasp import short_grasp_text

PLAN = """
version = 1
name = "small"
objects = ["cylinder"]
motions = ["short.toml"]
methods = ["coupled", "penalty"]
[options.usual]
level = 2
"""
TIMES = ("tick_cpu_p50", "tick_cpu_p99", "tick_cpu_max", "tick_wall_p50", "tick_wall_over_1ms")


def write_plan(folder: Path, text: str = PLAN) -> Path:
    """Write a plan and its motion; where the plan is."""
    (folder / "short.toml").write_text(short_grasp_text(), encoding="utf-8")
    path = folder / "plan.toml"
    path.write_text(text, encoding="utf-8")
    return path


def without_times(path: Path) -> dict[str, str]:
    """All that a result holds, but for times and what says when and by which command it was made."""
    found: dict[str, str] = {}

    def keep(name: str, item: object) -> None:
        if isinstance(item, h5py.Dataset) and "/tick/duration/" not in name:
            values = item[...]
            found[name] = repr(values.tolist() if values.dtype == object else values.tobytes())

    with h5py.File(path) as file:
        file.visititems(keep)
        found |= {name: repr(value) for name, value in file["summary/right"].attrs.items() if name not in TIMES}
        found |= {name: repr(file.attrs[name]) for name in ("scene", "machine", "packages", "complete")}
    return found
