"""Dictionaries in pickles and in `.npy`, of which nothing is run."""

import io
import os
import pickle
from typing import Any

import numpy as np
import pytest

from hhsim.errors import TrajectoryError
from hhsim.motion.pickled_data import npy_dictionary, unpickled

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
