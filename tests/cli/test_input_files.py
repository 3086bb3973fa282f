"""Named pipes, and HDF5 files that would bring in the content of other files: every reader and command refuses them."""

import os
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
from conftest import Run, sampled
from short_grasp import short_result
from sweep_plans import PLAN, write_plan

from hhsim.errors import InputError
from hhsim.mesh.catalogue import load_object
from hhsim.motion.file import load_trajectory
from hhsim.recordings.registry import read_recording
from hhsim.result.motion import load_result_motion
from hhsim.result.reader import load_result
from hhsim.system.hdf5_input import hdf5_format, open_hdf5
from hhsim.trees.file import load_tree
from hhsim.trees.foreign_tree import import_tree

PIPE, OTHER = "pipe.h5", "other.h5"
"""A named pipe and another file: either would be opened by who follows a link to it."""
COUNT = 8


def external(file: h5py.File, name: str) -> None:
    file[name] = h5py.ExternalLink(OTHER, "/secret")


def piped(file: h5py.File, name: str) -> None:
    file[name] = h5py.ExternalLink(PIPE, "/secret")


def soft(file: h5py.File, name: str) -> None:
    file["elsewhere/values"] = np.arange(COUNT)
    file[name] = h5py.SoftLink("/elsewhere/values")


def raw(file: h5py.File, name: str) -> None:
    file.create_dataset(name, (COUNT,), "i8", external=[(OTHER, 0, 8 * COUNT)])


def virtual(file: h5py.File, name: str) -> None:
    layout = h5py.VirtualLayout((COUNT,), "i8")
    layout[:] = h5py.VirtualSource(OTHER, "secret", (COUNT,))
    file.create_virtual_dataset(name, layout)


def growing(file: h5py.File, name: str) -> None:
    """Add a virtual dataset as long as that in the pipe: the library asks there for its shape."""
    ticks = slice(0, h5py.h5s.UNLIMITED, 1)
    layout = h5py.VirtualLayout((COUNT,), "i8", maxshape=(None,))
    layout[ticks] = h5py.VirtualSource(PIPE, "secret", (COUNT,), maxshape=(None,))[ticks]
    file.create_virtual_dataset(name, layout)


KINDS: dict[str, tuple[Callable[[h5py.File, str], None], str]] = {
    "piped": (piped, "an external link"),
    "external": (external, "an external link"),
    "soft": (soft, "a soft link out of its group"),
    "raw": (raw, "a dataset with external storage"),
    "virtual": (virtual, "a virtual dataset"),
    "growing": (growing, "a virtual dataset"),
}
READERS: tuple[Callable[[Path], object], ...] = (
    *(load_result, load_result_motion, load_trajectory, read_recording, load_tree),
    lambda path: import_tree(path, load_object("cube").mesh),
)
LINES: dict[str, tuple[str, ...]] = {
    "verify": ("FILE.h5",),
    "replay": (
        *("FILE.h5", "cube FILE.h5", "cube touch.toml", "cube FILE.csv", "cube FILE.toml", "cube FILE.npz"),
        *("FILE.stl touch", "mesh.gltf touch --unit m", "cube pinch --tree FILE.h5", "cube pinch --tree FILE.sph"),
        "cube pinch --hand-file FILE.toml",
    ),
    "build-tree": ("cube --from FILE.h5", "cube --from FILE.sph"),
    "import": (
        *("FILE.h5", "FILE.json", "FILE.bvh", "FILE.parquet", "table.csv --columns FILE.toml"),
        "table.csv --format dexmo --calibration FILE.toml",
    ),
    "repair": ("FILE.h5 --object cube --out out.h5",),
    "scene": ("cube FILE.h5", "FILE.stl touch"),
    "score": ("FILE.csv",),
    "live": ("glove cube --device replay --trajectory FILE.h5 --no-record",),
    "compare": ("FILE.h5 result.h5", "result.h5 FILE.h5"),
    "export": ("FILE.h5 out.csv",),
    "view": ("FILE.h5", "FILE.h5 --video out.gif", "FILE.stl"),
    "report": ("FILE.h5 --out page.html", "result.h5 --out FILE.html"),
    "gate": ("FILE.h5", "FILE.toml", "result.h5 --baseline FILE.h5", "result.h5 --baseline FILE.json"),
    "sweep": ("plan.toml", "FILE.toml"),
}
"""What is given to each command; FILE is the pipe, or the file that brings in another."""
COMMANDS = [f"{command} {words}" for command, lines in LINES.items() for words in lines]
LISTED = ("replay cube touch.toml", "sweep plan.toml")
"""Commands that look for it in a folder, or by its name in another file: of a pipe they say that no file is there."""
SUFFIXES = ("h5", "csv", "toml", "npz", "stl", "sph", "json", "bvh", "parquet", "html", "bin")
GLTF = (
    '{"asset": {"version": "2.0"}, "buffers": [{"uri": "FILE.bin", "byteLength": 36}], "bufferViews": [{"buffer": 0,'
    ' "byteLength": 36}], "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],'
    ' "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}], "nodes": [{"mesh": 0}],'
    ' "scenes": [{"nodes": [0]}]}'
)


def write(path: Path, kind: str) -> Path:
    """Write a file with one dataset of a kind, in a group; beside it lie the pipe and the other file."""
    if not (path.parent / PIPE).exists():
        os.mkfifo(path.parent / PIPE)
        with h5py.File(path.parent / OTHER, "w") as file:
            file["secret"] = np.arange(COUNT)
    with h5py.File(path, "w") as file:
        file.attrs["format"] = "hhsim-result"
        KINDS[kind][0](file, "tick/time")
    return path


@pytest.mark.usefixtures("ended")
@pytest.mark.parametrize("kind", KINDS)
def test_no_reader_follows_a_file_to_another_one(kind: str, tmp_path: Path) -> None:
    path = write(tmp_path / "a.h5", kind)
    assert hdf5_format(path) == ""
    for reader in READERS:
        with pytest.raises(InputError, match=f"'tick/time' is {KINDS[kind][1]}; expected a file that holds all of its"):
            reader(path)


def test_links_within_a_file_are_followed(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["tick/time"] = np.arange(COUNT)
        file["tick/near"], file["tick/far"] = h5py.SoftLink("time"), h5py.SoftLink("/tick/time")
        file["whole"] = h5py.SoftLink("/tick/time")
    with open_hdf5(tmp_path / "a.h5") as file:
        for name in ("tick/near", "tick/far", "whole"):
            np.testing.assert_array_equal(file[name], np.arange(COUNT))


def every_time(place: int) -> bool:
    command = COMMANDS[place]
    return "result.h5" not in command and (".h5" in command or ".gltf" in command or place % 4 == 0)


@pytest.mark.usefixtures("ended")
@pytest.mark.parametrize(("place", "command"), sampled(list(enumerate(COMMANDS)), lambda place, _: every_time(place)))
def test_no_command_waits_for_a_pipe_or_follows_a_file_to_another_one(
    place: int, command: str, run: Run, tmp_path: Path
) -> None:
    """Each is given a named pipe, and where it takes HDF5 a link to one, and one of the other kinds."""
    for suffix in SUFFIXES:
        os.mkfifo(tmp_path / f"FILE.{suffix}")
    (tmp_path / "table.csv").write_text("t,x\n0,1\n")
    (tmp_path / "mesh.gltf").write_text(GLTF)
    (tmp_path / "touch.toml").write_text('recording = "FILE.h5"\n[touch]\nfinger = "index"\ndepth = 0.01\n')
    write_plan(tmp_path, PLAN.replace("short.toml", "FILE.h5"))
    if "result.h5" in command:
        short_result(tmp_path / "result.h5")
    given = {path.name for path in tmp_path.iterdir()}
    takes_hdf5 = ".h5" in command.replace("result.h5", "") or command in LISTED
    linked = ("piped", list(KINDS)[1 + place % (len(KINDS) - 1)]) if takes_hdf5 else ()
    for kind in linked if command in LISTED else ("", *linked):
        if kind:
            (tmp_path / "FILE.h5").unlink()
            write(tmp_path / "FILE.h5", kind)
        answer = run(*command.split())
        assert answer.code == 2, answer
        said = KINDS[kind][1] if kind else "no ordinary file"
        assert answer.err.count("\n") == 1 and said in answer.err, answer.err
        assert {path.name for path in tmp_path.iterdir()} <= given | {"results", "pipe.h5", "other.h5"}
