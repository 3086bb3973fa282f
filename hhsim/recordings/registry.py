"""Formats of recordings, each a module of `hhsim.recordings.formats`: their declaration, detection and reading."""

import importlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import InputError, OutputError, TrajectoryError, UnknownNameError, named
from hhsim.hand.configuration import HandConfiguration
from hhsim.recordings.content import ZIP, stated_hand
from hhsim.recordings.content import Content as Content
from hhsim.recordings.content import ReadOptions as ReadOptions
from hhsim.recordings.correction import Changes, Correction, changes
from hhsim.recordings.frames import FileFrame, axes_matrix
from hhsim.recordings.joint_positions import JointPositions as JointPositions
from hhsim.recordings.joint_positions import recording_of_joints
from hhsim.recordings.recording import Finding, HandMotion, Recording, note
from hhsim.system.atomic_write import write_atomically
from hhsim.system.input_file import media_kind

FORMATS_PACKAGE = "hhsim.recordings.formats"
"""Package that is imported by name, because the formats depend on this package."""


@dataclass(frozen=True)
class RecordingFormat:
    """Format of recordings."""

    name: str  # name of the format and of its module
    description: str  # one line about such a file
    suffixes: tuple[str, ...]  # suffixes of such files, such as ".npz"
    # Function that returns True for a content of this format; it may consult the options.
    sniff: Callable[[Content, ReadOptions], bool]
    # Function that reads the recording in a content, or the joint centres of which it is made. It raises
    # TrajectoryError for a damaged one and InputError for options that do not fit it, without the file's name.
    read: Callable[[Content, ReadOptions], Recording | JointPositions]
    rank: int = 0  # order of detection: formats with a signature (0), any JSON (1), any text (2)
    takes_columns: bool = False  # True if it takes `ReadOptions.columns`
    # Function that returns the content of the file with a recording of it corrected; nothing else in it changes, and
    # changes of angles are in its unit. None for a format that is not written back.
    write: Callable[[Content, ReadOptions, Recording, Changes], bytes] | None = None
    # Function that returns the content of a new file of one of `NEW_SUFFIXES`. None for a format in which none is made.
    make: Callable[[str, HandMotion], bytes] | None = None
    # Function that returns the MANO model's parameters in every sample, for the skin; None for a format without.
    mano: Callable[[Content, ReadOptions], tuple[FloatArray, FloatArray, FloatArray, FloatArray]] | None = None


def recording_formats() -> dict[str, RecordingFormat]:
    """Return every format by its name, in the order of detection."""
    formats: list[RecordingFormat] = list(importlib.import_module(FORMATS_PACKAGE).FORMATS.values())
    return {form.name: form for form in sorted(formats, key=lambda form: (form.rank, form.name))}


def recording_suffixes() -> tuple[str, ...]:
    """Return the suffixes of the files of all formats."""
    return tuple(dict.fromkeys(suffix for form in recording_formats().values() for suffix in form.suffixes))


def read_recording(path: str | Path, options: ReadOptions | None = None, original: Path | None = None) -> Recording:
    """Read a recording; `original` is the file that it was made from, beside which its object's poses may lie.

    Raises TrajectoryError, in one line that begins with the path, for no such file, an unknown format, or a damaged
    one; InputError for options that do not fit the file.
    """
    source = Path(path)
    if source.is_dir():
        raise TrajectoryError(f"{source}: a folder; expected a recording")
    with named(source):
        return read_content(Content.of_recording(source, original=original), options or ReadOptions())


def read_content(content: Content, options: ReadOptions) -> Recording:
    """Read the recording in the content of a file; errors as of `read_recording`."""
    form = format_of(content, options)
    if options.palm_axes is not None:
        axes_matrix(options.palm_axes, "--palm-axes")
    if options.columns is not None and not form.takes_columns:
        raise InputError(f"--columns explains a table, and this is {form.description}")
    recording = _read(form, content, options)
    # The archive has checked the CRC-32 of each array.
    proved = content.head.startswith(ZIP) and not content.packed
    recording = recording.changed(
        hand=options.hand or recording.hand,
        checksums=recording.checksums or ("held" if proved else "missing"),
        is_written_back=_is_written_back(form, content, options),
    )
    if recording.bones is None and recording.sample_count:
        recording = _with_stated_fields(recording, content, options)
    if options.mirror is not None:
        recording = recording.found(
            note(f"left-handed coordinates: {options.mirror} is turned round, as --mirror says")
        )
    return recording.found(*map(note, content.stated.told()))


def _read(form: RecordingFormat, content: Content, options: ReadOptions) -> Recording:
    found = form.read(content, options)
    recording = recording_of_joints(found, content, options) if isinstance(found, JointPositions) else found
    return recording.changed(form=recording.form or form.name, name=recording.name or content.name)


def _with_stated_fields(recording: Recording, content: Content, options: ReadOptions) -> Recording:
    """Return a recording of angles with the side and the unit that fields of its file state."""
    findings: list[Finding] = []
    side, shown = stated_hand(content, recording.hand, recording.rows, findings)
    recording = (recording if shown.all() else recording.chosen(shown)).changed(hand=side).found(*findings)
    frame = recording.file_frame
    if not recording.hand and (frame.flip > 0.0).all() and np.abs(frame.turn[2, 1]) == 1.0:
        text = "nothing names the hand; with y up its coordinates may be left-handed, as Unity's: --hand, --mirror z"
        recording = recording.found(note(text))
    stated = "length" in recording.stated or recording.scaled or options.length_unit is not None
    metre = None if stated else content.stated.take("unit") or content.stated.take("scale")
    if metre is not None:
        recording = recording.resized(metre).changed(stated=recording.stated | {"length"})
    return recording


def format_of(content: Content, options: ReadOptions) -> RecordingFormat:
    """Return the format that the user names, else the first that detects the content.

    Raises UnknownNameError for a format of another name, TrajectoryError for an empty file, or an unknown format.
    """
    formats = recording_formats()
    if options.form is not None:
        if options.form not in formats:
            raise UnknownNameError("format", options.form, formats)
        return formats[options.form]
    if not content.head.strip() and not content.data.strip():
        raise TrajectoryError("empty; expected a recording")
    if media := media_kind(content.head) or ("XML" if content.beginning.lstrip().startswith("<") else ""):
        raise TrajectoryError(f"{media}; expected a recording of one of {', '.join(formats)} (docs/recordings.md)")
    for form in formats.values():
        if form.sniff(content, options):
            return form
    raise TrajectoryError(f"neither text nor a known format; expected one of {', '.join(formats)} (docs/recordings.md)")


NEW_SUFFIXES = (".npz", ".csv")
"""Suffixes of a new file for a corrected recording whose format is not written back."""


def repaired_suffix(path: Path, options: ReadOptions) -> str:
    """Return the usual suffix of a corrected recording: that of its file, or `.npz` where it needs a new one."""
    content = Content(path)
    try:
        # The beginning of a pickle does: all of them are written back.
        return path.suffix if _is_written_back(format_of(content, options), content, options) else NEW_SUFFIXES[0]
    except InputError:
        # Whoever reads it says what is wrong.
        return path.suffix


def _is_written_back(form: RecordingFormat, content: Content, options: ReadOptions) -> bool:
    """Return False for a format that is read alone, for JSON, and for a table whose columns are mapped."""
    return form.write is not None and not content.is_json and options.columns is None


def check_target(source: Path, recording: Recording, target: Path) -> None:
    """Raise OutputError for a suffix in which a recording that was read from `source` is not written."""
    suffix = target.suffix.lower()
    if recording.is_written_back:
        if suffix != source.suffix.lower():
            raise OutputError(f"{target}: a corrected recording keeps its format; expected a name in {source.suffix}")
    elif suffix not in NEW_SUFFIXES:
        expected = " or ".join(NEW_SUFFIXES)
        raise OutputError(f"{target}: format {recording.form} is read and not written; expected a name in {expected}")


def write_recording(
    path: str | Path, options: ReadOptions, recording: Recording, correction: Correction, out: str | Path
) -> float | None:
    """Write a file with the recording that it holds corrected; a file of that name is replaced in one step.

    `path` is the file that the recording, or more samples of it, was read from by the same options.
    Where it is not written back, a new file has the samples of the recording alone: joints in the axes of the file [m],
    or, of a recording of angles, our hand in our world. Returns the largest distance of a joint read back from the
    corrected one [m]; None for a recording of angles, or a new file. Raises OutputError as `check_target`, or for no
    permission; InputError, in one line that begins with the path, for a correction that the file cannot hold.
    """
    source, target, frame = Path(path), Path(out), recording.file_frame
    check_target(source, recording, target)
    if not recording.is_written_back:
        suffix, joints = target.suffix.lower(), _axes(recording).to_file(correction.joints)
        # The stamps of a new file are those of the old one.
        motion = HandMotion(recording.time + recording.first_stamp, joints, correction.posture, recording.hand)
        form = "keypoints" if recording.joints is not None else suffix[1:]
        make = recording_formats()[form].make
        assert make is not None
        write_atomically(target, make(suffix, motion))
        return None
    with named(source):
        content = Content.of_recording(source)
        kind, off = format_of(content, options), None
        data = content.packed or content.data
        if correction.changed.any():
            assert kind.write is not None
            made = changes(recording, correction)
            data = content.packed_with(kind.write(content, options, recording, made))
        if recording.joints is not None:
            again = _read(kind, Content.of_recording(source, data), replace(options, fits_angles=False))
            assert again.joints is not None
            place = {row: k for k, row in enumerate(again.rows.tolist())}
            found = again.file_frame.to_file(again.joints[[place[row] for row in recording.rows.tolist()]])
            apart = frame.metre * np.linalg.norm(found - frame.to_file(correction.joints), axis=2)
            off = float(apart[np.isfinite(apart)].max(initial=0.0))
    write_atomically(target, data)
    return off


def read_new_file(path: Path, recording: Recording) -> Recording:
    """Return a recording with the hand of the new file that `write_recording` made of it."""
    if recording.joints is None:
        again = read_recording(path, ReadOptions(hand=recording.hand))
        return recording.changed(**{name: getattr(again, name) for name in HandConfiguration._fields})
    options = ReadOptions(form="keypoints", hand=recording.hand, world_up="z", length_unit="m", fits_angles=False)
    again = read_recording(path, options)
    assert again.joints is not None
    return recording.changed(joints=_axes(recording).to_world(again.joints))


def _axes(recording: Recording) -> FileFrame:
    """Return the axes of the recording's file, in metres, right-handed also where the file is not."""
    return FileFrame(recording.file_frame.turn)
