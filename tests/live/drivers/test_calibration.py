"""Calibration of a live glove."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from hhsim.errors import InputError
from hhsim.live.drivers.calibration import doubtful_channels, glove_calibration, hand_angles, in_counts
from hhsim.live.drivers.dexmo import CHANNELS
from hhsim.live.gloves import DexmoOptions
from hhsim.recordings.dexmo_regression import BEND, DexmoRegression
from hhsim.recordings.dexmo_regression import CHANNELS as OURS

LOW = np.linspace(600.0, 1600.0, 11)
HIGH = LOW + np.where(np.isin(np.arange(11), BEND), 2200.0, 400.0)
DEFAULT = DexmoRegression.default()


def load(path: Path | None) -> DexmoRegression:
    return glove_calibration(DexmoOptions(calibration=str(path or "")), "right")


def written(folder: Path, low: NDArray[np.float64], high: NDArray[np.float64]) -> Path:
    path = folder / "calibration.toml"
    rows = [f"{name} = {{ open = {a}, closed = {b} }}" for name, a, b in zip(OURS, low, high)]
    path.write_text("[channel]\n" + "\n".join(rows))
    return path


def test_the_channels_are_those_of_the_regression() -> None:
    assert tuple(name.replace("pinky", "little") for name in CHANNELS) == OURS


def test_channels_that_say_little_are_named_and_their_fingers_kept_free(tmp_path: Path) -> None:
    ends = {"index_split": 37.0, "middle_split": -20.0, "ring_bend": 60.0, "little_bend": 4200.0}
    high = HIGH.copy()
    for name, span in ends.items():
        high[OURS.index(name)] = LOW[OURS.index(name)] + span
    doubtful, kept_free = doubtful_channels(load(written(tmp_path, LOW, high)))
    assert doubtful == (
        "index_split spans 37 counts of 4095: it says little",
        "middle_split spans 20 counts of 4095: it says little",
        "ring_bend spans 60 counts of 4095: it says little",
        "counts beyond 0 to 4095: little_bend",
    )
    assert kept_free == (3,)


@pytest.mark.parametrize(
    ("low", "high", "other"), [(LOW, HIGH, 0.4), (np.full(11, 0.1), np.full(11, 0.9), 2000.0)], ids=["counts", "0 to 1"]
)
def test_our_file_is_for_what_its_ends_are_in(
    tmp_path: Path, low: NDArray[np.float64], high: NDArray[np.float64], other: float
) -> None:
    calibration = load(written(tmp_path, low, high))
    found = hand_angles(calibration, high)
    assert found is not None and np.allclose(found[0], DEFAULT.angles(np.ones(11))[0])
    assert hand_angles(calibration, np.full(11, other)) is None and hand_angles(load(None), LOW) is None
    assert in_counts(calibration) == (high is HIGH)


def test_what_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file; expected a TOML calibration"):
        load(tmp_path / "none.toml")
