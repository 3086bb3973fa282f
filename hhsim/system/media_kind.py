"""Detection of pictures, videos, sounds and documents by their first bytes."""

from pathlib import Path

from hhsim.system.input_file import open_input

_STARTS: tuple[tuple[bytes, str], ...] = (
    (b"\x89PNG\r\n\x1a\n", "a picture (PNG)"),
    (b"\xff\xd8\xff", "a picture (JPEG)"),
    (b"GIF8", "a picture (GIF)"),
    (b"II*\x00", "a picture (TIFF)"),
    (b"MM\x00*", "a picture (TIFF)"),
    (b"<svg", "a picture (SVG)"),
    (b"\x1aE\xdf\xa3", "a video (Matroska or WebM)"),
    (b"OggS", "a sound or a video (Ogg)"),
    (b"ID3", "a sound (MP3)"),
    (b"%PDF-", "a document (PDF)"),
    (b"<!DOCTYPE html", "a page (HTML)"),
    (b"<!doctype html", "a page (HTML)"),
)
_IN_RIFF = {b"WEBP": "a picture (WebP)", b"AVI ": "a video (AVI)", b"WAVE": "a sound (WAV)"}
_HEAD_BYTES = 16


def media_kind(head: bytes) -> str:
    """Return what a file with these first bytes is, as "a picture (PNG)"; "" for none of them."""
    if head[:4] == b"RIFF":
        return _IN_RIFF.get(head[8:12], "")
    if head[4:8] == b"ftyp":
        # HEIF and AVIF are pictures in the same box as films.
        return "a picture (HEIF)" if head[8:12] in (b"heic", b"heix", b"mif1", b"avif") else "a video (MP4)"
    return next((kind for start, kind in _STARTS if head.startswith(start)), "")


def media_kind_of(path: Path) -> str:
    """Return the kind of a file; "" if it cannot be read."""
    try:
        with open_input(path) as file:
            return media_kind(file.read(_HEAD_BYTES))
    except OSError:
        return ""
