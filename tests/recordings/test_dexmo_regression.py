"""Eleven channels to twenty angles: the default, calibration by poses, and recordings of them."""

from pathlib import Path

import numpy as np
import pytest
from conftest import Run

from hhsim.arrays import FloatArray
from hhsim.errors import InputError
from hhsim.hand.model import HandModel
from hhsim.motion.file import load_trajectory
from hhsim.recordings.column_map import JOINT_NAMES
from hhsim.recordings.dexmo_regression import (
    BEND,
    CHANNELS,
    DexmoRegression,
    calibrated,
    format_calibration,
    parse_calibration,
    read_calibration,
)
from hhsim.recordings.formats.dexmo import has_dexmo_channels

DEFAULT = DexmoRegression.default()
LOW = np.linspace(700.0, 1300.0, 11)
HIGH = LOW + np.where(np.arange(11) == 3, 37.0, 2000.0)


def test_the_default_opens_closes_and_stays_within_the_hand() -> None:
    flexion, abduction = DEFAULT.angles(np.zeros(11))
    assert not flexion.any() and np.degrees(abduction[0]) == pytest.approx(-10.0) and not abduction[1:].any()
    fist, _ = DEFAULT.angles(np.isin(np.arange(11), BEND).astype(float))
    assert np.allclose(np.degrees(fist[1:]), [85.0, 100.0, 200.0 / 3.0])
    assert np.allclose(fist[1:, 2] / fist[1:, 1], 2.0 / 3.0)
    limits = HandModel.default()
    random = np.random.default_rng(1).uniform(0.0, 1.0, (200, 11))
    flexion, abduction = DEFAULT.angles(random)
    assert flexion.shape == (200, 5, 3) and abduction.shape == (200, 5)
    assert (flexion >= limits.flexion_min).all() and (flexion <= limits.flexion_max).all()
    assert (abduction >= limits.abduction_min).all() and (abduction <= limits.abduction_max).all()


def test_the_bends_of_a_posture_are_the_channels_that_made_it() -> None:
    bend = np.random.default_rng(2).uniform(0.0, 1.0, (50, 5))
    channels = np.zeros((50, 11))
    channels[:, BEND] = bend
    flexion, _ = DEFAULT.angles(channels)
    assert np.allclose(DEFAULT.bends(flexion), bend)
    assert (DEFAULT.bends(flexion + 3.0) == 1.0).all() and (DEFAULT.bends(flexion - 3.0) == 0.0).all()
    mixed = flexion + np.random.default_rng(3).normal(0.0, 0.05, flexion.shape)
    best = DEFAULT.bends(mixed)

    def off(bend: FloatArray) -> FloatArray:
        channels[:, BEND] = bend
        return np.asarray(((DEFAULT.angles(channels)[0] - mixed) ** 2).sum(axis=2))

    for step in (-0.01, 0.01):
        assert (off(np.clip(best + step, 0.0, 1.0)) >= off(best) - 1e-12).all()


def test_two_poses_calibrate_raw_counts() -> None:
    random = np.random.default_rng(4)
    jitter = [random.normal(0.0, 2.0, (51, 11)) for _ in range(3)]
    bend = np.isin(np.arange(11), BEND)
    flat, fist, spread = LOW + jitter[0], np.where(bend, HIGH, LOW) + jitter[1], np.where(bend, LOW, HIGH) + jitter[2]
    flat[3] = np.nan
    glove = calibrated(DEFAULT, flat, fist, spread)
    assert np.allclose(glove.open, LOW, atol=2.0) and np.allclose(glove.closed, HIGH, atol=2.0)
    assert glove.counts_raw and not DEFAULT.counts_raw
    channels = random.uniform(0.0, 1.0, (20, 11))
    for made, meant in zip(glove.angles(LOW + channels * (HIGH - LOW)), DEFAULT.angles(channels)):
        assert np.abs(made - meant).max() < 0.03
    assert len(glove.hints) == 1 and "index_split" in glove.hints[0]
    without = calibrated(DEFAULT, np.tile(LOW, (3, 1)), np.tile(np.where(bend, HIGH, LOW), (3, 1)))
    assert "channels left out, for no pose moves them: thumb_rotate, thumb_split" in without.hints[0]
    assert not without.slope[:, ~bend].any() and np.isfinite(without.angles(LOW)[0]).all()


def test_poses_that_say_nothing_are_refused() -> None:
    with pytest.raises(InputError, match="thumb_bend reads 800 in the open hand and in the fist"):
        calibrated(DEFAULT, np.full((2, 11), 800.0), np.full((2, 11), 800.0))
    with pytest.raises(InputError, match=r"fist: readings of shape \(11,\); expected \(N, 11\)"):
        calibrated(DEFAULT, np.zeros((2, 11)), np.zeros(11))
    lost = np.zeros((2, 11))
    lost[:, 4] = np.nan
    with pytest.raises(InputError, match="open hand: no reading of index_bend"):
        calibrated(DEFAULT, lost, np.ones((2, 11)))


def test_a_calibration_is_kept_as_toml(tmp_path: Path) -> None:
    glove = calibrated(DEFAULT, LOW[None], HIGH[None], HIGH[None])
    path = tmp_path / "glove.toml"
    path.write_text(format_calibration(glove))
    again = read_calibration(path)
    for key in ("open", "closed", "slope", "offset"):
        assert getattr(again, key).tobytes() == getattr(glove, key).tobytes(), key
    some = parse_calibration(
        "[angle]\nunit = 'deg'\n[joint]\nindex_flex2 = { offset = 2.0, index_bend = 98.0 }", where="glove.toml"
    )
    row = JOINT_NAMES.index("index_flex2")
    assert np.degrees(some.offset[row]) == pytest.approx(2.0) and np.degrees(some.slope[row, 4]) == pytest.approx(98.0)
    assert np.allclose(np.delete(some.slope, row, axis=0), np.delete(DEFAULT.slope, row, axis=0))


def session(tmp_path: Path, *, raw: bool) -> Path:
    """A flat hand, a fist, a spread hand, and then a fist again and again, 3 s each at 100 Hz; pinky names, no palm."""
    time = np.arange(1200) / 100.0
    bend, wide = np.zeros(1200), np.zeros(1200)
    bend[300:600], wide[600:900] = 1.0, 1.0
    bend[900:] = 0.5 - 0.5 * np.cos(2.0 * np.pi * (time[900:] - 9.0))
    # Poses change within 0.3 s.
    kernel = np.ones(31) / 31.0
    bend, wide = (np.convolve(np.pad(values, 15, mode="edge"), kernel, "valid") for values in (bend, wide))
    channels = np.where(np.isin(np.arange(11), BEND), bend[:, None], wide[:, None])
    rows = LOW + channels * (LOW + 2000.0 - LOW) if raw else channels
    names = ",".join(name.replace("little", "pinky") for name in CHANNELS)
    path = tmp_path / "session.csv"
    lines = [f"{t:.3f}," + ",".join(f"{value:.4f}" for value in row) for t, row in zip(time, rows)]
    path.write_text(f"time,{names}\n" + "\n".join(lines) + "\n")
    return path


def test_a_session_calibrates_itself_and_others(run: Run, tmp_path: Path) -> None:
    path = session(tmp_path, raw=True)
    code, out, err = run("import", str(path))
    assert code == 2 and out == "" and "raw counts; expected 0 to 1, or a calibration: --calibration, or" in err
    poses = ("--open", "0.5,2.5", "--fist", "3.5,5.5", "--spread", "6.5,8.5")
    code, out, err = run("import", str(path), *poses, "--save-calibration", "glove.toml", "--out", "one.h5")
    assert (code, err) == (0, "") and "joints beyond the first by linear regression" in out
    one = load_trajectory(tmp_path / "one.h5")
    assert np.degrees(one.flexion[450, 4]) == pytest.approx([85.0, 100.0, 66.6667], abs=0.01)
    assert [channel.name for channel in one.raw] == sorted(CHANNELS)
    assert one.raw[0].values[0] == pytest.approx(LOW[CHANNELS.index(one.raw[0].name)])
    code, _, err = run("import", str(path), "--calibration", "glove.toml", "--out", "two.h5")
    assert (code, err) == (0, "")
    assert load_trajectory(tmp_path / "two.h5").flexion.tobytes() == one.flexion.tobytes()
    for arguments, words in (
        (("--open", "0,1"), "needs --open and --fist"),
        (("--save-calibration", "x.toml"), "--save-calibration needs the poses"),
        (("--open", "0,1", "--fist", "90,91"), "no sample from 90 to 91 s, where the hand is said to be a fist"),
        (("--calibration", "none.toml"), "none.toml: no such file"),
    ):
        code, out, err = run("import", str(path), *arguments, "--out", "three.h5")
        assert code == 2 and words in err and len(err.splitlines()) == 1, err
    assert not (tmp_path / "three.h5").exists()


@pytest.mark.parametrize("unit", ["ms", "us", ""])
def test_poses_are_in_seconds_whatever_the_unit_of_the_stamps(run: Run, tmp_path: Path, unit: str) -> None:
    table = session(tmp_path, raw=True).read_text().splitlines()
    factor = {"ms": 1e3, "us": 1e6}.get(unit, 1e3)
    rows = (line.partition(",") for line in table[1:])
    text = "\n".join([table[0], *(f"{factor * float(stamp):.0f},{rest}" for stamp, _, rest in rows)]) + "\n"
    (tmp_path / "other.csv").write_text(text)
    poses = ("--open", "0.5,2.5", "--fist", "3.5,5.5")
    for name, more in (("session", ()), ("other", ("--time-unit", unit) if unit else ())):
        assert run("import", f"{name}.csv", *poses, *more, "--out", f"{name}.h5", "--quiet") == (0, "", "")
    one, other = (load_trajectory(tmp_path / f"{name}.h5") for name in ("session", "other"))
    assert other.flexion.tobytes() == one.flexion.tobytes() and np.allclose(other.time, one.time, atol=1e-9)
    code, _, err = run("import", "other.csv", "--open", "500,2500", "--fist", "3500,5500", "--out", "x.h5")
    assert code == 2 and "no sample from 500 to 2500 s" in err and "the stamps are from 0 to 11.99 s" in err


def test_the_page_has_the_header_of_a_gloves_table(repository: Path) -> None:
    page = (repository / "docs" / "lab" / "recordings.md").read_text(encoding="utf-8")
    header = next(line for line in page.splitlines() if line.startswith("time,thumb_rotate"))
    assert has_dexmo_channels(tuple(header.split(","))) and len(header.split(",")) == 12


def test_a_calibration_needs_a_dexmo(run: Run, tmp_path: Path) -> None:
    (tmp_path / "other.csv").write_text("a,b\n1,2\n2,3\n")
    code, _, err = run("import", "other.csv", "--open", "0,1", "--fist", "1,2")
    assert code == 2 and "a calibration of the Dexmo glove, but the file holds other columns" in err
