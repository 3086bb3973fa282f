"""The vendor's calibration profiles and our own, for a live glove."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hhsim.errors import InputError
from hhsim.live.drivers.calibration import MOST_FILE, GloveCalibration, glove_calibration
from hhsim.live.drivers.dexmo import CHANNELS
from hhsim.live.gloves import DexmoOptions
from hhsim.recordings.dexmo_regression import BEND, DexmoRegression
from hhsim.recordings.dexmo_regression import CHANNELS as OURS

LOW = np.linspace(600.0, 1600.0, 11)
HIGH = LOW + np.where(np.isin(np.arange(11), BEND), 2200.0, 400.0)
DEFAULT = DexmoRegression.default()


def profile(low: Any = LOW, **changed: float) -> dict[str, dict[str, float]]:
    """A profile whose ends are HIGH but for some channels."""
    high = dict(zip(CHANNELS, HIGH.tolist())) | changed
    return {"max": high, "min": dict(zip(CHANNELS, map(float, low)))}


def load(path: Path | None, hand: str = "right", profile: str = "") -> GloveCalibration:
    return glove_calibration(DexmoOptions(calibration=str(path or ""), profile=profile), hand)


def written(folder: Path, whole: Any) -> Path:
    path = folder / "calibration.json"
    path.write_bytes(whole if isinstance(whole, bytes) else json.dumps(whole).encode())
    return path


def test_the_channels_are_those_of_the_regression() -> None:
    assert tuple(name.replace("pinky", "little") for name in CHANNELS) == OURS


def test_a_profile_changes_no_angle_and_is_found_by_hand_and_name(tmp_path: Path) -> None:
    narrow = profile(pinky_bend=HIGH[10] - 2150.0)
    path = written(tmp_path, {"RIGHT": {"anna": profile(), "ben": narrow}, "LEFT": {"cleo": narrow}})
    share = np.linspace(0.1, 0.9, 11)
    for hand, name, free in (("right", "anna", ()), ("right", "ben", (4,)), ("left", "", (4,))):
        found = load(path, hand, name)
        assert found.kept_free == free and len(found.doubtful) == len(free)
        angles = found.angles(share)
        assert angles is not None
        for one, other in zip(angles, DEFAULT.angles(share)):
            np.testing.assert_allclose(one, other)


def test_channels_that_say_little_are_named_and_their_fingers_kept_free(tmp_path: Path) -> None:
    at = dict(zip(CHANNELS, LOW.tolist()))
    ends = {"index_split": at["index_split"] + 37.0, "ring_bend": at["ring_bend"] + 60.0, "pinky_bend": 4200.0}
    calibration = load(written(tmp_path, {"RIGHT": {"anna": profile(**ends, middle_split=at["middle_split"])}}))
    assert calibration.doubtful == (
        "index_split spans 37 counts of 4095: it says little",
        "middle_split spans 0 counts of 4095: it says little",
        "ring_bend spans 60 counts of 4095: it says little",
        "counts beyond 0 to 4095: pinky_bend",
    )
    assert calibration.kept_free == (3,)
    # A spread without span leaves its joint where it is.
    k = CHANNELS.index("middle_split")
    assert not calibration.regression.slope[:, k].any() and DEFAULT.slope[:, k].any()


@pytest.mark.parametrize(
    ("low", "high", "other"), [(LOW, HIGH, 0.4), (np.full(11, 0.1), np.full(11, 0.9), 2000.0)], ids=["counts", "0 to 1"]
)
def test_our_file_is_for_what_its_ends_are_in(tmp_path: Path, low: Any, high: Any, other: float) -> None:
    path = tmp_path / "calibration.toml"
    rows = [f"{name} = {{ open = {a}, closed = {b} }}" for name, a, b in zip(OURS, low, high)]
    path.write_text("[channel]\n" + "\n".join(rows))
    calibration = load(path)
    found = calibration.angles(high)
    assert found is not None and np.allclose(found[0], DEFAULT.angles(np.ones(11))[0])
    assert calibration.angles(np.full(11, other)) is None and load(None).angles(LOW) is None
    assert calibration.in_counts == (high is HIGH)


FAULTS: dict[str, tuple[Any, str]] = {
    "no table": ([], "expected a table"),
    "nothing": ({}, "no RIGHT; it has nothing"),
    "no profile": ({"RIGHT": {}}, "RIGHT has 0 profiles"),
    "two profiles": ({"RIGHT": {"a": 1, "b": 1}}, "RIGHT has 2 profiles: name one of 'a', 'b'"),
    "profile": ({"RIGHT": {"anna": 3}}, "RIGHT.anna: 3; expected a table"),
    "no min": ({"RIGHT": {"anna": {"max": profile()["max"]}}}, "RIGHT.anna: min is missing"),
    "channel": ({"RIGHT": {"anna": profile() | {"max": {}}}}, "anna: max: thumb_rotate is missing; expected a count"),
    "large": ({"RIGHT": {"anna": profile(thumb_rotate=1e300)}}, "anna: max.thumb_rotate = 1e+300"),
    "no number": ({"RIGHT": {"anna": profile(thumb_rotate=True)}}, "= True; expected a count"),
    "still": ({"RIGHT": {"anna": profile(middle_bend=LOW[6])}}, "middle_bend: min is not below max"),
    "NaN": ({"RIGHT": {"anna": profile(thumb_rotate=float("nan"))}}, "not JSON"),
    "no text": (b"\xff\xfe\x00", "not JSON"),
    "cut": (b"{", "not JSON"),
    "deep": (b"[" * 100_000, "not JSON"),
    "long": (b" " * (MOST_FILE + 1), "4,194,305 bytes"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_files_that_are_no_profiles_are_refused_in_one_line(tmp_path: Path, fault: str) -> None:
    whole, message = FAULTS[fault]
    with pytest.raises(InputError) as refused:
        load(written(tmp_path, whole))
    assert message in str(refused.value) and "\n" not in str(refused.value)


def test_what_is_not_there_is_named(tmp_path: Path) -> None:
    path = written(tmp_path, {"RIGHT": {"ben": profile()}})
    with pytest.raises(InputError, match="unknown profile 'bem': did you mean ben"):
        load(path, profile="bem")
    with pytest.raises(InputError, match="cannot be read: No such file"):
        load(tmp_path / "none.json")
