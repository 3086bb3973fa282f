"""What a format of recordings is: one record in a module of its own in `hhsim.recordings.formats`, named as the format.

A format says whether a file is of it, and reads it; `hhsim.recordings.registry` finds it by itself.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from hhsim.errors import TrajectoryError
from hhsim.motion.trajectory import HandSide
from hhsim.recordings.column_map import ColumnMap
from hhsim.recordings.dexmo_regression import DexmoRegression, Poses
from hhsim.recordings.recording import Recording
from hhsim.system.input_file import open_input, read_input

MOST_BYTES = 1 << 30
"""A file larger than this [byte] is no hand recording."""
HEAD_BYTES = 4096
"""As much of a file tells its format."""
MOST_UNREADABLE = 0.1
"""Text has no larger share of signs that are none."""


@dataclass(frozen=True)
class ManoOptions:
    """What the user says about poses of the MANO hand.

    Attributes:
        model: The user's own file of the model, .pkl or .npz; None where there is none.
        reading: One of `MANO_READINGS`; None where the file has to say it.
    """

    model: Path | None = None
    reading: str | None = None


MANO_READINGS = ("axis-angle", "axis-angle-mean", "pca", "pca-flat")
"""What the numbers of a pose are: 45 angles of the joints from the flat hand, or from the mean pose; coefficients of
the model's components about the mean pose, or about the flat hand."""


@dataclass(frozen=True)
class ReadOptions:
    """What the user says about a file.

    Attributes:
        form: Name of the format; None lets the content decide.
        columns: What the columns of a table mean.
        hand: Which hand it is, where the file does not say it, or says it wrong.
        palm_axes: Our palm's x, y, z in the recording's palm frame, such as ("-y", "x", "z"); None takes the file's.
        world_up: The axis of the recording's world that points up; None takes the file's.
        length_unit: Of a format whose `Recording.scaled` says so; other recordings are converted after reading.
        rate: Samples a second [Hz], of a file without stamps.
        hand_length: Of the recorded hand [m], where its joints have no scale.
        mano: What the numbers of a MANO pose mean, and the file of its model.
        profile: File with the sizes of an UmeTrack hand.
        object_track: Uid of the object that moves with an UmeTrack hand, where the table beside holds several.
        episode: Number of the episode, where a file holds several.
        dexmo: The calibration of a Dexmo glove.
        poses: When a Dexmo glove's hand was in the poses of its calibration.
    """

    form: str | None = None
    columns: ColumnMap | None = None
    hand: HandSide = ""
    palm_axes: Sequence[str] | None = None
    world_up: str | None = None
    length_unit: str | None = None
    rate: float | None = None
    hand_length: float | None = None
    mano: ManoOptions = ManoOptions()
    profile: Path | None = None
    object_track: str | None = None
    episode: int | None = None
    dexmo: DexmoRegression | None = None
    poses: Poses | None = None


class Content:
    """The content of a file, read no further than it is asked for.

    Attributes:
        path: The file; None where only its bytes are given.
        name: Of the recording, where the content names none; the file's name without its ending, if not given.
    """

    def __init__(self, path: Path | None = None, *, data: bytes | None = None, name: str = "") -> None:
        self.path = path
        self.name = name or (path.stem if path is not None else "")
        if data is not None:
            self.data = data

    @cached_property
    def data(self) -> bytes:
        """All of its bytes.

        Raises:
            TrajectoryError: No file, or one that cannot be read or is too large.
        """
        self.refuse_large()
        assert self.path is not None
        try:
            return read_input(self.path)
        except OSError as error:
            raise _unreadable(error) from None

    @cached_property
    def head(self) -> bytes:
        """Its first bytes."""
        if self.path is None or "data" in vars(self):
            return self.data[:HEAD_BYTES]
        try:
            with open_input(self.path) as file:
                return file.read(HEAD_BYTES)
        except OSError as error:
            raise _unreadable(error) from None

    @cached_property
    def beginning(self) -> str:
        """The text that it begins with; what is no text becomes a sign that says so."""
        return _decoded(self.head)

    @property
    def is_text(self) -> bool:
        """Whether it begins as text does."""
        return _is_text(self.beginning)

    @cached_property
    def text(self) -> str:
        """Its text; what is no UTF-8 becomes a sign that no number holds.

        Raises:
            TrajectoryError: No text.
        """
        text = _decoded(self.data)
        if not _is_text(text):
            raise TrajectoryError("no text; expected a recording of another format")
        return text

    def refuse_large(self) -> None:
        """Refuse a file that is too large to be read at once.

        Raises:
            TrajectoryError: It is, or there is no such file.
        """
        if self.path is not None:
            try:
                size = self.path.stat().st_size
            except OSError as error:
                raise _unreadable(error) from None
            if size > MOST_BYTES:
                raise TrajectoryError("more than 1 GB; expected a recording of a hand")


@dataclass(frozen=True)
class RecordingFormat:
    """A format of recordings.

    Attributes:
        name: The word for it, and the name of its module.
        description: One line: what such a file is.
        suffixes: How the names of such files end, such as ".npz".
        sniff: Whether a content is of this format; the options may speak against it.
        read: The recording in a content. It raises TrajectoryError for a damaged one and InputError for options that
            do not fit it, without the file's name.
        rank: Formats are asked in this order: those that a signature tells (0), any JSON (1), any text (2).
        takes_columns: Whether `ReadOptions.columns` can explain it.
    """

    name: str
    description: str
    suffixes: tuple[str, ...]
    sniff: Callable[[Content, ReadOptions], bool]
    read: Callable[[Content, ReadOptions], Recording]
    rank: int = 0
    takes_columns: bool = False


def _decoded(data: bytes) -> str:
    encoding = "utf-16" if data.startswith((b"\xff\xfe", b"\xfe\xff")) else "utf-8-sig"
    return data.decode(encoding, errors="replace")


def _is_text(text: str) -> bool:
    sample = text[:HEAD_BYTES]
    return sum(sign in "\x00\ufffd" for sign in sample) <= MOST_UNREADABLE * len(sample)


def _unreadable(error: OSError) -> TrajectoryError:
    if isinstance(error, FileNotFoundError):
        return TrajectoryError("no such file; expected a recording")
    return TrajectoryError(f"cannot be read: {error.strerror or error}")
