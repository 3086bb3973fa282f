"""Trajectory files: HDF5 (format `hhsim-trajectory`), in and out; `.csv` goes to `hhsim.motion.csv_file`.

schema_version 1. Attributes of the file: format, schema_version, name, source, licence, device, hand, and, of an
import, checksums (`Trajectory.checksums`). Datasets, each with `units` and `long_name`: time (T,), position (T, 3),
orientation (T, 4), flexion (T, 5, 3), abduction (T, 5), object/position (3,), object/orientation (4,) or, of an object
that moves, (T, 3) and (T, 4), phase/{name, start_time, end_time} (P,), and optional flags (T,):
bits with the meanings in its attributes `flag_masks` and `flag_meanings`, as in the CF metadata conventions. The HDF5
file is followed by its seal (`hhsim.system.checksummed_file`); a file without one is read too.
"""

from pathlib import Path
from typing import Any

import h5py
import numpy as np

from hhsim.errors import DamagedFileError, InputError, OutputError, TrajectoryError
from hhsim.motion.csv_file import CSV_SUFFIX, TEXTS, format_csv, parse_csv
from hhsim.motion.sample_flags import SampleFlag
from hhsim.motion.trajectory import ObjectMotion, Phase, Trajectory
from hhsim.system.atomic_write import put_dataset, sealed_hdf5, write_atomically
from hhsim.system.hdf5_input import DAMAGE, open_hdf5
from hhsim.system.input_file import read_input_text

FORMAT = "hhsim-trajectory"
SCHEMA_VERSION = 1
MOST_TOLD = 6
"""Most datasets of a foreign file that its refusal names."""
HDF5_SUFFIXES = (".h5", ".hdf5")

SAMPLES = {
    "time": ("s", "time stamp of the sample"),
    "position": ("m", "palm origin, world"),
    "orientation": ("1", "palm to world, unit quaternion w x y z"),
    "flexion": ("rad", "flexion, thumb to little finger, proximal to distal, positive curls"),
    "abduction": ("rad", "abduction, thumb to little finger, positive towards the thumb side"),
}
OBJECT = {
    "object/position": ("m", "object origin, world"),
    "object/orientation": ("1", "object to world, unit quaternion w x y z"),
}
PHASE_COLUMNS = {
    "name": ("", "name of the phase"),
    "start_time": ("s", "first stamp of the phase"),
    "end_time": ("s", "end of the phase, not part of it unless it is the last"),
}


def save_trajectory(trajectory: Trajectory, path: str | Path) -> None:
    """Write a trajectory as its suffix says, .h5 or .csv; a file of that name is replaced in one step.

    Raises OutputError for another suffix, or if the file cannot be written.
    """
    target = Path(path)
    suffix = target.suffix.lower()
    if suffix == CSV_SUFFIX:
        write_atomically(target, format_csv(trajectory).encode())
    elif suffix in HDF5_SUFFIXES:
        write_atomically(target, sealed_hdf5(lambda file: _write(trajectory, file)))
    else:
        raise OutputError(f"{target}: unknown suffix '{suffix}'; expected .h5 or .csv")


def load_trajectory(path: str | Path) -> Trajectory:
    """Read and check a trajectory, .h5 or .csv.

    Raises TrajectoryError for no such file, another format or schema, a missing part, or a motion that cannot be
    replayed; one line that begins with the path.
    """
    source = Path(path)
    suffix = source.suffix.lower()
    try:
        if source.is_dir():
            raise TrajectoryError("a folder; expected a trajectory file, .h5 or .csv")
        if not source.exists():
            raise TrajectoryError("no such file; expected a trajectory or a recording that hhsim import reads")
        if suffix == CSV_SUFFIX:
            # A byte order mark is what spreadsheets put first.
            return parse_csv(read_input_text(source, "utf-8-sig"), name=source.stem)
        if suffix not in HDF5_SUFFIXES:
            raise TrajectoryError(f"unknown suffix '{suffix}'; expected .h5 or .csv")
        return Trajectory(**read_fields(source))
    except UnicodeDecodeError:
        raise TrajectoryError(f"{source}: not UTF-8 text; expected a CSV file") from None
    except OSError as error:
        raise TrajectoryError(f"{source}: cannot be read: {error.strerror or error}") from error
    except InputError as error:
        raise TrajectoryError(f"{source}: {error}") from None


def _write(trajectory: Trajectory, file: h5py.File) -> None:
    file.attrs["format"] = FORMAT
    file.attrs["schema_version"] = SCHEMA_VERSION
    for key in TEXTS:
        file.attrs[key] = getattr(trajectory, key)
    if trajectory.checksums:
        file.attrs["checksums"] = trajectory.checksums
    for key, (units, long_name) in SAMPLES.items():
        put_dataset(file, key, getattr(trajectory, key), units, long_name)
    moving = trajectory.object_motion
    for key, (units, long_name) in OBJECT.items():
        values = getattr(trajectory, key.replace("/", "_")) if moving is None else getattr(moving, key.split("/")[1])
        put_dataset(file, key, values, units, long_name if moving is not None else f"{long_name}, constant")
    for key, (units, long_name) in PHASE_COLUMNS.items():
        values = [getattr(phase, key) for phase in trajectory.phases]
        kind = h5py.string_dtype() if key == "name" else np.float64
        put_dataset(file, f"phase/{key}", np.array(values, dtype=kind), units, long_name)
    if trajectory.flags is not None:
        put_dataset(file, "flags", trajectory.flags, "1", "what was mended in the sample or is in doubt, sum of bits")
        file["flags"].attrs["flag_masks"] = np.array([flag.value for flag in SampleFlag], dtype=np.uint32)
        file["flags"].attrs["flag_meanings"] = " ".join(flag.word for flag in SampleFlag)


def read_fields(path: Path) -> dict[str, Any]:
    """Read the fields of a trajectory in an HDF5 file, by their names in `Trajectory`, without checking the arrays.

    Raises TrajectoryError for another format or schema, a missing part, or a damaged file.
    """
    try:
        with open_hdf5(path) as file:
            return _fields(file)
    except (TrajectoryError, PermissionError):
        raise
    except DamagedFileError as error:
        raise TrajectoryError(str(error)) from None
    except DAMAGE as error:
        reason = str(error).splitlines()[0][:120] if str(error) else type(error).__name__
        raise TrajectoryError(f"no {FORMAT} file, or a damaged one: {reason}") from None


def _fields(file: h5py.File) -> dict[str, Any]:
    form, version = file.attrs.get("format"), file.attrs.get("schema_version")
    if form != FORMAT:
        if isinstance(form, str):
            raise TrajectoryError(f"format '{form}'; expected {FORMAT}")
        raise TrajectoryError(f"no format attribute; expected {FORMAT}, or an .npz of the arrays: {_held(file)}")
    if version != SCHEMA_VERSION:
        raise TrajectoryError(f"schema_version {version}; expected {SCHEMA_VERSION}, which this hhsim reads")
    columns = {key: _get(file, f"phase/{key}") for key in PHASE_COLUMNS}
    if len({len(column) for column in columns.values()}) > 1:
        raise TrajectoryError("phase/name, start_time and end_time have different lengths")
    fields = {key: _get(file, key) for key in SAMPLES}
    poses = {key.replace("/", "_"): _get(file, key) for key in OBJECT}
    moves = np.ndim(poses["object_position"]) == 2
    fields |= {"object_motion": ObjectMotion(*poses.values())} if moves else poses
    fields |= {key: str(file.attrs.get(key, "")) for key in (*TEXTS, "checksums")}
    if "flags" in file:
        fields["flags"] = _get(file, "flags")
    rows = zip(*columns.values(), strict=True)
    fields["phases"] = tuple(Phase(str(name), float(start), float(end)) for name, start, end in rows)
    return fields


def _held(file: h5py.File) -> str:
    """Return the names and shapes of the first datasets of a file."""
    found: dict[str, Any] = {}
    file.visititems(found.__setitem__)
    held = [f"{name} {item.shape}" for name, item in found.items() if isinstance(item, h5py.Dataset)]
    return ", ".join(held[:MOST_TOLD]) or "no dataset"


def _get(file: h5py.File, key: str) -> Any:
    """Return the whole dataset; text as str."""
    dataset = file.get(key)
    if not isinstance(dataset, h5py.Dataset):
        raise TrajectoryError(f"no dataset {key}; expected one in every {FORMAT} file")
    return dataset.asstr()[()] if h5py.check_string_dtype(dataset.dtype) else dataset[()]
