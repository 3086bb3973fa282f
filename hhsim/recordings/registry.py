"""Formats of recordings, each a module of `hhsim.recordings.formats`: their declaration, detection and reading."""

import importlib
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, Self

import numpy as np

from hhsim.arrays import AnyArray, BoolArray, FloatArray
from hhsim.errors import DamagedFileError, InputError, OutputError, TrajectoryError, UnknownNameError, named
from hhsim.hand.configuration import HandConfiguration
from hhsim.motion.csv_table import read_header, read_remarks, read_table
from hhsim.motion.npz_arrays import npz_of, read_npz
from hhsim.motion.pickled_data import flat, npy_dictionary, pickled_arrays, pickled_with
from hhsim.motion.text_edit import NumberEdit, edited
from hhsim.motion.trajectory import HandSide
from hhsim.recordings.column_map import ColumnMap
from hhsim.recordings.correction import Correction
from hhsim.recordings.dexmo_regression import DexmoRegression, Poses
from hhsim.recordings.frames import FileFrame, axes_matrix
from hhsim.recordings.joint_names import StatedFields, kind_of
from hhsim.recordings.json_document import nested, read_json
from hhsim.recordings.recording import Finding, HandMotion, Recording, chosen_side, note
from hhsim.system.atomic_write import write_atomically
from hhsim.system.input_file import media_kind, open_input, read_input

FORMATS_PACKAGE = "hhsim.recordings.formats"
"""Package that is imported by name, because the formats depend on this package."""
MOST_BYTES = 1 << 30
"""Size of the largest file that is read [byte]."""
HEAD_BYTES = 4096
"""Size of the beginning of a file that tells its format [byte]."""
MOST_UNREADABLE = 0.1
"""Largest share of characters of a text that cannot be decoded."""

_ANIMATION = "is not read; export its skeleton as BVH"
_MARKERS = "is not read; export the solved skeleton as BVH, or joint positions as a CSV (docs/recordings.md)"
_TOPIC = "is not read; write the joints of its topic as a CSV with a header (docs/recordings.md)"
_PACKED = "is not unpacked here; expected the recording in it"

_BEGINNINGS: tuple[tuple[bytes, str], ...] = (
    (rb"Kaydara FBX Binary|;\s*FBX |FBXHeaderExtension", f"an animation in FBX {_ANIMATION}"),
    (rb"glTF", f"an animation in glTF {_ANIMATION}"),
    (rb'\{.*(?:"asset"\s*:\s*\{[^}]*"version"|"bufferViews?"\s*:)', f"an animation in glTF {_ANIMATION}"),
    (rb"#usda |PXR-USDC", f"an animation in USD {_ANIMATION}"),
    (rb"BLENDER[-_0-9]|//Maya |Vocaloid Motion Data", f"an animation of Blender, Maya or MikuMikuDance {_ANIMATION}"),
    (rb"#!OML:ASF|:(?:version|FULLY-SPECIFIED)", f"an animation in ASF/AMC {_ANIMATION}"),
    (rb"(?:<\?xml.*?)?<COLLADA", f"an animation in COLLADA {_ANIMATION}"),
    (rb"(?:<\?xml.*?)?<mvnx", f"an export of Xsens MVN as MVNX {_ANIMATION}"),
    (rb"(?:<\?xml.*?)?<(?:robot|mujoco|sdf)\b", "a robot, no recording of a hand"),
    (rb"Format Version,", f"an OptiTrack Motive export (Format Version, Take Name, …) {_MARKERS}"),
    (rb"Trajectories\s*\n\s*[0-9]+|Segments\s*\n\s*[0-9]+|Joints\s*\n\s*[0-9]+", f"a Vicon Nexus export {_MARKERS}"),
    (rb"NO_OF_FRAMES\t", f"a Qualisys export {_MARKERS}"),
    (rb"PathFileType\t", f"an export of markers as TRC {_MARKERS}"),
    (rb"\x02\x50", f"an export of markers as C3D {_MARKERS}"),
    (rb"#ROSBAG ", f"a bag of ROS 1 {_TOPIC}"),
    (rb"SQLite format 3\0", f"a database, such as a bag of ROS 2, {_TOPIC}"),
    (rb"MATLAB [57]\.", "a MATLAB file is not read; save its arrays as .npz: scipy.io.loadmat, numpy.savez"),
    (rb"ARROW1", "a Feather file is not read; save its arrays as .npz, or its table as Parquet or CSV"),
    (rb"\xd0\xcf\x11\xe0", "an Excel workbook is not read; save it as CSV"),
    (rb"\x1f\x8b|\xfd7zXZ|7z\xbc\xaf|\x28\xb5\x2f\xfd|BZh[1-9]|Rar!", f"a packed file {_PACKED}"),
)  # fmt: skip
"""Beginnings of files in which people keep hands and which are not read: what each is, and what to do instead."""
_KINDS = tuple((re.compile(rb"\s*" + pattern, re.DOTALL), text) for pattern, text in _BEGINNINGS)


@dataclass(frozen=True)
class ReadOptions:
    """Options for reading a file."""

    form: str | None = None  # name of the format; None detects it
    columns: ColumnMap | None = None  # mapping of the columns of a table
    hand: HandSide = ""  # side of the hand, if the file does not say it, or says it wrong
    mirror: Literal["x", "y", "z"] | None = None  # axis of left-handed coordinates that is turned round
    # Our palm's x, y, z in the recording's palm frame, such as ("-y", "x", "z"); None takes the file's.
    palm_axes: Sequence[str] | None = None
    world_up: str | None = None  # axis of the recording's world that points up; None takes the file's
    usual_up: str | None = None  # the same for a file that does not say it; None then holds the wrist still and level
    # Unit for a format whose `Recording.scaled` is true; other recordings are converted after reading.
    length_unit: str | None = None
    time_unit: str | None = None  # unit of the stamps, if the user states it: `poses` are in s
    rate: float | None = None  # samples a second [Hz], of a file without stamps
    hand_length: float | None = None  # length of the recorded hand [m], if its joints have no scale
    mano_model: Path | None = None  # the user's own file of the MANO model, .pkl or .npz
    mano_pose: str | None = None  # meaning of the numbers of a MANO pose, of `hhsim.recordings.formats.mano.READINGS`
    profile: Path | None = None  # file with the sizes of an UmeTrack hand
    object_track: str | None = None  # uid of the object that moves with an UmeTrack hand, if there are several
    episode: int | None = None  # number of the episode, in a file with several
    dexmo: DexmoRegression | None = None  # calibration of a Dexmo glove
    poses: Poses | None = None  # times of the poses for its calibration
    array: str | None = None  # name of the array of joints, in a file with several
    # Order of the joints in rows without names, a key of `hhsim.recordings.joint_names.JOINT_ORDERS`.
    joint_order: str | None = None
    pose_order: str | None = None  # order of quaternions, of a palm or an object, that no name tells: "wxyz" or "xyzw"
    pose_unit: str | None = None  # unit of an object's positions, "m", "cm" or "mm"
    # False leaves the angles that fit joint centres out: 0 where the joints are known.
    fits_angles: bool = True
    # File with the poses of the camera that an object's poses are relative to; None for the world.
    camera_poses: Path | None = None


NPY, OF_OBJECTS = b"\x93NUMPY", b"'descr': '|O'"
"""Beginning of an `.npy` file, and what its header says of one that holds objects."""
HDF5 = b"\x89HDF"
PICKLES = tuple(bytes((0x80, protocol)) for protocol in range(2, 6))
"""First bytes of a pickle."""


class Content:
    """Content of a file, read no further than needed; `path` is None if only its bytes are given.

    `name` is the recording's if the content has none, by default the file's without its suffix; `what` the kind of file
    that is expected, for messages; `original` the file beside which its hand's sizes and its object's poses may lie, by
    default `path`. `packed` is the pickle or the HDF5 of which `data` has the arrays, empty for any other file.
    """

    def __init__(
        self,
        path: Path | None = None,
        *,
        data: bytes | None = None,
        name: str = "",
        what: str = "a recording",
        original: Path | None = None,
    ) -> None:
        self.path = path
        self.original = original or path
        self.what = what
        self.name = name or (path.stem if path is not None else "")
        self.packed = b""
        if data is not None:
            self.data = data

    @classmethod
    def of_recording(cls, path: Path | None, data: bytes | None = None, original: Path | None = None) -> Self:
        """Return the content of a recording; of a pickled dictionary or others' HDF5 the arrays, as of an .npz."""
        content = cls(path, data=data, original=original)
        if content.head.startswith(PICKLES):
            content._pack(pickled_arrays(content.data))
        elif content.head.startswith(HDF5) and path is not None and _is_of_others(path):
            from hhsim.recordings.hdf5_arrays import hdf5_arrays

            content._pack(hdf5_arrays(content.data, path))
        return content

    def _pack(self, arrays: dict[str, Any]) -> None:
        """Keep the file, and take its arrays for its data."""
        self.packed = self.data
        self.data = npz_of(arrays)
        self.head = self.data[:HEAD_BYTES]

    def packed_with(self, data: bytes) -> bytes:
        """Return the file with the arrays of an `.npz` in the place of its own; `data` itself if it is not packed."""
        if not self.packed:
            return data
        from hhsim.recordings.hdf5_arrays import hdf5_with

        write = pickled_with if self.packed.startswith(PICKLES) else hdf5_with
        return write(self.packed, read_npz(data))

    @cached_property
    def data(self) -> bytes:
        """Return all bytes of the file; TrajectoryError if it is missing, cannot be read or is too large."""
        self.refuse_large()
        assert self.path is not None
        with self._readable():
            return read_input(self.path)

    @cached_property
    def head(self) -> bytes:
        """First bytes of the file."""
        if self.path is None or "data" in vars(self):
            return self.data[:HEAD_BYTES]
        with self._readable(), open_input(self.path) as file:
            return file.read(HEAD_BYTES)

    @cached_property
    def beginning(self) -> str:
        """Text at the beginning, with a replacement character for what is no text."""
        return _decoded(self.head)

    @cached_property
    def arrays(self) -> dict[str, Any]:
        """Arrays of an archive by their names; TrajectoryError for a damaged one."""
        return read_npz(self.data)

    @cached_property
    def document(self) -> Any:
        """Document of JSON, as of `read_json`; TrajectoryError with the place of a fault."""
        return read_json(self.text)

    @cached_property
    def stated(self) -> StatedFields:
        """Fields of known names beside the samples; none of damaged content."""
        try:
            return StatedFields(self._fields())
        except TrajectoryError:
            return StatedFields({})

    def _fields(self) -> dict[str, Any]:
        """Return the values that may stand beside samples by their names."""
        if self.head.startswith(b"PK"):
            return self.arrays | dict(flat({name: nested(values) for name, values in self.arrays.items()}))
        if self.head.startswith(NPY) and OF_OBJECTS in self.head[:256]:
            return dict(flat(npy_dictionary(self.data, self.what)))
        if self.is_json:
            return dict(flat(self.document)) if isinstance(self.document, dict) else {}
        if not any(map(kind_of, self.header)):
            return read_remarks(self.text) if self.is_text else {}
        table = read_table(self.text)
        columns = enumerate(table.header)
        return table.remarks | {name: [row[k].strip() for row in table.rows] for k, name in columns if kind_of(name)}

    @property
    def is_text(self) -> bool:
        """True if it begins as text does."""
        return _is_text(self.beginning)

    @property
    def is_json(self) -> bool:
        """True if it begins as a JSON object or list does."""
        return self.beginning.lstrip()[:1] in ("{", "[")

    @cached_property
    def header(self) -> tuple[str, ...]:
        """Names of the columns of a table; none of any other content."""
        if self.is_json or not self.is_text:
            return ()
        try:
            return read_header(self.text)
        except TrajectoryError:
            return ()

    @cached_property
    def text(self) -> str:
        """Its text, with a replacement character for what is no UTF-8; TrajectoryError for no text."""
        text = _decoded(self.data)
        if not _is_text(text):
            raise TrajectoryError("no text; expected a recording of another format")
        return text

    @cached_property
    def exact_text(self) -> str:
        """Its text with every byte, in lines as those of `text`; TrajectoryError if it cannot be written back."""
        try:
            return self.data.decode(*_exact_encoding(self.data))
        except UnicodeDecodeError:
            raise TrajectoryError("text of UTF-16 with a damaged letter: it cannot be written back") from None

    def edited(self, edits: Iterable[NumberEdit], decimal: str = ".") -> bytes:
        """Return its bytes with numbers of `exact_text` replaced."""
        return edited(self.exact_text, edits, decimal).encode(*_exact_encoding(self.data))

    def refuse_large(self) -> None:
        """Raise TrajectoryError for a file that is missing, or too large to be read at once."""
        if self.path is not None:
            with self._readable():
                size = self.path.stat().st_size
            if size > MOST_BYTES:
                raise TrajectoryError("more than 1 GB; expected a recording of a hand")

    @contextmanager
    def _readable(self) -> Iterator[None]:
        """Raise TrajectoryError for an error of the operating system."""
        try:
            yield
        except FileNotFoundError:
            raise TrajectoryError(f"no such file; expected {self.what}") from None
        except OSError as error:
            raise TrajectoryError(f"cannot be read: {error.strerror or error}") from None


@dataclass(frozen=True)
class RecordingFormat:
    """Format of recordings."""

    name: str  # name of the format and of its module
    description: str  # one line about such a file
    suffixes: tuple[str, ...]  # suffixes of such files, such as ".npz"
    # Function that returns True for a content of this format; it may consult the options.
    sniff: Callable[[Content, ReadOptions], bool]
    # Function that reads the recording in a content. It raises TrajectoryError for a damaged one and InputError for
    # options that do not fit it, without the file's name.
    read: Callable[[Content, ReadOptions], Recording]
    rank: int = 0  # order of detection: formats with a signature (0), any JSON (1), any text (2)
    takes_columns: bool = False  # True if it takes `ReadOptions.columns`
    # Function that returns the content of the file with a recording of it corrected; nothing else in it changes. None
    # for a format that is not written back.
    write: Callable[[Content, ReadOptions, Recording, Correction], bytes] | None = None
    # Function that returns the content of a new file of a suffix. None for a format in which none is made.
    make: Callable[[str, HandMotion], bytes] | None = None
    made: tuple[str, ...] = ()  # suffixes that `make` takes
    # Function that returns the MANO model's parameters in every sample, for the skin; None for a format without.
    mano: Callable[[Content, ReadOptions], tuple[FloatArray, FloatArray, FloatArray, FloatArray]] | None = None


def _is_of_others(path: Path) -> bool:
    """Return True for a sound HDF5 file that states no format of hhsim, and has no `transforms` as EgoDex has them."""
    from hhsim.system.hdf5_input import DAMAGE, open_hdf5

    try:
        with open_hdf5(path) as file:
            return not str(file.attrs.get("format", "")).startswith("hhsim") and "transforms" not in file
    except (DamagedFileError, *DAMAGE):
        return False


def _decoded(data: bytes) -> str:
    encoding = "utf-16" if data.startswith((b"\xff\xfe", b"\xfe\xff")) else "utf-8-sig"
    return data.decode(encoding, errors="replace")


def _exact_encoding(data: bytes) -> tuple[str, str]:
    """Return encoding and treatment of errors with which bytes survive; the byte order mark stays a letter."""
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        return ("utf-16-le" if data.startswith(b"\xff") else "utf-16-be"), "surrogatepass"
    return "utf-8", "surrogateescape"


def _is_text(text: str) -> bool:
    sample = text[:HEAD_BYTES]
    return sum(sign in "\x00\ufffd" for sign in sample) <= MOST_UNREADABLE * len(sample)


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
    recording = form.read(content, options)
    checksums = "" if content.packed else recording.checksums
    recording = recording.changed(hand=options.hand or recording.hand, checksums=checksums or "missing")
    if recording.bones is None and recording.sample_count:
        recording = _with_stated_fields(recording, content, options)
    if options.mirror is not None:
        recording = recording.found(
            note(f"left-handed coordinates: {options.mirror} is turned round, as --mirror says")
        )
    return recording.found(*map(note, content.stated.told()))


def stated_hand(
    content: Content, wanted: HandSide, rows: AnyArray, findings: list[Finding]
) -> tuple[HandSide, BoolArray]:
    """Return the wanted side, or for "" that of the content's fields, and the samples that are of it, shape (T,).

    `rows` are the rows of the file that the samples are of, shape (T,). What is found is added to `findings`. Raises
    TrajectoryError where fields of each row are fewer, or have no such hand.
    """
    sides: tuple[HandSide, ...] = content.stated.take("side") or ("",)
    if len(sides) == 1:
        if wanted and sides[0] not in ("", wanted):
            findings.append(note(f"taken for a {wanted} hand, not for the {sides[0]} one that a field states"))
        return wanted or sides[0], np.ones(len(rows), dtype=bool)
    if len(sides) <= int(np.max(rows, initial=0)):
        raise TrajectoryError(f"{len(sides)} sides of a hand for {len(rows)} samples; expected one, or one a sample")
    side, remarks = chosen_side(Counter(each for each in sides if each), wanted)
    shown = np.array(sides)[rows] == side
    findings += [*remarks, note(f"{int(shown.sum())} of {len(shown)} rows are of the {side} hand")]
    return side, shown


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


def why_not_read(head: bytes) -> str:
    """Return what the file with this beginning is, and what to do instead; "" for any other."""
    head = head.removeprefix(b"\xef\xbb\xbf")
    return next((text for pattern, text in _KINDS if pattern.match(head)), "")


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
    media = media_kind(content.head)
    if media:
        raise TrajectoryError(f"{media}; expected a recording of one of {', '.join(formats)}")
    if reason := why_not_read(content.head):
        raise TrajectoryError(reason)
    for form in formats.values():
        if form.sniff(content, options):
            return form
    raise TrajectoryError(f"neither text nor a known format; expected one of {', '.join(formats)}")


NEW_SUFFIXES = (".npz", ".csv")
"""Suffixes of a new file for a corrected recording whose format is not written back."""


def is_written_back(recording: Recording) -> bool:
    """Return False for a recording of a format that is read and not written: what is corrected needs a new file."""
    form = recording_formats().get(recording.form)
    return form is None or form.write is not None


def repaired_suffix(path: Path, options: ReadOptions) -> str:
    """Return the usual suffix of a corrected recording: that of its file, or `.npz` where it needs a new one."""
    try:
        # The beginning of a pickle does: all of them are written back.
        form = format_of(Content(path), options)
    except InputError:
        # Whoever reads it says what is wrong.
        return path.suffix
    return path.suffix if form.write is not None else NEW_SUFFIXES[0]


def check_target(source: Path, recording: Recording, target: Path) -> None:
    """Raise OutputError for a suffix in which a recording that was read from `source` is not written."""
    suffix = target.suffix.lower()
    if is_written_back(recording):
        if suffix != source.suffix.lower():
            raise OutputError(f"{target}: a corrected recording keeps its format; expected a name in {source.suffix}")
    elif suffix not in NEW_SUFFIXES:
        expected = " or ".join(NEW_SUFFIXES)
        raise OutputError(f"{target}: format {recording.form} is read and not written; expected a name in {expected}")


def write_recording(
    path: str | Path, options: ReadOptions, recording: Recording, correction: Correction, out: str | Path
) -> float | None:
    """Write a file with the recording that it holds corrected; a file of that name is replaced in one step.

    `path` is the file that the recording was read from, by the same options; the recording may be some of its samples.
    Where `is_written_back` is False, a new file has the samples of the recording alone: joints in the axes of the file
    [m], or, of a recording of angles, our hand in our world. Returns the largest distance of a joint read back from the
    corrected one [m]; None for a recording of angles, or a new file. Raises OutputError as `check_target`, or for no
    permission; InputError, in one line that begins with the path, for a correction that the file cannot hold.
    """
    source, target, frame = Path(path), Path(out), recording.file_frame
    check_target(source, recording, target)
    if not is_written_back(recording):
        suffix, joints = target.suffix.lower(), _axes(recording).to_file(correction.joints)
        # The stamps of a new file are those of the old one.
        motion = HandMotion(recording.time + recording.first_stamp, joints, correction.posture, recording.hand)
        form = "keypoints" if recording.joints is not None else suffix[1:]
        write_atomically(target, exported(form, suffix, motion))
        return None
    with named(source):
        content = Content.of_recording(source)
        kind, off = format_of(content, options), None
        data = content.packed or content.data
        if correction.changed.any():
            assert kind.write is not None
            data = content.packed_with(kind.write(content, options, recording, correction))
        if recording.joints is not None:
            again = kind.read(Content.of_recording(source, data), replace(options, fits_angles=False))
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


def exported(form: str, suffix: str, motion: HandMotion) -> bytes:
    """Return the content of a new file of a format; InputError if none is made, or for another suffix."""
    makers = {name: (each.make, each.made) for name, each in recording_formats().items() if each.make is not None}
    if form not in makers:
        raise UnknownNameError("format", form, makers)
    make, suffixes = makers[form]
    if suffix.lower() not in suffixes:
        raise InputError(f"a file of format {form} does not end in '{suffix}'; expected {' or '.join(suffixes)}")
    return make(suffix.lower(), motion)
