"""Arrays of `.npz` and `.npy` files, without pickles, and no more than a hand recording can be."""

import io
import tokenize
import zipfile
import zlib
from collections.abc import Mapping
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import TrajectoryError
from hhsim.motion.trajectory import as_numbers
from hhsim.system.input_file import most_unpacked

DAMAGE = (MemoryError, SyntaxError, TypeError, KeyError, OverflowError, RecursionError, tokenize.TokenError)
"""Errors of numpy, besides ValueError and its like, for a damaged array header."""


def read_npy(data: bytes) -> Any:
    """Read the array of an `.npy` file; raise TrajectoryError for another or a damaged file."""
    try:
        return np.lib.format.read_array(io.BytesIO(data), allow_pickle=False)
    except (ValueError, EOFError, OSError, *DAMAGE) as error:
        line = str(error).splitlines()[0][:120] if isinstance(error, ValueError) and str(error) else ""
        raise TrajectoryError(f"not an .npy array, or a damaged one: {line or type(error).__name__}") from None


def read_npz(data: bytes) -> dict[str, Any]:
    """Read the arrays of an archive by their names; raise TrajectoryError for another or a damaged file."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            entries = archive.infolist()
            # The library reads as many entries as it finds, whatever number the archive's end states.
            end = data.rfind(b"PK\x05\x06")
            stated = int.from_bytes(data[end + 10 : end + 12], "little")
            if stated not in (len(entries), 0xFFFF) or len(set(archive.namelist())) < len(entries):
                raise TrajectoryError(f"a damaged .npz archive: {len(entries)} names, where it states {stated} arrays")
            size = sum(entry.file_size for entry in entries)
            if size > most_unpacked(len(data)):
                raise TrajectoryError(f"{size:,} bytes in an archive of {len(data):,}; expected a hand recording")
            arrays = {}
            for entry in entries:
                name, dot, suffix = entry.filename.rpartition(".")
                if dot and suffix == "npy":
                    # The archive checks the bytes it gives against their CRC-32.
                    arrays[name] = np.lib.format.read_array(io.BytesIO(archive.read(entry)), allow_pickle=False)
            return arrays
    except TrajectoryError:
        raise
    except (zipfile.BadZipFile, zlib.error, EOFError, OSError, ValueError, NotImplementedError, RuntimeError) as error:
        reason = str(error).splitlines()[0][:120] if str(error) else type(error).__name__
        raise TrajectoryError(f"not an .npz archive, or a damaged one: {reason}") from None
    except DAMAGE as error:
        raise TrajectoryError(f"a damaged .npz archive: {type(error).__name__}") from None


def array_names(data: bytes) -> set[str]:
    """Return the names of an archive's files, those of arrays without `.npy`; none of a damaged archive."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            return {name.removesuffix(".npy") for name in archive.namelist()}
    except (zipfile.BadZipFile, OSError, ValueError, NotImplementedError):
        return set()


def numbers(arrays: Mapping[str, Any], key: str, *shape: int) -> FloatArray:
    """Return an array as numbers, of a shape if one is given; TrajectoryError for others."""
    return as_numbers(f"array '{key}'", arrays[key], shape or None)


def npz_of(arrays: Mapping[str, Any]) -> bytes:
    """Return an archive of arrays by their names, whatever these are."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        for name, values in arrays.items():
            archive.writestr(zipfile.ZipInfo(f"{name}.npy"), npy_of(values))
    return out.getvalue()


def npy_of(values: Any) -> bytes:
    """Return an `.npy` file of an array, or of a dictionary, which is pickled."""
    out = io.BytesIO()
    np.save(out, values)
    return out.getvalue()
