"""What a reader in a child gives back, and what becomes of one that fails; its limits by hdf5_input's own tests."""

import time

import numpy as np
import pytest

from hhsim.errors import DamagedFileError, UnknownNameError
from hhsim.system.child_reader import read_in_child


def failing(error: BaseException) -> None:
    raise error


def test_what_is_read_comes_back_whole() -> None:
    values = np.random.default_rng(0).standard_normal((1000, 3))
    found, name = read_in_child(lambda: (values, "name"), "a damaged file")
    assert found.tobytes() == values.tobytes()
    assert name == "name"


def test_errors_of_hhsim_come_back_as_they_are_and_others_as_damage() -> None:
    with pytest.raises(UnknownNameError) as caught:
        read_in_child(lambda: failing(UnknownNameError("link", "tip", ["top"])), "a damaged file")
    assert str(caught.value) == "unknown link 'tip': did you mean top?"
    with pytest.raises(DamagedFileError, match=r"^a damaged file: a b$"):
        read_in_child(lambda: failing(RuntimeError("a\nb")), "a damaged file")
    with pytest.raises(DamagedFileError, match=r"^a damaged file: KeyError$"):
        read_in_child(lambda: failing(KeyError()), "a damaged file")
    with pytest.raises(DamagedFileError, match="the library that reads it breaks down"):
        read_in_child(lambda: failing(SystemExit(3)), "a damaged file")


def test_a_larger_file_has_more_time() -> None:
    with pytest.raises(DamagedFileError, match="does not end within 1 s"):
        read_in_child(lambda: time.sleep(5), "a damaged file", seconds=0, patience=0.05)
    assert read_in_child(lambda: time.sleep(0.1) or 3, "", 1000, seconds=0, rate=100, patience=0.05) == 3


def test_a_reader_within_a_reader_shares_its_limits() -> None:
    """The inner one, with less time, is called in the same child."""

    def outer() -> int:
        return read_in_child(lambda: time.sleep(0.2) or 4, "inner", seconds=0, patience=0.05)

    assert read_in_child(outer, "outer") == 4
