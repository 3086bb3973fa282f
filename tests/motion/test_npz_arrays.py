"""Archives of arrays: what they state is looked at before anything of it is unpacked."""

import io
import zipfile
from typing import Literal

import numpy as np
import pytest

from hhsim.errors import InputError, TrajectoryError
from hhsim.motion.npz_arrays import npz_of, read_npz
from hhsim.motion.pickled_data import replaced
from hhsim.system import input_file


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
    monkeypatch.setattr(input_file, "ALWAYS", 1 << 20)
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


@pytest.mark.parametrize("kind", ["<f4", ">f8", "<f2"])
@pytest.mark.parametrize("order", ["C", "F"])
def test_an_array_is_replaced_in_its_own_type_and_order(kind: str, order: Literal["C", "F"]) -> None:
    first = np.asarray(np.arange(12.0).reshape(2, 6), dtype=kind, order=order)
    data = npz_of({"z": first, "file": first, "note": "as it was"})
    made = read_npz(npz_of(replaced(read_npz(data), {"z": np.arange(12.0).reshape(2, 3, 2) + 0.5})))
    assert made["z"].dtype == np.dtype(kind) and np.array_equal(made["z"], first + 0.5)
    assert made["z"].flags.f_contiguous == (order == "F")
    assert np.array_equal(made["file"], first) and [*made] == ["z", "file", "note"] and str(made["note"]) == "as it was"


def test_an_array_of_whole_numbers_holds_no_correction() -> None:
    given = {"a": np.arange(3)}
    assert np.array_equal(replaced(given, {"a": np.arange(3.0)})["a"], given["a"])
    with pytest.raises(InputError, match="'a' is of int64, which does not hold a correction"):
        replaced(given, {"a": np.zeros(3)})
