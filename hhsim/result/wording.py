"""Words for what a result's file states of its run: object, motion, commit, and values of the solver's options."""

from pathlib import Path
from typing import Any

from hhsim.result.reader import Result

LENGTHS = ("margin", "skin", "offset", "step_tolerance", "touch")
"""Options of the solver that are lengths [m]."""
TIMES = ("period", "response", "contact_response")
"""Options of the solver that are times [s]."""
LONGEST_VALUE = 28
"""Most letters of an option's value; a longer one is cut."""


def object_name(result: Result) -> str:
    """Return what people call the object; a file without its folder."""
    scene = result.scene
    return str(scene.get("object_name") or Path(str(scene.get("object") or "object")).name)


def motion_name(result: Result) -> str:
    """Return what people call the motion; of one of two hands, with its side."""
    scene = result.scene
    name = str(scene.get("motion") or Path(str(scene.get("trajectory") or "motion")).name)
    return f"{name} ({scene['hand']['side']} of two hands)" if result.other is not None else name


def commit(result: Result) -> str:
    """Return the short commit of the hhsim that wrote a result, and whether its files had changed."""
    changed = ", with changes that are not committed" if result.git_dirty is True else ""
    return f"{result.git_revision[:12]}{changed}"


def option_value(name: str, value: Any) -> str:
    """Return an option of the solver as people read it: lengths in mm, times in ms, numbers with six digits."""
    if name in LENGTHS and isinstance(value, int | float):
        return f"{1e3 * value:g} mm"
    if name in TIMES and isinstance(value, int | float):
        return f"{1e3 * value:g} ms"
    return cut("none" if value is None else f"{value:g}" if isinstance(value, float) else str(value))


def cut(text: str) -> str:
    """Return the text, at most `LONGEST_VALUE` letters of it."""
    return text if len(text) <= LONGEST_VALUE else f"{text[: LONGEST_VALUE - 1]}…"
