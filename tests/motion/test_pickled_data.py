"""Dictionaries in pickles and in `.npy`, of which nothing is run."""

import io
import os
import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.sparse import csc_matrix

from hhsim.errors import TrajectoryError
from hhsim.motion import pickled_data
from hhsim.motion.pickled_data import npy_dictionary, pickled_arrays, unpickled

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
