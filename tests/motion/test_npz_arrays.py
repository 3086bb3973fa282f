"""Archives and pickles: what they state is looked at before it is unpacked, and nothing of them is run."""

import io
import os
import pickle
import zipfile
from collections.abc import Callable
from typing import Any, Literal

import numpy as np
import pytest
from scipy.sparse import csc_matrix

from hhsim.errors import InputError, TrajectoryError
from hhsim.motion import pickled_data
from hhsim.motion.npz_arrays import npz_of, read_npz
from hhsim.motion.pickled_data import npy_dictionary, pickled_arrays, replaced, unpickled
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


DATA: dict[str, Any] = {
    "right": {"rot": np.arange(6.0).reshape(2, 3), "names": ["a", "b"]},
    "count": 2,
    "scale": np.float32(0.5),
}


class Planted:
    """Object whose pickle calls a function."""

    def __reduce__(self) -> Any:
        return os.getcwd, ()


@pytest.mark.parametrize("version", [(1, 0), (2, 0), (3, 0)])
def test_a_dictionary_in_an_array_file_comes_back(version: tuple[int, int]) -> None:
    stream = io.BytesIO()
    np.lib.format.write_array(stream, np.array(DATA, dtype=object), version=version)
    read = npy_dictionary(stream.getvalue(), "a test")
    np.testing.assert_array_equal(read["right"]["rot"], DATA["right"]["rot"])
    assert (read["right"]["names"], read["count"], float(read["scale"])) == (["a", "b"], 2, 0.5)


@pytest.mark.parametrize("protocol", range(pickle.HIGHEST_PROTOCOL + 1))
def test_what_is_more_than_data_is_refused_in_every_protocol(protocol: int) -> None:
    for planted in (Planted(), {"a": Planted()}, {"a": [np.array(Planted(), dtype=object)]}):
        with pytest.raises(TrajectoryError, match=r"holds \w+\.getcwd, which is not data, so it is not loaded"):
            unpickled(pickle.dumps(planted, protocol), "a test")


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (pickle.dumps([1, 2]), "a pickle of something else; expected the dictionary of a test"),
        (pickle.dumps(DATA)[:-10], "no pickle, or a damaged one .*; expected a test"),
        (b"", "no pickle, or a damaged one"),
    ],
)
def test_other_content_is_refused(data: bytes, said: str) -> None:
    with pytest.raises(TrajectoryError, match=said):
        unpickled(data, "a test")


def repeated(times: int) -> list[Any]:
    """A list in a list, each twice: of so many levels."""
    value: list[Any] = [1.0]
    for _ in range(times):
        value = [value, value]
    return value


def endless() -> list[Any]:
    """A list that holds itself."""
    value: list[Any] = []
    value.append(value)
    return value


def in_an_array() -> np.ndarray[Any, Any]:
    value = np.empty(2, object)
    value[0] = repeated(30)
    return value


@pytest.mark.parametrize("make", [lambda: repeated(30), endless, lambda: {"a": repeated(60)}, in_an_array])
def test_a_small_pickle_of_many_values_is_refused(make: Callable[[], Any], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pickled_data, "MOST_VALUES", 2000)
    data = pickle.dumps({"value": make()})
    assert len(data) < 1000
    with pytest.raises(TrajectoryError, match="a pickle of more than 2,000 values, or 50 levels; expected a test"):
        unpickled(data, "a test")


def test_a_sparse_matrix_of_absurd_size_is_left_out() -> None:
    """Of a recording; the one of usual size beside it comes back."""
    sizes = {"usual": 7, "absurd": 10**9}
    data = pickle.dumps({name: csc_matrix(([1.0], ([2], [3])), shape=(size, 7)) for name, size in sizes.items()})
    assert len(data) < 1000
    arrays = pickled_arrays(data)
    assert set(arrays) == {"usual"}
    np.testing.assert_array_equal(np.argwhere(arrays["usual"]), [[2, 3]])
