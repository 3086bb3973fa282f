"""Files as hhsim reads and writes them: HDF5 of strangers, limits of a child, whole or not at all."""

import ast
import io
import itertools
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from PIL import Image

from hhsim.errors import DamagedFileError, InputError, OutputError, UnknownNameError
from hhsim.mesh import file as mesh_file
from hhsim.mesh.file import read_triangles
from hhsim.motion import pickled_data
from hhsim.recordings.registry import read_recording
from hhsim.result.reader import load_result
from hhsim.scene.motion_catalogue import resolve_trajectory
from hhsim.system import child_reader, hdf5_input, input_file
from hhsim.system.atomic_write import sealed_hdf5, write_together
from hhsim.system.checksummed_file import SIZE, seal_file, seal_holds, sealed
from hhsim.system.child_reader import read_in_child
from hhsim.system.deferred_sigint import interruptible_between
from hhsim.system.hdf5_input import hdf5_format, open_hdf5
from hhsim.system.input_file import check_ordinary, media_kind, open_input, read_input, read_input_text
from hhsim.system.settings_file import read_toml_text

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
        writer.stdout.readline()
        with pytest.raises(BlockingIOError) as caught:
            open_hdf5(path)
        assert caught.value.filename == str(path) and caught.value.strerror == "another process is writing it"


def test_an_ordinary_file_is_read(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes("\ufeffone\r\ntwo µm\n".encode())
    assert read_input(path) == path.read_bytes()
    assert read_input_text(path, "utf-8-sig") == path.read_text(encoding="utf-8-sig") == "one\ntwo µm\n"
    assert read_input_text(path, "ascii", "replace") == path.read_text("ascii", "replace")
    link = tmp_path / "link"
    link.symlink_to(path)
    assert read_input(link) == path.read_bytes()


def test_a_pipe_a_device_and_a_socket_are_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind(str(tmp_path / "socket"))
        for path, kind in ((tmp_path / "pipe", "named pipe"), (tmp_path / "socket", "socket"), ("/dev/zero", "device")):
            with pytest.raises(OSError, match=f"a {kind}, no ordinary file"):
                open_input(Path(path))


def test_a_pipe_that_takes_the_place_of_a_file_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Between the look at its name and the opening."""
    os.mkfifo(tmp_path / "pipe")
    monkeypatch.setattr("hhsim.system.input_file.check_ordinary", lambda *_: None)
    with pytest.raises(OSError, match="a named pipe, no ordinary file"):
        open_input(tmp_path / "pipe")


def test_a_folder_is_no_file_and_nothing_is_none(tmp_path: Path) -> None:
    check_ordinary(tmp_path)
    with pytest.raises(IsADirectoryError):
        open_input(tmp_path)
    with pytest.raises(FileNotFoundError):
        open_input(tmp_path / "none")


def test_a_file_that_is_too_large_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "sparse"
    with path.open("wb") as file:
        file.truncate(1 << 40)
    with pytest.raises(OSError, match="1,099,511,627,776 bytes, more than such a file has"):
        read_input(path)
    with open_input(path) as opened:
        assert opened.read(3) == bytes(3)


def picture(form: str) -> bytes:
    buffer = io.BytesIO()
    Image.new("RGB", (4, 3)).save(buffer, format=form)
    return buffer.getvalue()


@pytest.mark.parametrize(
    ("head", "kind"),
    [
        (b"\0\0\0 ftypisom", "a video (MP4)"),
        (b"RIFF\x10\0\0\0AVI LIST", "a video (AVI)"),
        (b"\x89HDF\r\n\x1a\n", ""),
        (b"solid cube", ""),
    ],
)
def test_other_media_are_told_and_data_is_none(head: bytes, kind: str) -> None:
    assert media_kind(head) == kind


@pytest.mark.parametrize(
    "read", [load_result, read_triangles, resolve_trajectory, read_recording, partial(read_toml_text, what="x")]
)
def test_whatever_reads_a_picture_says_that_it_is_one(read: Callable[[Path], Any], tmp_path: Path) -> None:
    path = tmp_path / "picture.png"
    path.write_bytes(picture("PNG"))
    with pytest.raises(InputError, match=r"a picture \(PNG\).*(expected|not a result)"):
        read(path)


def failing(error: BaseException) -> None:
    raise error


def slept(seconds: float) -> float:
    time.sleep(seconds)
    return seconds


def test_what_is_read_comes_back_whole() -> None:
    values = np.random.default_rng(0).standard_normal((1000, 3))
    found, name = read_in_child(lambda: (values, "name"), "a damaged file")
    assert found.tobytes() == values.tobytes()
    assert name == "name"


def test_errors_of_hhsim_come_back_as_they_are_and_others_as_damage() -> None:
    with pytest.raises(UnknownNameError) as caught:
        read_in_child(lambda: failing(UnknownNameError("link", "tip", ["top"])), "a damaged file")
    assert str(caught.value) == "unknown link 'tip': did you mean top?"
    with pytest.raises(DamagedFileError, match=r"^a damaged file: a b$"):
        read_in_child(lambda: failing(RuntimeError("a\nb")), "a damaged file")
    with pytest.raises(DamagedFileError, match=r"^a damaged file: KeyError$"):
        read_in_child(lambda: failing(KeyError()), "a damaged file")
    with pytest.raises(DamagedFileError, match="its reader breaks down"):
        read_in_child(lambda: failing(SystemExit(3)), "a damaged file")


def test_the_page_on_security_states_the_limits_as_they_are(repository: Path) -> None:
    text = " ".join((repository / "SECURITY.md").read_text(encoding="utf-8").split())
    for stated in (
        f"after {child_reader.SECONDS:g} s of the processor's time and a second more for each MB (HDF5: "
        f"{hdf5_input.SECONDS:g} s, and one for each {hdf5_input.BYTES_PER_SECOND / 1e6:g} MB)",
        f"has {child_reader.MEMORY >> 30} GiB of memory and {child_reader.MEMORY_PER_BYTE} bytes for each byte",
        f"| {input_file.MOST_BYTES >> 30} GB at most, and what is packed unpacks to {input_file.ALWAYS >> 20} MiB",
        f"holds more than {pickled_data.MOST_VALUES // 1_000_000} million values",
    ):
        assert stated in text
    assert (child_reader.BYTES_PER_SECOND, input_file.PER_BYTE, mesh_file.MEMORY_OF_A_BYTE) == (1e6, 100, 10)


def test_a_larger_file_has_more_time() -> None:
    with pytest.raises(DamagedFileError, match="does not end within 1 s"):
        read_in_child(lambda: time.sleep(5), "a damaged file", seconds=0, patience=0.05)
    assert read_in_child(lambda: slept(0.1), "", 1000, seconds=0, rate=100, patience=0.05) == 0.1


def test_a_reader_within_a_reader_shares_its_limits() -> None:
    """The inner one, with less time, is called in the same child."""

    def outer() -> float:
        return read_in_child(lambda: slept(0.2), "inner", seconds=0, patience=0.05)

    assert read_in_child(outer, "outer") == 0.2


def test_a_full_disk_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    path.write_bytes(b"old")
    script = """
import resource, sys
from pathlib import Path
from hhsim.errors import OutputError
from hhsim.system.atomic_write import sealed_hdf5, write_atomically, write_together
resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, 10_000))
try:
    write_atomically(Path(sys.argv[1]), sealed_hdf5(lambda file: file.create_dataset("a", data=[0.0] * 9_000)))
except OutputError as error:
    print(error)
"""
    run = subprocess.run([sys.executable, "-c", script, str(path)], capture_output=True, text=True)
    assert (run.returncode, run.stderr) == (0, "")
    assert run.stdout.startswith(f"cannot write {path}: ")
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_files_appear_together_or_not_at_all(tmp_path: Path) -> None:
    first, last = tmp_path / "first", tmp_path / "last"
    write_together({first: b"1", last: b"2"})
    with pytest.raises(OutputError, match=r"cannot write .*none/last"):
        write_together({first: b"3", tmp_path / "none" / "last": b"4"})
    assert (first.read_bytes(), last.read_bytes()) == (b"1", b"2")
    assert sorted(tmp_path.iterdir()) == [first, last]


def test_an_interrupt_waits_for_the_end_of_the_block() -> None:
    done = []
    with pytest.raises(KeyboardInterrupt), interruptible_between() as check:
        for block in range(3):
            if block == 1:
                signal.raise_signal(signal.SIGINT)
            done.append(block)
            check()
    assert done == [0, 1]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_a_second_interrupt_does_not_wait() -> None:
    done = False
    with pytest.raises(KeyboardInterrupt), interruptible_between():
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGINT)
        done = True
    assert not done


def test_an_ignored_interrupt_stays_ignored() -> None:
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with interruptible_between() as check:
            signal.raise_signal(signal.SIGINT)
            check()
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)
