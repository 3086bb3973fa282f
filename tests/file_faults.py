"""Result files: faults as lines of a table, changes that are sealed anew, and whether each dataset is described."""

import json
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py

from hhsim.result.schema import hand_columns
from hhsim.system import hdf5_input
from hhsim.system.checksummed_file import seal_file

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


def forge_properties(file: h5py.File, change: Callable[[dict[str, Any]], object], name: str = "") -> None:
    """Change the physical properties, or the joint, of a body, of the first one without a name."""
    body = file["bodies"][name or json.loads(file["bodies"].attrs["names"])[0]]
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


def shortened(file: h5py.File, ticks: int) -> None:
    """Leave the first ticks of a result of one hand."""
    for name in ("tick/time", *(f"hands/right/tick/{column.name}" for column in hand_columns())):
        file[name].resize(ticks, axis=0)


@contextmanager
def changed(path: Path) -> Iterator[h5py.File]:
    """The file, open to be changed; it is sealed when the block ends."""
    with h5py.File(path, "r+") as file:
        yield file
    seal_file(path, path.stat().st_size)
    know_as_sound(path)


def know_as_sound(path: Path) -> None:
    """Have this process take a file as read by a child: to fork a process that holds all tests takes long."""
    # A file that was changed a moment ago is hashed again for each column that is read of it.
    os.utime(path, (0.0, 0.0))
    hdf5_input._KNOWN[hdf5_input.file_state(path)] = ""


def bare_datasets(path: Path) -> list[str]:
    """Names of the datasets of a file that lack `units` or `long_name`; fails where it has hardly any."""
    found: dict[str, bool] = {}

    def visit(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset):
            found[name] = bool(item.attrs.get("units") and item.attrs.get("long_name"))

    with h5py.File(path, "r") as file:
        file.visititems(visit)
    assert len(found) > 40
    return [name for name, told in found.items() if not told]
