"""Formats of recordings, each a module of `hhsim.recordings.formats`: their declaration, detection, reading, writing.

A corrected hand is the rigid motion of each recorded bone: what our hand model does not fit stays as recorded.
"""

import importlib
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from hhsim.arrays import BoolArray, FloatArray, IntArray
from hhsim.errors import DamagedFileError, InputError, OutputError, TrajectoryError, UnknownNameError, named
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.quaternion import quaternion_from_matrix, quaternion_product
from hhsim.recordings.content import ZIP
from hhsim.recordings.content import Content as Content
from hhsim.recordings.content import ReadOptions as ReadOptions
from hhsim.recordings.frames import FileFrame, axes_matrix
from hhsim.recordings.joint_names import KEYPOINTS
from hhsim.recordings.joint_positions import JointPositions as JointPositions
from hhsim.recordings.joint_positions import recording_of_joints
from hhsim.recordings.recording import Recording
from hhsim.recordings.unit_detection import in_our_units
from hhsim.system.atomic_write import write_atomically
from hhsim.system.input_file import media_kind

_OTHERS: dict[str, bytes] = {
    "an animation (FBX, glTF, USD, MVNX, …) is not read; export its skeleton as BVH": (
        rb'glTF|\{.*(?:"asset"\s*:\s*\{[^}]*"version"|"bufferViews?"\s*:)|'
        rb"Kaydara FBX Binary|;\s*FBX |FBXHeaderExtension|#usda |PXR-USDC|BLENDER[-_0-9]|//Maya |"
        rb"(?:<\?xml.*?)?<(?:COLLADA|mvnx)"
    ),
    "an export of markers (Motive, Vicon, Qualisys, TRC, C3D) is not read; export the solved skeleton as BVH, or joint "
    "positions as a CSV": rb"Format Version,|(?:Trajectories|Segments|Joints)\s*\n\s*[0-9]+|PathFileType\t|\x02\x50",
    "a database, such as a bag of ROS, is not read; write the joints of its topic as a CSV with a header": (
        rb"#ROSBAG |SQLite format 3\0"
    ),
}
"""Files in which people keep hands and which are not read, with what to do instead, by their beginnings."""
FORMATS_PACKAGE = "hhsim.recordings.formats"
"""Package that is imported by name, because the formats depend on this package."""


BONES = 16
"""Bones of a hand: the palm, then three phalanges a finger from its base, thumb to little finger."""
ANGLE_DIGITS = 7
"""Decimals of an angle [rad] or of a quaternion's component in a text: 0.01 µm at a fingertip."""


@dataclass(frozen=True, eq=False)
class Correction:
    """Corrected hand of each sample of a recording, in our world."""

    fitted: HandConfiguration  # our hand fitted to each recorded sample
    posture: HandConfiguration  # our hand after the correction; equal to `fitted` in samples without one
    rotation: FloatArray  # rotation of each bone from the recorded to the corrected hand, shape (T, 16, 3, 3)
    # Corrected joint centres in the order of `hhsim.recordings.joint_names.KEYPOINTS` [m], shape (T, 21, 3); NaN where
    # the recording has none.
    joints: FloatArray
    changed: BoolArray  # samples with a correction, shape (T,)


class Changes(NamedTuple):
    """Samples of a recording with a correction, in the coordinates of its file."""

    rows: IntArray  # rows of the file, shape (N,)
    shift: FloatArray  # displacement of the 21 joints, shape (N, 21, 3); NaN for a recording of angles
    turn: FloatArray  # rotation of each bone, shape (N, 16, 3, 3)
    centre: FloatArray  # palm origin of the fitted hand, shape (N, 3)
    move: FloatArray  # displacement of the palm origin, shape (N, 3)
    angles: FloatArray  # change of flexion finger by finger, then abduction [unit of the file], shape (N, 20)
    digits: int  # decimals of a length in a text that hold 1 µm

    def moved(self, joint: str, points: FloatArray) -> FloatArray:
        """Move points of one of OpenXR's joints, shape (N, 3); those beyond the 21 move with the palm."""
        if joint in KEYPOINTS:
            return np.asarray(points + self.shift[:, KEYPOINTS.index(joint)])
        turned = (self.turn[:, 0] @ (points - self.centre)[..., None])[..., 0]
        return np.asarray(turned + self.centre + self.move)

    def motion(
        self, position: FloatArray, orientation: FloatArray, flexion: FloatArray, abduction: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return all samples of palm poses and of angles with the changes; NaN stays what it was.

        The shapes are (T, 3), (T, 4), (T, 5, 3) and (T, 5).
        """
        given, rows = (position.copy(), orientation.copy(), flexion.copy(), abduction.copy()), self.rows
        new = (
            self.moved("palm", position[rows]),
            quaternion_product(quaternion_from_matrix(self.turn[:, 0]), orientation[rows]),
            flexion[rows] + self.angles[:, :15].reshape(-1, 5, 3),
            abduction[rows] + self.angles[:, 15:],
        )
        for values, corrected in zip(given, new):
            values[rows] = np.where(np.isfinite(corrected), corrected, values[rows])
        return given


def changes(recording: Recording, correction: Correction) -> Changes:
    """Express a correction in the coordinates of the recording's file; InputError for joints without a world frame."""
    if recording.joints is None and recording.bones is not None:
        raise InputError("the joints have no world frame, so they cannot be corrected in the file: say --world-up")
    samples = np.flatnonzero(correction.changed)
    frame, fitted, posture = recording.file_frame, correction.fitted.at(samples), correction.posture.at(samples)
    shift = np.full((len(samples), len(KEYPOINTS), 3), np.nan)
    if recording.joints is not None:
        shift = frame.to_file(correction.joints[samples] - recording.joints[samples])
    flexion = (posture.flexion - fitted.flexion).reshape(-1, 15)
    return Changes(
        rows=recording.rows[samples],
        shift=shift,
        turn=frame.rotation_to_file(correction.rotation[samples]),
        centre=frame.to_file(fitted.position),
        move=frame.to_file(posture.position - fitted.position),
        angles=np.concatenate([flexion, posture.abduction - fitted.abduction], axis=1) / recording.angle_unit,
        digits=max(0, int(np.ceil(6.0 + np.log10(frame.metre) - 1e-9))),
    )


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
    write: Callable[[Content, ReadOptions, Changes], bytes] | None = None
    # Function that returns the content of a new file of a suffix of `NEW_SUFFIXES`; None for a format without.
    make: Callable[[str, Recording], bytes] | None = None
    # Function that returns the MANO model of a hand and its parameters in every sample, for the skin; None without.
    mano: Callable[[Content, ReadOptions], tuple[Any, ...]] | None = None


def recording_formats() -> dict[str, RecordingFormat]:
    """Return every format by its name, in the order of detection."""
    formats: list[RecordingFormat] = list(importlib.import_module(FORMATS_PACKAGE).FORMATS.values())
    return {form.name: form for form in sorted(formats, key=lambda form: (form.rank, form.name))}


def recording_suffixes() -> tuple[str, ...]:
    """Return the suffixes of the files of all formats."""
    return tuple(dict.fromkeys(suffix for form in recording_formats().values() for suffix in form.suffixes))


def read_recording(path: str | Path, options: ReadOptions | None = None, original: Path | None = None) -> Recording:
    """Read a recording, in our units.

    `original` is the file that it was made from, beside which its object's poses may lie.

    Raises TrajectoryError, in one line that begins with the path, for no such file, an unknown format, or a damaged
    one; InputError for options that do not fit the file.
    """
    source = Path(path)
    if source.is_dir():
        raise TrajectoryError(f"{source}: a folder; expected a recording")
    with named(source):
        return read_content(Content(source, original=original), options or ReadOptions())


def read_content(content: Content, options: ReadOptions) -> Recording:
    """Read the recording in the content of a file, in our units; errors as of `read_recording`."""
    form = format_of(content, options)
    if options.palm_axes is not None:
        axes_matrix(options.palm_axes, "--palm-axes")
    if options.columns is not None and not form.takes_columns:
        raise InputError(f"--columns explains a table, and this is {form.description}")
    recording = _read(form, content, options)
    recording = recording.changed(
        hand=options.hand or recording.hand,
        # An archive has checked the CRC-32 of each array.
        checksums=recording.checksums or ("held" if content.head.startswith(ZIP) else "missing"),
        is_written_back=_is_written_back(form, content, options),
    )
    if recording.bones is None and recording.sample_count:
        recording = _with_stated_fields(recording, content, options)
    if options.mirror is not None:
        content.note(f"left-handed coordinates: {options.mirror} is turned round, as --mirror says")
    content.note(*content.stated.told())
    return in_our_units(recording.found(*content.told()), options)


def _read(form: RecordingFormat, content: Content, options: ReadOptions) -> Recording:
    try:
        found = form.read(content, options)
    except DamagedFileError as error:
        raise TrajectoryError(str(error)) from None
    except ModuleNotFoundError as error:
        library = str(error.name).partition(".")[0]
        how = f"pip install 'hhsim[recordings]', or {library}"
        raise TrajectoryError(f"{form.description}, is read by {library}: {how}") from None
    recording = recording_of_joints(found, content, options) if isinstance(found, JointPositions) else found
    recording = recording.changed(form=recording.form or form.name, name=recording.name or content.name)
    return recording.found(*content.told())


def _with_stated_fields(recording: Recording, content: Content, options: ReadOptions) -> Recording:
    """Return a recording of angles with the side and the unit that fields of its file state."""
    side, frame = content.stated_hand(recording.hand), recording.file_frame
    recording = recording.changed(hand=side)
    if not side and (frame.flip > 0.0).all() and np.abs(frame.turn[2, 1]) == 1.0:
        unsure = "with y up its coordinates may be left-handed, as Unity's: --hand, --mirror z"
        content.note(f"nothing names the hand; {unsure}")
    stated = "length" in recording.stated or options.length_unit is not None
    metre = None if stated else content.stated.take("unit")
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
    head = content.head.removeprefix(b"\xef\xbb\xbf").lstrip()
    for reason, begins in _OTHERS.items():
        if re.match(begins, head, re.DOTALL):
            raise TrajectoryError(f"{reason} (docs/recordings.md)")
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
        is_same = _is_written_back(format_of(content, options), content, options)
    except InputError:
        # Whoever reads it says what is wrong.
        is_same = True
    return path.suffix if is_same else NEW_SUFFIXES[0]


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
        # Right-handed and in metres, also where the file is not.
        suffix, joints = target.suffix.lower(), FileFrame(frame.turn).to_file(correction.joints)
        # The stamps of a new file are those of the old one.
        given = correction.posture._asdict() | {"time": recording.time + recording.first_stamp, "joints": joints}
        form = "keypoints" if recording.joints is not None else suffix[1:]
        make = recording_formats()[form].make
        assert make is not None
        write_atomically(target, make(suffix, recording.changed(**given)))
        return None
    with named(source):
        content = Content(source)
        kind, off, data = format_of(content, options), None, content.data
        if correction.changed.any():
            assert kind.write is not None
            data = kind.write(content, options, changes(recording, correction))
        if recording.joints is not None:
            again = _read(kind, Content(source, data=data), replace(options, fits_angles=False))
            assert again.joints is not None
            place = {row: k for k, row in enumerate(again.rows.tolist())}
            found = again.file_frame.to_file(again.joints[[place[row] for row in recording.rows.tolist()]])
            apart = frame.metre * np.linalg.norm(found - frame.to_file(correction.joints), axis=2)
            off = float(apart[np.isfinite(apart)].max(initial=0.0))
    write_atomically(target, data)
    return off
