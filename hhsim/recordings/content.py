"""Content of a file, read no further than needed, and the options for reading it; JSON of any maker."""

import json
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.errors import DamagedFileError, TrajectoryError
from hhsim.motion.csv_table import NewColumn, Table, edited, read_header, read_remarks, read_table
from hhsim.motion.npz_arrays import array_names, npy_of, npz_of, read_npy, read_npz
from hhsim.motion.pickled_data import flat, npy_dictionary, pickled_arrays, pickled_with, replaced
from hhsim.motion.trajectory import HandSide
from hhsim.recordings.joint_names import VALIDITY_WORDS, StatedFields, joint_name, kind_of, words_of
from hhsim.recordings.recording import UNUSED_POSE, Finding, note
from hhsim.system.counted import counted
from hhsim.system.hdf5_input import DAMAGE, open_hdf5
from hhsim.system.input_file import MOST_BYTES, open_input, read_input

if TYPE_CHECKING:
    from hhsim.recordings.column_map import ColumnMap
    from hhsim.recordings.dexmo_regression import DexmoRegression

HEAD_BYTES = 4096
"""Size of the beginning of a file that tells its format [byte]."""
MOST_UNREADABLE = 0.1
"""Largest share of characters of a text that cannot be decoded."""
NPY, OF_OBJECTS, ROWS = b"\x93NUMPY", b"'descr': '|O'", "rows"
"""Beginning of an `.npy` file, what its header says of one that holds objects, and a name for the array of another."""
ZIP, HDF5 = b"PK", b"\x89HDF"
SHOWN_NAMES = 6
"""Most names of what is not used in one finding."""
POSE_WORDS = ("pos", "rot", "quat", "trans", "orient", "matri")
"""Beginnings of words for a pose or a part of one."""
OF_OTHERS = ("cam", "hand", "wrist", "palm", "head", "root", "mano", "body", "view", "proj", "intr", "extr", "left",
             "right")  # fmt: skip
"""Beginnings of words for what else has a pose."""
MOST = 1e20
"""Largest magnitude of a reading: nanoseconds since 1970 are less."""
SHOWN_KEYS = 6
UTF_16 = (b"\xff\xfe", b"\xfe\xff")
"""First bytes of a text of UTF-16."""
PICKLES = tuple(bytes((0x80, protocol)) for protocol in range(2, 6))
"""First bytes of a pickle."""
ARCHIVES = (ZIP, *PICKLES)
"""First bytes of a file with arrays by their names."""


@dataclass(frozen=True)
class ReadOptions:
    """Options for reading a file."""

    form: str | None = None  # name of the format; None detects it
    columns: "ColumnMap | None" = None  # mapping of the columns of a table
    hand: HandSide = ""  # side of the hand, if the file does not say it, or says it wrong
    mirror: Literal["x", "y", "z"] | None = None  # axis of left-handed coordinates that is turned round
    # Our palm's x, y, z in the recording's palm frame, such as ("-y", "x", "z"); None takes the file's.
    palm_axes: Sequence[str] | None = None
    world_up: str | None = None  # axis of the recording's world that points up; None takes the file's
    usual_up: str | None = None  # the same for a file that does not say it; None then holds the wrist still and level
    # Units of the numbers in the file; None if it states them, or to detect them.
    time_unit: str | None = None
    length_unit: str | None = None
    angle_unit: str | None = None
    rate: float | None = None  # samples a second [Hz], of a file without stamps
    hand_length: float | None = None  # length of the recorded hand [m], if its joints have no scale
    mano_model: Path | None = None  # the user's own file of the MANO model, .pkl or .npz
    mano_pose: str | None = None  # meaning of the numbers of a MANO pose, of `hhsim.recordings.formats.mano.READINGS`
    profile: Path | None = None  # file with the sizes of an UmeTrack hand
    object_track: str | None = None  # uid of the object that moves with an UmeTrack hand, if there are several
    episode: int | None = None  # number of the episode, in a file with several
    dexmo: "DexmoRegression | None" = None  # calibration of a Dexmo glove
    array: str | None = None  # name of the array of joints, in a file with several
    # Order of the joints in rows without names, a key of `hhsim.recordings.joint_names.JOINT_ORDERS`.
    joint_order: str | None = None
    pose_order: str | None = None  # order of quaternions, of a palm or an object, that no name tells: "wxyz" or "xyzw"
    pose_unit: str | None = None  # unit of an object's positions, "m", "cm" or "mm"
    # False leaves the angles that fit joint centres out: 0 where the joints are known.
    fits_angles: bool = True


class Content:
    """Content of a file, read no further than needed; `path` is None if only its bytes are given.

    `name` is the recording's if the content has none, `what` the kind of file that is expected, for messages;
    `original` the file beside which its hand's sizes and its object's poses may lie.
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
        self.path, self.original, self.what = path, original or path, what
        self.name = name or (path.stem if path is not None else "")
        # Remarks about what was read that are in no recording yet, in the order of their making.
        self._findings: list[Finding] = []
        if data is not None:
            self.data = data

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
    def hdf5_names(self) -> frozenset[str]:
        """Names in a sound HDF5 file that states no format of hhsim; none of any other file."""
        if self.path is None or not self.head.startswith(HDF5):
            return frozenset()
        try:
            with open_hdf5(self.path) as file:
                return frozenset() if str(file.attrs.get("format", "")).startswith("hhsim") else frozenset(file)
        except (DamagedFileError, *DAMAGE):
            return frozenset()

    @cached_property
    def arrays(self) -> dict[str, Any]:
        """Arrays by their names, with slashes between nested ones; TrajectoryError for other content, or damage."""
        if self.head.startswith(PICKLES):
            return pickled_arrays(self.data)
        if self.holds_dictionary:
            return dict(flat(npy_dictionary(self.data, self.what)))
        return {ROWS: read_npy(self.data)} if self.head.startswith(NPY) else read_npz(self.data)

    @property
    def array_names(self) -> set[str]:
        """Names of the arrays, of which an archive, and a single array, are not read; none of other content."""
        if self.head.startswith(PICKLES) or self.holds_dictionary:
            return set(self.arrays)
        if self.head.startswith(ZIP):
            return array_names(self.data)
        return {ROWS} if self.head.startswith(NPY) else set()

    @property
    def holds_dictionary(self) -> bool:
        """True for an `.npy` file of a pickled dictionary."""
        return self.head.startswith(NPY) and OF_OBJECTS in self.head[:256]

    def with_arrays(self, new: Mapping[str, FloatArray]) -> bytes:
        """Return its bytes with other values in some arrays, all else as it is; InputError for whole numbers."""
        if self.head.startswith(PICKLES):
            return pickled_with(self.data, new)
        if self.holds_dictionary:
            return npy_of(replaced(npy_dictionary(self.data, self.what), new))
        arrays = replaced(self.arrays, new)
        return npy_of(arrays[ROWS]) if self.head.startswith(NPY) else npz_of(arrays)

    @cached_property
    def table(self) -> Table:
        """Table with a header line; TrajectoryError as of `read_table`."""
        return read_table(self.text)

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
        if self.head.startswith(NPY):
            return self.arrays
        if self.head.startswith(ARCHIVES):
            return self.arrays | dict(flat({name: nested(values) for name, values in self.arrays.items()}))
        if self.is_json:
            return dict(flat(self.document)) if isinstance(self.document, dict) else {}
        if not any(map(kind_of, self.header)):
            return read_remarks(self.text) if self.is_text else {}
        return self.table.remarks | {name: self.table.text(name) for name in self.table.header if kind_of(name)}

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
        try:
            return read_header(self.text) if self.is_text and not self.is_json else ()
        except TrajectoryError:
            return ()

    @cached_property
    def text(self) -> str:
        """Its text, with a replacement character for what is no UTF-8; TrajectoryError for no text."""
        text = _decoded(self.data)
        if not _is_text(text):
            raise TrajectoryError("no text; expected a recording of another format")
        return text

    def edited(self, table: Table, rows: IntArray, columns: Mapping[str, NewColumn]) -> bytes:
        """Return the bytes of its table with new values of some columns in some rows; TrajectoryError for UTF-16."""
        if self.data.startswith(UTF_16):
            raise TrajectoryError("text of UTF-16, which is read and not written; expected UTF-8 to correct it")
        # Every byte survives, that of no letter too.
        text = self.data.decode("utf-8", "surrogateescape")
        return edited(text, table, rows.tolist(), columns).encode("utf-8", "surrogateescape")

    def note(self, *texts: str) -> None:
        """Tell remarks, each once."""
        self.tell(*map(note, texts))

    def tell(self, *findings: Finding) -> None:
        """Add findings that are not there yet."""
        self._findings += [finding for finding in findings if finding not in self._findings]

    def told(self) -> tuple[Finding, ...]:
        """Return the remarks since the last call, for the recording that they are about."""
        found, self._findings = tuple(self._findings), []
        return found

    def unreadable(self, cells: int, where: str = "") -> None:
        """Tell of cells of a table without a number, if there are any."""
        if cells:
            self.note(f"{counted(cells, 'cell')}{where} without a number: taken as missing")

    def numbers(self, table: Table, columns: Sequence[str]) -> FloatArray:
        """Return the numbers of some columns, NaN where missing, shape (T, C), and tell of cells without one."""
        values, broken = table.numbers(columns)
        self.unreadable(broken, f" of {columns[0]}{' and its like' if len(columns) > 1 else ''}")
        return values

    def unused(self, held: Mapping[str, Any], used: Collection[str | None] = ()) -> None:
        """Tell the names of the values that a reader left out, with the shapes of arrays."""
        # What a field of a known name is used for, or not, is told for all formats by `hhsim.recordings.registry`.
        left = [(name, np.shape(held[name])) for name in held if name not in used and not kind_of(name)]
        # What states that a reading is not one comes first.
        left.sort(key=lambda each: joint_name(each[0]).part not in VALIDITY_WORDS)
        for kind, what in (("note", "not used"), (UNUSED_POSE, "not used, though it looks like the pose of an object")):
            found = [each for each in left if looks_like_pose(*each) == (kind == UNUSED_POSE)]
            names = ", ".join(f"{name} {shape}" if shape else name for name, shape in found[:SHOWN_NAMES])
            more = f" and {len(found) - SHOWN_NAMES} more" if len(found) > SHOWN_NAMES else ""
            self.tell(*([Finding(kind, f"{what}: {names}{more}")] if found else []))

    def chosen_side(self, samples: Mapping[HandSide, int], wanted: HandSide) -> HandSide:
        """Return the wanted hand, else the one of more samples (of equals the right one), and tell of the other.

        "" is a hand of no stated side. Raises TrajectoryError where the wanted hand is not in the file.
        """
        if wanted and wanted not in samples and "" not in samples:
            raise TrajectoryError(f"no {wanted} hand; the file has {' and '.join(f'a {s} one' for s in samples)}")
        if wanted:
            return wanted if wanted in samples else ""
        side = max(samples, key=lambda each: (samples[each], each))
        other = [each for each, count in samples.items() if count and each not in ("", side)]
        if other:
            self.note(f"{side} hand; the {other[0]} one is there too: --hand")
        return side

    def frames_with_hand(self, frames: Sequence[Collection[HandSide]], wanted: HandSide) -> tuple[HandSide, list[int]]:
        """Return a hand as `chosen_side`, and the indices of the frames that show it, by the hands of each."""
        seen = Counter(side for sides in frames for side in sides)
        if not seen:
            raise TrajectoryError(f"{len(frames)} frames, but no hand in any")
        side = self.chosen_side(seen, wanted)
        shown = [k for k, sides in enumerate(frames) if side in sides]
        if len(shown) < len(frames):
            self.note(f"{len(frames) - len(shown)} of {len(frames)} frames show no such hand: no samples")
        return side, shown

    def stated_hand(self, wanted: HandSide) -> HandSide:
        """Return the wanted side, or for "" that of its fields; TrajectoryError for a field with both."""
        side: HandSide | Literal["both"] = self.stated.take("side") or ""
        if side == "both":
            raise TrajectoryError("a field states right and left hands; expected the samples of one hand alone")
        if wanted and side not in ("", wanted):
            self.note(f"taken for a {wanted} hand, not for the {side} one that a field states")
        return wanted or side

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


def _decoded(data: bytes) -> str:
    encoding = "utf-16" if data.startswith(UTF_16) else "utf-8-sig"
    return data.decode(encoding, errors="replace")


def _is_text(text: str) -> bool:
    sample = text[:HEAD_BYTES]
    return sum(sign in "\x00\ufffd" for sign in sample) <= MOST_UNREADABLE * len(sample)


def looks_like_pose(name: str, shape: tuple[int, ...]) -> bool:
    """Return True if a value of this name and shape, () if unknown, may be an object's pose or a part of one."""
    words = [word for word in words_of(name) if word.isalpha()]
    says_pose = any(word.startswith(POSE_WORDS) for word in words)
    if any(word.startswith("obj") for word in words):
        return says_pose and (not shape or shape[-1] in (3, 4, 6, 7, 9, 12, 16))
    is_matrix = not {shape, shape[1:]}.isdisjoint(((4, 4), (3, 4)))
    is_row = says_pose and shape[1:] == (7,) and len(words) > 1
    return (is_matrix or is_row) and not any(word.startswith(OF_OTHERS) for word in words)


def read_json(text: str) -> Any:
    """Return the document, or a list of the documents of its lines; raise TrajectoryError with the place of a fault."""
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        reason = str(error)
    documents = []
    # Other signs that end a line may stand in a string.
    lines = text.replace("\r", "\n").split("\n")
    for place, line in enumerate((line for line in lines if line.strip()), start=1):
        try:
            documents.append(json.loads(line))
        except (ValueError, RecursionError) as error:
            # Of a text whose first line alone is none, the whole is one document.
            where, reason = (f"line {place} is ", str(error)) if place > 1 else ("", reason)
            raise TrajectoryError(f"{where}not JSON: {reason[:120]}; was the file cut short?") from None
    return documents


def nested(value: Any) -> dict[str, Any]:
    """Return the object that an array of one JSON text holds; empty for anything else."""
    try:
        found = json.loads(str(value)) if np.ndim(value) == 0 and str(value)[:1] == "{" else {}
    except (ValueError, RecursionError):
        return {}
    return found if isinstance(found, dict) else {}


def number(value: Any) -> float:
    """Return a number as float, NaN for anything else."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return float("nan")
    # Beyond that it is damage, and what is computed from it overflows.
    return float(value) if -MOST <= value <= MOST else float("nan")


def vector(value: Any, names: Sequence[Any] = "xyz") -> list[float]:
    """Return the numbers of a list as long as `names`, or of an object with these keys, NaN for missing ones."""
    if isinstance(value, dict):
        return [number(value.get(name)) for name in names]
    if not isinstance(value, list) or len(value) != len(names):
        return [float("nan")] * len(names)
    return [number(item) for item in value]


def objects(node: Any) -> Iterator[dict[str, Any]]:
    """Yield the objects of a list; none of anything else."""
    if isinstance(node, list):
        yield from (item for item in node if isinstance(item, dict))


def keys_of(document: Any) -> str:
    """Describe the content of a document, for messages."""
    if isinstance(document, dict):
        names = [str(key)[:24] for key in document]
        more = ", …" if len(names) > SHOWN_KEYS else ""
        return f"an object with {', '.join(names[:SHOWN_KEYS]) or 'nothing'}{more}"
    if isinstance(document, list):
        return f"a list of {len(document)}, the first {keys_of(document[0])}" if document else "an empty list"
    return repr(document)[:40]
