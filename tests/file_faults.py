"""Faults of a result file as lines of a table: functions that change one place of an open file, with a name."""

import json
from collections.abc import Callable
from typing import Any

import h5py

Fault = Callable[[h5py.File], None]


def with_name(name: str, fault: Fault) -> Fault:
    fault.__name__ = name
    return fault


def at(name: str, dataset: str, where: Any, change: Callable[[Any], Any]) -> Fault:
    """Change the values of a dataset at some places."""

    def fault(file: h5py.File) -> None:
        file[dataset][where] = change(file[dataset][where])

    return with_name(name, fault)


def attribute(name: str, group: str, key: str, change: Callable[[Any], Any]) -> Fault:
    """Change an attribute of a group, None where there is none yet."""

    def fault(file: h5py.File) -> None:
        file[group].attrs[key] = change(file[group].attrs.get(key))

    return with_name(name, fault)


def of_scene(name: str, change: Callable[[dict[str, Any]], object]) -> Fault:
    """Change what the scene says."""
    return with_name(name, lambda file: forge_scene(file, change))


def forge_scene(file: h5py.File, change: Callable[[dict[str, Any]], object]) -> None:
    scene = json.loads(file.attrs["scene"])
    change(scene)
    file.attrs["scene"] = json.dumps(scene)
