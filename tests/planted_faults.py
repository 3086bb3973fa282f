"""Faults planted in the file of an honest result, each with the claim that finds it: shared by the referee's tests."""

import json
import shutil
from pathlib import Path
from typing import Any

import h5py
from file_faults import Fault, changed
from short_grasp import result_of, short_grasp, short_scene

from hhsim.hand.model import Side
from hhsim.mesh.catalogue import load_object
from hhsim.replay.stored_scene import checksums
from hhsim.result.reader import Result, load_result
from hhsim.result.schema import BODY_STATIC, HAND_STATIC
from hhsim.trees.options import TreeOptions
from hhsim.verify.verify import Verification

HOLD = 200
"""A tick of the hold."""
UNMARKED = 173
"""A tick of the hold in which nothing is worst, and no library is asked."""


def described_grasp(
    folder: Path, name: str = "cylinder", level: int = 2, side: Side = "right", **options: Any
) -> Result:
    """A short grasp, described as the command line does."""
    scene = short_scene(short_grasp(hold=0.09), name, level, side)
    path = folder / f"{name}.h5"
    description = {
        "hand_file": None,
        "object": name,
        "object_mesh": load_object(name).mesh.sha256,
        "tree": None,
        "tree_options": TreeOptions(level=level).recorded(),
    }
    return result_of(scene, path, description, **options)


def failing(found: Verification) -> set[str]:
    return {claim.name for claim in found.claims if claim.failed}


def verdict(found: Verification, name: str) -> str:
    return next(claim.verdict for claim in found.claims if claim.name == name)


SEALED = {
    *("wrong_parent", "edited_mesh", "longer_finger", "thicker_finger"),
    *("shrunk_sphere", "slightly_shrunk_sphere", "pushed_vertex", "dropped_palm_sphere"),
    *("widened_limits", "wider_spread", "placed_elsewhere"),
    *("post elsewhere", "thinner post", "thinner lid", "begun elsewhere"),
}
"""Faults whose forger also made the checksums fit."""


def planted(source: Path, folder: Path, fault: Fault) -> Result:
    path = folder / "planted.h5"
    shutil.copy(source, path)
    with changed(path) as file:
        fault(file)
        if fault.__name__ in SEALED:
            _fit_checksums(file)
    return load_result(path)


def _fit_checksums(file: h5py.File) -> None:
    of_bodies = {
        name: {column.name: body[column.name][...] for column in BODY_STATIC} for name, body in file["bodies"].items()
    }
    for side, hand in file["hands"].items():
        arrays = {column.name: hand[column.name][...] for column in HAND_STATIC}
        for of in (file, hand):
            scene = json.loads(of.attrs["scene"])
            if "checksums" in scene:
                of.attrs["scene"] = json.dumps({**scene, "checksums": checksums(side, arrays, of_bodies)})
