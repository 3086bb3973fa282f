"""A picture or a video in the place of data is called what it is, whatever its name says, by everything that reads."""

import io
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
from hhsim.system.media_kind import media_kind, media_kind_of
from hhsim.system.settings_file import read_toml_text
from hhsim.view.gallery import file_kind


def picture(form: str) -> bytes:
    buffer = io.BytesIO()
    Image.new("RGB", (4, 3)).save(buffer, format=form)
    return buffer.getvalue()


@pytest.mark.parametrize("form", ["PNG", "JPEG", "GIF", "TIFF"])
def test_a_picture_is_known_by_its_first_bytes(form: str) -> None:
    assert media_kind(picture(form)) == f"a picture ({form})"


@pytest.mark.parametrize(
    ("head", "kind"),
    [
        (b"\0\0\0 ftypisom", "a video (MP4)"),
        (b"\0\0\0 ftypavif", "a picture (HEIF)"),
        (b"RIFF\x10\0\0\0AVI LIST", "a video (AVI)"),
        (b"\x1aE\xdf\xa3", "a video (Matroska or WebM)"),
        (b"%PDF-1.7", "a document (PDF)"),
        (b"\x89HDF\r\n\x1a\n", ""),
        (b"solid cube", ""),
        (b"time,position", ""),
        (b"", ""),
    ],
)
def test_other_media_are_told_and_data_is_none(head: bytes, kind: str) -> None:
    assert media_kind(head) == kind


@pytest.mark.parametrize(
    "read",
    [file_kind, load_result, read_triangles, resolve_trajectory, read_recording, partial(read_toml_text, what="x")],
)
def test_whatever_reads_a_picture_says_that_it_is_one(read: Callable[[Path], Any], tmp_path: Path) -> None:
    path = tmp_path / "picture.png"
    path.write_bytes(picture("PNG"))
    with pytest.raises(InputError, match=r"a picture \(PNG\).*(expected|not a result)"):
        read(path)


def test_no_file_is_no_picture(tmp_path: Path) -> None:
    assert media_kind_of(tmp_path / "none.png") == media_kind_of(tmp_path) == ""
