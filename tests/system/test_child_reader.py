"""What a reader in a child gives back, and what becomes of one that fails; its limits by hdf5_input's own tests."""

import time
from pathlib import Path

import numpy as np
import pytest

from hhsim.errors import DamagedFileError, UnknownNameError
from hhsim.mesh import file as mesh_file
from hhsim.motion import pickled_data
from hhsim.system import child_reader, hdf5_input, input_file
from hhsim.system.child_reader import read_in_child


def failing(error: BaseException) -> None:
    raise error


def slept(seconds: float) -> float:
    time.sleep(seconds)
    return seconds


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
    with pytest.raises(DamagedFileError, match="its reader breaks down"):
        read_in_child(lambda: failing(SystemExit(3)), "a damaged file")


def test_the_page_on_security_states_the_limits_as_they_are(repository: Path) -> None:
    text = " ".join((repository / "SECURITY.md").read_text(encoding="utf-8").split())
    for stated in (
        f"after {child_reader.SECONDS:g} s of the processor's time and a second more for each MB (HDF5: "
        f"{hdf5_input.SECONDS:g} s, and one for each {hdf5_input.BYTES_PER_SECOND / 1e6:g} MB)",
        f"has {child_reader.MEMORY >> 30} GiB of memory and {child_reader.MEMORY_PER_BYTE} bytes for each byte",
        f"| {input_file.MOST_BYTES >> 30} GB at most, and what is packed unpacks to {input_file.ALWAYS >> 20} MiB",
        f"holds more than {pickled_data.MOST_VALUES // 1_000_000} million values",
    ):
        assert stated in text
    assert (child_reader.BYTES_PER_SECOND, input_file.PER_BYTE, mesh_file.MEMORY_OF_A_BYTE) == (1e6, 100, 10)


def test_a_larger_file_has_more_time() -> None:
    with pytest.raises(DamagedFileError, match="does not end within 1 s"):
        read_in_child(lambda: time.sleep(5), "a damaged file", seconds=0, patience=0.05)
    assert read_in_child(lambda: slept(0.1), "", 1000, seconds=0, rate=100, patience=0.05) == 0.1


def test_a_reader_within_a_reader_shares_its_limits() -> None:
    """The inner one, with less time, is called in the same child."""

    def outer() -> float:
        return read_in_child(lambda: slept(0.2), "inner", seconds=0, patience=0.05)

    assert read_in_child(outer, "outer") == 0.2
