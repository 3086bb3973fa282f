"""The vendor's calibration profiles and our own, for a live glove."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hhsim.errors import InputError
from hhsim.live.devices.registry import ServedOptions
from hhsim.live.drivers.calibration import MOST_FILE, GloveCalibration, glove_calibration
from hhsim.live.link.dexmo_codec import CHANNELS
from hhsim.recordings.dexmo_regression import BEND
from hhsim.recordings.dexmo_regression import CHANNELS as OURS

LOW = np.linspace(600.0, 1600.0, 11)
HIGH = LOW + np.where(np.isin(np.arange(11), BEND), 2200.0, 400.0)


def profile(low: Any = LOW, high: Any = HIGH) -> dict[str, dict[str, float]]:
    return {"max": dict(zip(CHANNELS, map(float, high))), "min": dict(zip(CHANNELS, map(float, low)))}


def written(folder: Path, whole: Any) -> Path:
    path = folder / "calibration.json"
    path.write_text(json.dumps(whole))
    return path


def load_calibration(path: Path | None, hand: str = "right", profile: str = "") -> GloveCalibration:
    return glove_calibration(ServedOptions(calibration=str(path or ""), profile=profile), hand)


def test_without_a_file_channels_are_normalised_and_counts_refused() -> None:
    calibration = load_calibration(None)
    assert calibration.fitting([0.5] * 11) is calibration
    assert calibration.doubtful == () and calibration.kept_free == ()
    with pytest.raises(InputError, match="raw counts \\(up to 3166\\)"):
        calibration.fitting([3166.0] * 11)


def test_a_profile_leaves_what_the_server_normalised_and_scales_what_it_did_not(tmp_path: Path) -> None:
    calibration = load_calibration(written(tmp_path, {"RIGHT": {"anna": profile()}, "LEFT": {}}))
    share = np.linspace(0.1, 0.9, 11)
    plain = calibration.fitting(share.tolist()).regression
    counts = calibration.fitting((LOW + share * (HIGH - LOW)).tolist()).regression
    assert not plain.counts_raw and counts.counts_raw
    assert np.allclose(counts.normalised(LOW), 0.0) and np.allclose(counts.normalised(HIGH), 1.0)
    for one, other in zip(plain.angles(share), counts.angles(LOW + share * (HIGH - LOW))):
        assert np.allclose(one, other) and np.isfinite(one).all()
    assert calibration.doubtful == ()


def test_profiles_are_found_by_hand_and_name(tmp_path: Path) -> None:
    other = profile(LOW, HIGH + 50.0)
    path = written(tmp_path, {"RIGHT": {"anna": profile(), "ben": other}, "LEFT": {"cleo": other}})
    counts = load_calibration(path, "right", "ben").counts
    assert counts is not None and np.array_equal(counts.closed, HIGH + 50.0)
    left = load_calibration(path, "left").counts
    assert left is not None and np.array_equal(left.closed, HIGH + 50.0)
    with pytest.raises(InputError, match="RIGHT has 2 profiles: name one of 'anna', 'ben'"):
        load_calibration(path, "right")
    with pytest.raises(InputError, match="unknown profile 'bem': did you mean ben"):
        load_calibration(path, "right", "bem")


def test_channels_that_say_little_are_named_and_their_fingers_kept_free(tmp_path: Path) -> None:
    high = HIGH.copy()
    high[CHANNELS.index("index_split")] = LOW[CHANNELS.index("index_split")] + 37.0
    high[CHANNELS.index("ring_bend")] = LOW[CHANNELS.index("ring_bend")] + 60.0
    high[CHANNELS.index("pinky_bend")] = 4200.0
    calibration = load_calibration(written(tmp_path, {"RIGHT": {"anna": profile(LOW, high)}}))
    assert calibration.doubtful == (
        "index_split spans 37 counts of 4095: it says little",
        "ring_bend spans 60 counts of 4095: it says little",
        "counts beyond 0 to 4095: pinky_bend",
    )
    assert calibration.kept_free == (3,)


def test_a_spread_without_span_leaves_its_joint_where_it_is(tmp_path: Path) -> None:
    k = CHANNELS.index("middle_split")
    high = HIGH.copy()
    high[k] = LOW[k]
    calibration = load_calibration(written(tmp_path, {"RIGHT": {"anna": profile(LOW, high)}}))
    assert "middle_split spans 0 counts of 4095: it says little" in calibration.doubtful
    for regression in (calibration.regression, calibration.counts):
        assert regression is not None
        readings = regression.open.copy()
        readings[k] += 1.0
        for one, other in zip(regression.angles(readings), regression.angles(regression.open)):
            assert np.isfinite(one).all() and np.array_equal(one, other)


@pytest.mark.parametrize(
    ("low", "high", "other"), [(LOW, HIGH, 0.4), (np.full(11, 0.1), np.full(11, 0.9), 2000.0)], ids=["counts", "0 to 1"]
)
def test_our_file_is_for_what_its_ends_are_in(tmp_path: Path, low: Any, high: Any, other: float) -> None:
    path = tmp_path / "calibration.toml"
    rows = [f"{name} = {{ open = {a}, closed = {b} }}" for name, a, b in zip(ours_names(), low, high)]
    path.write_text("[channel]\n" + "\n".join(rows))
    calibration = load_calibration(path)
    assert np.allclose(calibration.fitting(high.tolist()).regression.normalised(high), 1.0)
    with pytest.raises(InputError, match="raw counts"):
        calibration.fitting([other] * 11)


def ours_names() -> list[str]:
    return [name.replace("pinky", "little") for name in CHANNELS]


def without(key: str) -> Any:
    whole = profile()
    del whole["max"][key]
    return {"RIGHT": {"anna": whole}}


def bend_that_does_not_move() -> Any:
    high = HIGH.copy()
    high[BEND[2]] = LOW[BEND[2]]
    return {"RIGHT": {"anna": profile(LOW, high)}}


@pytest.mark.parametrize(
    ("whole", "message"),
    [
        ([], "expected a table"),
        ({}, "no RIGHT; it has nothing"),
        ({"RIGHT": {}}, "RIGHT has 0 profiles"),
        ({"RIGHT": {"anna": 3}}, "RIGHT.anna: 3; expected a table"),
        ({"RIGHT": {"anna": {"max": {}}}}, "RIGHT.anna: min is missing"),
        (without("ring_bend"), "anna.max: ring_bend is missing; expected a count"),
        ({"RIGHT": {"anna": profile(LOW, [math.nan] * 11)}}, "anna.max: thumb_rotate = nan; expected a count"),
        ({"RIGHT": {"anna": profile(LOW, [1e300] * 11)}}, "anna.max: thumb_rotate = 1e+300"),
        ({"RIGHT": {"anna": profile() | {"max": dict.fromkeys(CHANNELS, True)}}}, "= True; expected a count"),
        (bend_that_does_not_move(), "middle_bend: min is not below max"),
    ],
)
def test_profiles_that_are_none_are_refused_in_one_line(tmp_path: Path, whole: Any, message: str) -> None:
    with pytest.raises(InputError) as refused:
        load_calibration(written(tmp_path, whole))
    assert message in str(refused.value) and "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (None, "cannot be read: No such file"),
        (b"\xff\xfe\x00", "not a text file"),
        (b"{", "not JSON"),
        (b"[" * 100_000, "not JSON"),
        (b" " * (MOST_FILE + 1), "4,194,305 bytes"),
    ],
)
def test_files_that_are_no_profiles_are_refused_in_one_line(tmp_path: Path, data: bytes | None, message: str) -> None:
    path = tmp_path / "calibration.json"
    if data is not None:
        path.write_bytes(data)
    with pytest.raises(InputError) as refused:
        load_calibration(path)
    assert message in str(refused.value) and "\n" not in str(refused.value)


def test_the_vendors_channels_are_in_the_order_of_the_regression() -> None:
    assert tuple(ours_names()) == OURS
