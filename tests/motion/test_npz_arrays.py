"""Archives of arrays: what they state is looked at before anything of it is unpacked."""

import io
import zipfile
from typing import Literal

import numpy as np
import pytest

from hhsim.errors import InputError, TrajectoryError
from hhsim.motion.npz_arrays import npz_with, read_npz
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
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        for name, method in (("z.npy", zipfile.ZIP_DEFLATED), ("note.txt", zipfile.ZIP_STORED), ("a.npy", 0)):
            content = io.BytesIO(b"as it was" if name == "note.txt" else b"")
            if name.endswith("npy"):
                np.save(content, first)
            archive.writestr(zipfile.ZipInfo(name, (2020, 1, 2, 3, 4, 6)), content.getvalue(), method)
        archive.comment = b"kept"
    made = npz_with(stream.getvalue(), {"z": first + 0.5})
    with np.load(io.BytesIO(made)) as arrays, zipfile.ZipFile(io.BytesIO(made)) as new, zipfile.ZipFile(stream) as old:
        assert arrays["z"].dtype == np.dtype(kind) and np.array_equal(arrays["z"], first + 0.5)
        facts = [[(e.filename, e.compress_type, e.date_time) for e in each.infolist()] for each in (old, new)]
        assert facts[0] == facts[1] and new.comment == b"kept"
        assert [new.read(name) for name in ("note.txt", "a.npy")] == [old.read(name) for name in ("note.txt", "a.npy")]
        assert new.read("z.npy")[:128] == old.read("z.npy")[:128]


def test_an_array_of_whole_numbers_holds_no_correction() -> None:
    stream = io.BytesIO()
    np.savez(stream, a=np.arange(3))
    with pytest.raises(InputError, match="array 'a': an array of int64, which does not hold a correction"):
        npz_with(stream.getvalue(), {"a": np.zeros(3)})
