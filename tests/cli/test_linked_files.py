"""HDF5 files that would bring in the content of other files: each reader and each command refuses them unread."""

import os
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
from conftest import Run
from sampled import sampled
from short_grasp import short_result
from sweep_plans import PLAN, write_plan

from hhsim.bench.table import load_table
from hhsim.errors import InputError
from hhsim.mesh.catalogue import load_object
from hhsim.motion.file import load_trajectory
from hhsim.recordings.registry import read_recording
from hhsim.result.motion import load_result_motion
from hhsim.result.reader import load_result
from hhsim.submissions.pose_file import read_submission
from hhsim.submissions.scene_file import read_scene
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
    *(read_submission, read_scene, load_table),
)
COMMANDS = (
    "verify FILE",
    "replay FILE",
    "replay cube FILE",
    "replay cube touch.toml",
    "replay cube pinch --tree FILE",
    "build-tree cube --from FILE",
    "import FILE",
    "repair FILE --object cube --out out.h5",
    "scene cube FILE",
    "score FILE",
    "live glove cube --device replay --trajectory FILE --no-record",
    "compare FILE result.h5",
    "compare result.h5 FILE",
    "export FILE out.csv",
    "export FILE out.npz --as keypoints",
    "view FILE",
    "view FILE --video out.gif",
    "report FILE --out page.html",
    "retarget FILE --robot robot.urdf",
    "gate FILE",
    "gate result.h5 --baseline FILE",
    "board FILE",
    "sweep plan.toml",
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


@pytest.mark.usefixtures("ended")
@pytest.mark.parametrize(
    ("place", "command"), sampled(list(enumerate(COMMANDS)), lambda place, _: "result.h5" not in COMMANDS[place])
)
def test_no_command_follows_a_file_to_another_one(place: int, command: str, run: Run, tmp_path: Path) -> None:
    """Each is given the pipe, and one of the other kinds."""
    for kind in ("piped", list(KINDS)[1 + place % (len(KINDS) - 1)]):
        write(tmp_path / "FILE.h5", kind)
        (tmp_path / "touch.toml").write_text('recording = "FILE.h5"\n[touch]\nfinger = "index"\ndepth = 0.01\n')
        write_plan(tmp_path, PLAN.replace("short.toml", "FILE.h5"))
        if "result.h5" in command and kind == "piped":
            short_result(tmp_path / "result.h5")
        answer = run(*(word.replace("FILE", "FILE.h5") for word in command.split()))
        assert answer.code == 2, answer
        assert answer.err.count("\n") == 1 and KINDS[kind][1] in answer.err, answer.err
        assert {path.suffix for path in tmp_path.iterdir()} <= {".h5", ".toml", ""}
