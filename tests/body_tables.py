"""Tables of bodies, as their TOML files have them, of tests that are of scenes and not of files."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

TABLE = '[[body]]\nname = "table"\nplane = "under"\n'


def body(name: str, box: Sequence[float] = (), **keys: Any) -> str:
    """A table of a body: the edges of its box [m], if it is one, and further keys."""
    given = {"name": name} | ({"box": box} if box else {}) | keys
    return "\n".join(["[[body]]", *(f"{key} = {_toml(value)}" for key, value in given.items()), ""])


def _toml(value: Any) -> str:
    if isinstance(value, dict):
        return f"{{ {', '.join(f'{key} = {_toml(each)}' for key, each in value.items())} }}"
    return json.dumps(value)


def joint(kind: str, axis: Sequence[float], **keys: Any) -> dict[str, Any]:
    """A joint of a kind about or along an axis."""
    return {"type": kind, "axis": axis, **keys}


def body_file(folder: Path, *tables: str, name: str = "bodies.toml") -> str:
    """Write a file of bodies, and return its path."""
    path = folder / name
    path.write_text("".join(tables))
    return str(path)
