"""Files that people name: no ordinary one, or a picture in the place of data, is told and keeps nobody waiting."""

import io
import os
import socket
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from PIL import Image

from hhsim.errors import InputError
from hhsim.mesh.file import read_triangles
from hhsim.recordings.registry import read_recording
from hhsim.result.reader import load_result
from hhsim.scene.motion_catalogue import resolve_trajectory
from hhsim.system.input_file import check_ordinary, media_kind, open_input, read_input, read_input_text
from hhsim.system.settings_file import read_toml_text


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
