"""Formats of recordings, one a module of the same name with its record `FORMAT`; there is no other list."""

from typing import TYPE_CHECKING

from hhsim.registry import Registry

if TYPE_CHECKING:
    from hhsim.recordings.registry import RecordingFormat

FORMATS: "Registry[RecordingFormat]" = Registry(__name__, "FORMAT", "format", group="hhsim.formats")
"""Formats by name, those of installed packages included."""
