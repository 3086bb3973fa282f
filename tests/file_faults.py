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


def of_properties(name: str, change: Callable[[dict[str, Any]], object]) -> Fault:
    """Change the physical properties of the first body."""
    return with_name(name, lambda file: forge_properties(file, change))


def forge_properties(file: h5py.File, change: Callable[[dict[str, Any]], object]) -> None:
    body = file["bodies"][json.loads(file["bodies"].attrs["names"])[0]]
    properties = json.loads(body.attrs["properties"])
    change(properties)
    body.attrs["properties"] = json.dumps(properties)


def forge_scene(file: h5py.File, change: Callable[[dict[str, Any]], object]) -> None:
    """Change what a result of one hand says of its scene: what all hands have in common, and what is this one's."""
    (hand,) = file["hands"].values()
    common, own = (json.loads(of.attrs["scene"]) for of in (file, hand))
    scene = {**common, **own}
    change(scene)
    hand.attrs["scene"] = json.dumps({key: scene[key] for key in own if key in scene})
    file.attrs["scene"] = json.dumps({key: value for key, value in scene.items() if key not in own})
