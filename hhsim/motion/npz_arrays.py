"""The arrays of an `.npz` archive, without pickles, and never more than a hand recording can be."""

import io
import zipfile
import zlib
from typing import Any

import numpy as np

from hhsim.errors import TrajectoryError

MOST_BYTES = 1 << 31
"""An array that says it is larger than this is damaged."""


def read_npz(data: bytes) -> dict[str, Any]:
    """The arrays by their names.

    Raises:
        TrajectoryError: No archive, or a damaged one.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            entries = archive.infolist()
            if any(entry.file_size > MOST_BYTES for entry in entries):
                raise TrajectoryError("an array of more than 2 GB; expected a hand recording")
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
    except (MemoryError, SyntaxError, TypeError, KeyError, OverflowError) as error:
        raise TrajectoryError(f"a damaged .npz archive: {type(error).__name__}") from None
