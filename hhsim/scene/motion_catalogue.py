"""Catalogue of motions, and the motion that a name or a path on the command line means.

A trajectory is a catalogue name (`grasp`), a script (`.toml`), a trajectory (`.h5`, `.csv`), a result or live session
(`.h5`), or any other recording, which is imported as `hhsim import` does.
"""

import functools
from collections.abc import Mapping
from importlib.resources import as_file, files
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np

from hhsim.errors import InputError, TrajectoryError, UnknownNameError, check_known, named
from hhsim.hand.fingers import FINGERS
from hhsim.motion.csv_file import CSV_SUFFIX
from hhsim.motion.sample_flags import MENDED, marked
from hhsim.motion.trajectory import UNCHECKED, HandSide, Trajectory
from hhsim.scene.script import Script, parse_script
from hhsim.system.input_file import media_kind_of
from hhsim.system.settings_file import read_toml_text

if TYPE_CHECKING:
    from hhsim.recordings.recording import Recording

Motion: TypeAlias = Script | Trajectory
"""Motion of a hand, as a word on the command line names it."""
Reading: TypeAlias = Mapping[str, Any]
"""Fields of `hhsim.recordings.registry.ReadOptions` for a recording that is imported, paths as texts."""
SCRIPT_SUFFIX = ".toml"
USUAL_OBJECT = "bunny"
"""Object of a command that names none."""
RECORDING_SUFFIXES = (".h5", ".hdf5", CSV_SUFFIX)
"""Suffixes of trajectories and results; a recording of any other format, a .csv too, is imported."""
ORDER = (
    *("touch", "pinch", "grasp", "whole-hand", "slide", "carry", "sequence", "never"),
    *("lift", "move", "shake", "turn", "push", "slip"),
)
"""Motions for any object, from one finger to the whole hand; those for one object follow by name, recordings last."""


class TrajectoryDescription(NamedTuple):
    """Entry of the catalogue: duration [s], rate [Hz], fingers that close (of a recording all), names of phases.

    `objects` are those that it is made for, empty for any; `figures` are the paper's that show it; `line` is a command
    that shows it within all limits.
    """

    name: str
    title: str
    stresses: str
    duration: float
    rate: float
    fingers: tuple[str, ...]
    phases: tuple[str, ...]
    objects: tuple[str, ...]
    figures: tuple[str, ...]
    line: str


def imported_suffixes() -> tuple[str, ...]:
    """Return the suffixes of recordings that are imported."""
    from hhsim.recordings.registry import recording_suffixes

    return tuple(suffix for suffix in recording_suffixes() if suffix not in RECORDING_SUFFIXES)


def is_imported(path: Path) -> bool:
    """Return True if a recording is imported: by its suffix, or a .csv by the names of its columns."""
    suffix = path.suffix.lower()
    if suffix != CSV_SUFFIX:
        # To ask each format imports it.
        return suffix not in ("", SCRIPT_SUFFIX, *RECORDING_SUFFIXES) and suffix in imported_suffixes()
    if not path.is_file():
        return False
    from hhsim.recordings.registry import Content, ReadOptions, format_of

    try:
        # Our own columns, and those that nobody knows, are of the format csv.
        return format_of(Content(path), ReadOptions()).name != "csv"
    except TrajectoryError:
        return False


def trajectory_names() -> list[str]:
    """Return the names of all shipped scripts, in the order of `ORDER`, then of the recordings."""
    return [*script_names(), *_names(RECORDING_SUFFIXES[0])]


def script_names() -> list[str]:
    """Return the names of all shipped scripts, in the order of `ORDER`."""
    names = _names(SCRIPT_SUFFIX)
    return [name for name in ORDER if name in names] + [name for name in names if name not in ORDER]


@functools.cache
def _names(suffix: str) -> tuple[str, ...]:
    entries = (entry.name for entry in files("hhsim.trajectories").iterdir())
    return tuple(sorted(name.removesuffix(suffix) for name in entries if name.endswith(suffix)))


def load_script(name: str) -> Script:
    """Return the shipped script of a name; UnknownNameError lists the near names."""
    check_known("trajectory", [name], script_names())
    file = f"{name}{SCRIPT_SUFFIX}"
    text = (files("hhsim.trajectories") / file).read_text(encoding="utf-8")
    return parse_script(text, name=name, where=f"trajectories/{file}")


def _shipped_recording(name: str) -> Trajectory:
    from hhsim.motion.file import load_trajectory

    with as_file(files("hhsim.trajectories") / f"{name}{RECORDING_SUFFIXES[0]}") as path:
        return load_trajectory(path)


def describe(name: str) -> TrajectoryDescription:
    """Return the catalogue entry of a shipped script or recording; UnknownNameError lists the near names."""
    check_known("trajectory", [name], trajectory_names())
    if name not in script_names():
        motion = _shipped_recording(name)
        title, line = f"Recorded from a real hand, {motion.device}", f"hhsim replay {USUAL_OBJECT} {name}"
        about = title, motion.source, motion.duration, motion.mean_rate, FINGERS, ()
        return TrajectoryDescription(name, *about, objects=(USUAL_OBJECT,), figures=(), line=line)
    found = load_script(name)
    # `show` is an object and options.
    object_, _, options = (found.show or (*found.objects, USUAL_OBJECT)[0]).partition(" ")
    stated = found.title, found.stresses, found.duration, found.rate, found.fingers if found.contact else ()
    phases, figures = tuple(phase.name for phase in found.phases), tuple(use.figure for use in found.paper)
    line = f"hhsim replay {object_} {name} {options}".rstrip()
    return TrajectoryDescription(name, *stated, phases, found.objects, figures, line)


def of_the_paper(description: Mapping[str, Any]) -> bool:
    """Return True if the paper shows the scene of a result's description: its motion on one of its objects."""
    motion, object_ = str(description.get("trajectory")), description.get("object")
    return motion in script_names() and any(object_ in use.objects for use in load_script(motion).paper)


def resolve_trajectory(name_or_path: str | Path, reading: Reading | None = None) -> Motion:
    """Return the script or recording that a word on the command line means; a catalogue name wins.

    Raises UnknownNameError for neither a catalogue name nor a path with a known suffix; TrajectoryError for no such
    file, or one that is not what its suffix says.
    """
    word = str(name_or_path)
    if word in trajectory_names():
        return load_script(word) if word in script_names() else _shipped_recording(word)
    path = Path(word)
    suffix = path.suffix.lower()
    if suffix == SCRIPT_SUFFIX:
        return parse_script(read_toml_text(path, "script", TrajectoryError), name=path.stem, where=str(path))
    if suffix in RECORDING_SUFFIXES or suffix in imported_suffixes():
        return load_recorded(path, reading)
    if path.exists() or "/" in word:
        kinds = ", ".join((SCRIPT_SUFFIX, *RECORDING_SUFFIXES, *imported_suffixes()))
        what = media_kind_of(path) or "not a trajectory by its suffix"
        raise TrajectoryError(f"{word}: {what}; expected {kinds} or a name of the catalogue")
    raise UnknownNameError("trajectory", word, trajectory_names())


def load_recorded(path: Path, reading: Reading | None = None) -> Trajectory:
    """Read a recorded motion from a trajectory file or a result, or import it where `is_imported`.

    Raises TrajectoryError for no such file, no known format, or a recording that cannot be cleaned safely.
    """
    if is_imported(path):
        return clean_imported(path, read_imported(path, reading=reading))
    from hhsim.motion.file import load_trajectory
    from hhsim.result.motion import holds_a_result, load_result_motion

    if holds_a_result(path):
        return load_result_motion(path)
    try:
        return load_trajectory(path)
    except TrajectoryError as error:
        if path.suffix.lower() == ".csv" and path.is_file():
            raise TrajectoryError(f"{error} (hhsim import reads other tables, and mends)") from None
        raise


def import_remarks(motion: Any, word: str) -> list[str]:
    """Return remarks on a motion of any kind that was imported by a word, whose unit, side and axes may be guesses."""
    if not isinstance(motion, Trajectory) or motion.flags is None or not is_imported(Path(word)):
        return []
    mended = int(np.sum(marked(motion.flags, MENDED)))
    remark = "the recording was imported on the way in: hhsim import tells what it was taken for"
    if mended:
        remark = f"{mended:,} of {motion.sample_count:,} samples were mended on the way in: hhsim import tells what"
    return [remark, UNCHECKED] if motion.may_hide_damage else [remark]


def read_imported(path: Path, hand: HandSide = "", reading: Reading | None = None) -> "Recording":
    """Read a recording as `hhsim import` does with no options but the hand and `reading`; errors as of that."""
    from hhsim.recordings.registry import ReadOptions, read_recording

    try:
        fields: dict[str, Any] = dict(reading or {})
        fields |= {name: Path(fields[name]) for name in ("mano_model", "profile") if name in fields}
        return read_recording(path, ReadOptions(hand=hand, **fields))
    except InputError as error:
        if "--" not in str(error):
            raise
        # The reader names options of the import; a replay has others of the same name.
        kind = TrajectoryError if isinstance(error, TrajectoryError) else InputError
        raise kind(f"{error} (of hhsim import, whose output is replayed)") from None


def clean_imported(path: Path, recording: "Recording") -> Trajectory:
    """Make the motion of a recording; TrajectoryError, which names the file, for one that cannot be cleaned safely."""
    from hhsim.recordings.cleaning import clean_recording

    with named(path):
        return clean_recording(recording).trajectory
