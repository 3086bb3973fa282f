"""Files that people name: what is no ordinary one is refused, and keeps nobody waiting."""

import os
import socket
from pathlib import Path

import pytest

from hhsim.system.input_file import check_ordinary, open_input, read_input, read_input_text


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
