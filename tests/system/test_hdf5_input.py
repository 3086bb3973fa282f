"""No HDF5 file is parsed before its seal or a child process has vouched for it, and nothing goes past that door."""

import ast
import signal
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest

from hhsim.errors import DamagedFileError
from hhsim.system import hdf5_input, hdf5_probe
from hhsim.system.atomic_write import sealed_hdf5
from hhsim.system.checksummed_file import SIZE, seal_file, seal_holds, sealed
from hhsim.system.hdf5_input import hdf5_format, open_hdf5

WRITERS = {"hhsim/result/writer.py", "hhsim/system/atomic_write.py"}
DOOR = {"hhsim/system/hdf5_input.py", "hhsim/system/hdf5_probe.py"}


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
    for path in [*(repository / "hhsim").rglob("*.py"), *(repository / "cli").rglob("*.py")]:
        source = path.read_text(encoding="utf-8")
        for node in ast.walk(ast.parse(source)) if "h5py" in source else ():
            if isinstance(node, ast.Call) and ast.unparse(node.func) == "h5py.File":
                opening.add(path.relative_to(repository).as_posix())
    assert opening == WRITERS | DOOR


def test_a_sealed_file_needs_no_child(image: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "sealed.h5"
    path.write_bytes(sealed(image))
    monkeypatch.setattr(hdf5_input, "_read_by_child", lambda path: pytest.fail("a child was started"))
    with open_hdf5(path) as file:
        assert file["number"][-1] == 999.0
    assert hdf5_format(path) == "sample"


def test_a_file_without_a_seal_is_read_once_by_a_child(image: bytes, tmp_path: Path) -> None:
    path = tmp_path / "bare.h5"
    path.write_bytes(image)
    with open_hdf5(path) as file:
        assert file["word"].asstr()[1] == "two"


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


@pytest.mark.parametrize(
    "never_ends", ["import time\ntime.sleep(1000)\n", "import os, signal\nos.kill(os.getpid(), signal.SIGXCPU)\n"]
)
def test_a_reader_that_never_ends_is_ended(
    never_ends: str, image: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By the wall clock; or by the system, once it has used its time of the processor."""
    path, script = tmp_path / "bare.h5", tmp_path / "reader.py"
    path.write_bytes(image)
    script.write_text(never_ends)
    monkeypatch.setattr(hdf5_probe, "__file__", str(script))
    monkeypatch.setattr(hdf5_input, "PATIENCE", 0.1 if "sleep" in never_ends else 10.0)
    with pytest.raises(DamagedFileError, match="reading it does not end within"):
        open_hdf5(path)


def test_the_probe_is_ended_where_its_time_of_the_processor_is_used() -> None:
    spins = "import itertools, pathlib, sys, runpy\nprobe = runpy.run_path(sys.argv[1])\n"
    spins += "probe['main'].__globals__['_read'] = lambda path: all(itertools.repeat(True))\n"
    spins += "probe['main'](pathlib.Path('any'), 1)"
    done = subprocess.run([sys.executable, "-c", spins, hdf5_probe.__file__], check=False)
    assert done.returncode == -signal.SIGXCPU


def test_a_reader_that_breaks_down_takes_nothing_with_it(
    image: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, script = tmp_path / "bare.h5", tmp_path / "crash.py"
    path.write_bytes(image)
    script.write_text("import os\nos.abort()\n")
    monkeypatch.setattr(hdf5_probe, "__file__", str(script))
    with pytest.raises(DamagedFileError, match="breaks down"):
        open_hdf5(path)


def test_a_dataset_larger_than_its_file_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "vast.h5"
    with h5py.File(path, "w") as file:
        file.create_dataset("vast", shape=(10**12,), dtype="f8", chunks=(1000,))
    with pytest.raises(DamagedFileError, match="/vast states 8,000,000,000,000 bytes, more than such a file holds"):
        open_hdf5(path)


def test_what_is_no_hdf5_file_starts_no_child(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "text.h5"
    path.write_text("no HDF5" * 1000)
    monkeypatch.setattr(sys, "executable", str(tmp_path / "none"))
    with pytest.raises(OSError, match="its signature is not there"):
        open_hdf5(path)
    assert hdf5_format(path) == ""


def test_a_file_that_is_being_written_says_so(tmp_path: Path) -> None:
    path = tmp_path / "file.h5"
    with h5py.File(path, "w") as file:
        file.attrs["format"] = "sample"
        file.flush()
        with pytest.raises(BlockingIOError):
            open_hdf5(path)
