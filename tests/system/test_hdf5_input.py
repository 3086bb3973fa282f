"""No HDF5 file is parsed before a child process has read it to its end, and nothing goes past that door."""

import ast
import itertools
import os
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import h5py
import numpy as np
import pytest

from hhsim.errors import DamagedFileError
from hhsim.system import child_reader, hdf5_input
from hhsim.system.atomic_write import sealed_hdf5
from hhsim.system.checksummed_file import SIZE, seal_file, seal_holds, sealed
from hhsim.system.hdf5_input import hdf5_format, open_hdf5

WRITERS = {
    "hhsim/result/writer.py",
    *("hhsim/system/atomic_write.py", "hhsim/recordings/formats/hhsim.py", "hhsim/recordings/formats/egodex.py"),
}
DOOR = {"hhsim/system/hdf5_input.py"}


def fill(file: h5py.File) -> None:
    file.attrs["format"] = "sample"
    file["number"] = np.arange(1000.0)
    file["word"] = np.array(["one", "two"], dtype=h5py.string_dtype())
    file["scalar"] = 3.0
    file["nothing"] = h5py.Empty("f8")


@pytest.fixture
def image() -> bytes:
    return sealed_hdf5(fill)[:-SIZE]


def test_only_the_door_opens_files_for_reading(repository: Path) -> None:
    opening = set()
    for path in (path for folder in ("hhsim", "cli", "tools") for path in (repository / folder).rglob("*.py")):
        source = path.read_text(encoding="utf-8")
        for node in ast.walk(ast.parse(source)) if "h5py" in source else ():
            if isinstance(node, ast.Call) and ast.unparse(node.func) == "h5py.File":
                opening.add(path.relative_to(repository).as_posix())
    assert opening == WRITERS | DOOR


def test_a_sound_file_is_read_with_its_seal_and_without(image: bytes, tmp_path: Path) -> None:
    for name, content in (("sealed.h5", sealed(image)), ("bare.h5", image)):
        path = tmp_path / name
        path.write_bytes(content)
        with open_hdf5(path) as file:
            assert file["number"][-1] == 999.0
            assert file["word"].asstr()[1] == "two"
        assert hdf5_format(path) == "sample"


def test_a_right_seal_vouches_for_no_content(shared_data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the file that is sealed over damaged bytes, the library's reading does not end."""
    monkeypatch.setattr(hdf5_input, "SECONDS", 0)
    with pytest.raises(DamagedFileError, match="reading it does not end within"):
        open_hdf5(shared_data / "hostile" / "sealed-trajectory.h5")


def test_sealing_a_file_is_sealing_its_bytes(image: bytes, tmp_path: Path) -> None:
    path = tmp_path / "file.h5"
    path.write_bytes(image + b"\0" * 5000)
    seal_file(path, len(image))
    assert path.read_bytes() == sealed(image)
    assert seal_holds(path) is True
    path.write_bytes(b"")
    assert seal_holds(path) is None


def test_no_byte_of_a_sealed_file_changes_unnoticed(image: bytes, tmp_path: Path) -> None:
    """Of the content by the seal; of the seal by the seal, or as what stands behind the end of an HDF5 file."""
    path, whole = tmp_path / "file.h5", sealed(image)
    random = np.random.default_rng(0)
    places = [*random.integers(0, len(image), 40), *range(len(image), len(whole), 9)]
    for place in places:
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 4]) + whole[place + 1 :])
        with pytest.raises(DamagedFileError):
            open_hdf5(path)
    for cut in (1, SIZE - 1, SIZE + 1):
        path.write_bytes(whole[:-cut])
        with pytest.raises(DamagedFileError):
            open_hdf5(path)


READERS: dict[str, tuple[Callable[..., object], str]] = {
    "processor": (lambda *_: all(itertools.repeat(True)), "reading it does not end within 1 s"),
    "wall clock": (lambda *_: time.sleep(1000), "reading it does not end within 1 s"),
    "crash": (lambda *_: os.abort(), "breaks down"),
    "memory": (lambda *_: bytearray(2 * child_reader.MEMORY), "takes more than 4 GB of memory"),
}


@pytest.mark.parametrize("case", READERS)
def test_a_reader_that_never_ends_or_breaks_down_takes_nothing_with_it(
    case: str, image: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    reader, why = READERS[case]
    (tmp_path / "bare.h5").write_bytes(image)
    monkeypatch.setattr(hdf5_input, "read_to_end", reader)
    monkeypatch.setattr(hdf5_input, "SECONDS", 0)
    patience = 0.1 if case == "wall clock" else child_reader.PATIENCE
    monkeypatch.setattr(hdf5_input, "read_in_child", partial(child_reader.read_in_child, patience=patience))
    with pytest.raises(DamagedFileError, match=why):
        open_hdf5(tmp_path / "bare.h5")
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("count", "size", "told"), [(1, 10**12, "/00 states 8,000,000,000,000"), (40, 1 << 25, "/01 states 268,435,456")]
)
def test_datasets_larger_than_their_file_are_not_read(tmp_path: Path, count: int, size: int, told: str) -> None:
    with h5py.File(tmp_path / "vast.h5", "w") as file:
        for number in range(count):
            file.create_dataset(f"{number:02}", shape=(size,), dtype="f8", chunks=(1 << 20,))
    with pytest.raises(DamagedFileError, match=f"{told} bytes, more than such a file holds"):
        open_hdf5(tmp_path / "vast.h5")


def test_what_is_no_hdf5_file_starts_no_child(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "text.h5"
    path.write_text("no HDF5" * 1000)
    monkeypatch.setattr(hdf5_input, "read_in_child", lambda *_, **__: pytest.fail("a child was started"))
    with pytest.raises(OSError, match="its signature is not there"):
        open_hdf5(path)
    assert hdf5_format(path) == ""


def test_a_file_that_is_being_written_says_so(tmp_path: Path) -> None:
    path = tmp_path / "file.h5"
    writes = "import h5py, sys; file = h5py.File(sys.argv[1], 'w'); file.flush(); print(flush=True); input()"
    command = [sys.executable, "-c", writes, str(path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as writer:
        assert writer.stdout is not None
        writer.stdout.readline()
        with pytest.raises(BlockingIOError) as caught:
            open_hdf5(path)
        assert caught.value.filename == str(path) and caught.value.strerror == "another process is writing it"
