"""Archives of arrays: what they state is looked at before anything of it is unpacked."""

import io
import zipfile

import numpy as np
import pytest

from hhsim.errors import TrajectoryError
from hhsim.motion import npz_arrays
from hhsim.motion.npz_arrays import read_npz


def archive(count: int, size: int) -> bytes:
    """An archive of so many arrays of zeros, of so many bytes each."""
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as file:
        for number in range(count):
            array = io.BytesIO()
            np.lib.format.write_array(array, np.zeros(size, np.uint8))
            file.writestr(f"a{number}.npy", array.getvalue())
    return content.getvalue()


def test_a_small_archive_of_much_is_not_unpacked(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each of its arrays alone would be let pass."""
    monkeypatch.setattr(npz_arrays, "ALWAYS", 1 << 20)
    read_npz(archive(1, 900_000))
    monkeypatch.setattr(zipfile.ZipFile, "read", lambda *_: pytest.fail("unpacked"))
    with pytest.raises(TrajectoryError, match=r"^3,600,512 bytes in an archive of [\d,]+; expected a hand recording$"):
        read_npz(archive(4, 900_000))


def test_what_states_less_than_it_holds_is_damaged() -> None:
    data = archive(1, 1_000_000)
    size = (1_000_128).to_bytes(4, "little")
    assert data.count(size) == 2
    with pytest.raises(TrajectoryError, match="damaged"):
        read_npz(data.replace(size, (1_128).to_bytes(4, "little")))
