"""Registry of recording formats: their detection, and reading of a file as a `Recording`."""

import importlib
from pathlib import Path

from hhsim.errors import InputError, TrajectoryError, UnknownNameError
from hhsim.recordings.frames import axes_matrix
from hhsim.recordings.recording import Recording
from hhsim.recordings.recording_format import Content, ReadOptions, RecordingFormat
from hhsim.system.media_kind import media_kind

FORMATS_PACKAGE = "hhsim.recordings.formats"
"""Package that is imported by name, because the formats depend on this package."""


def recording_formats() -> dict[str, RecordingFormat]:
    """Return every format by its name, in the order of detection."""
    names = importlib.import_module(FORMATS_PACKAGE).format_names()
    formats: list[RecordingFormat] = [importlib.import_module(f"{FORMATS_PACKAGE}.{name}").FORMAT for name in names]
    return {form.name: form for form in sorted(formats, key=lambda form: (form.rank, form.name))}


def recording_suffixes() -> tuple[str, ...]:
    """Return the suffixes of the files of all formats."""
    return tuple(dict.fromkeys(suffix for form in recording_formats().values() for suffix in form.suffixes))


def read_recording(path: str | Path, options: ReadOptions | None = None) -> Recording:
    """Read a recording.

    Raises:
        TrajectoryError: No such file, an unknown format, or a damaged one; one line that begins with the path.
        InputError: Options that do not fit the file.
    """
    source = Path(path)
    if source.is_dir():
        raise TrajectoryError(f"{source}: a folder; expected a recording")
    try:
        return read_content(Content(source), options or ReadOptions())
    except InputError as error:
        kind = TrajectoryError if isinstance(error, TrajectoryError) else InputError
        message = str(error)
        raise kind(message if message.startswith(f"{source}: ") else f"{source}: {message}") from None


def read_content(content: Content, options: ReadOptions) -> Recording:
    """Read the recording in the content of a file; errors as of `read_recording`."""
    form = format_of(content, options)
    if options.palm_axes is not None:
        axes_matrix(options.palm_axes, "--palm-axes")
    if options.columns is not None and not form.takes_columns:
        raise InputError(f"--columns explains a table, and this is {form.description}")
    recording = form.read(content, options)
    return recording.changed(hand=options.hand or recording.hand, checksums=recording.checksums or "missing")


def format_of(content: Content, options: ReadOptions) -> RecordingFormat:
    """Return the format that the user names, else the first that detects the content.

    Raises:
        UnknownNameError: No format has that name.
        TrajectoryError: Nothing in the file, or an unknown format.
    """
    formats = recording_formats()
    if options.form is not None:
        if options.form not in formats:
            raise UnknownNameError("format", options.form, formats)
        return formats[options.form]
    if not content.head.strip() and not content.data.strip():
        raise TrajectoryError("empty; expected a recording")
    media = media_kind(content.head)
    if media:
        raise TrajectoryError(f"{media}; expected a recording of one of {', '.join(formats)}")
    form = next((form for form in formats.values() if form.sniff(content, options)), None)
    if form is None:
        raise TrajectoryError(f"neither text nor a known format; expected one of {', '.join(formats)}")
    return form
