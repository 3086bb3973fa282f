"""Eleven channels to twenty angles: the default, calibrations, and recordings."""

from pathlib import Path

import numpy as np
import pytest
from conftest import Run

from hhsim.arrays import FloatArray
from hhsim.hand.model import HandModel
from hhsim.recordings.column_map import JOINT_NAMES
from hhsim.recordings.dexmo_regression import BEND, CHANNELS, DexmoRegression, parse_calibration
from hhsim.recordings.registry import Content, ReadOptions, format_of, read_recording

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


CALIBRATION = """[channel]
{}

[angle]
unit = 'deg'

[joint]
index_flex2 = {{ offset = 2.0, index_bend = 98.0 }}
""".format("\n".join(f"{name} = {{ open = {a}, closed = {b} }}" for name, a, b in zip(CHANNELS, LOW, HIGH)))


def test_raw_counts_need_a_calibration(run: Run, tmp_path: Path) -> None:
    glove = parse_calibration(CALIBRATION, where="glove.toml")
    assert glove.counts_raw and not DEFAULT.counts_raw
    row = JOINT_NAMES.index("index_flex2")
    assert np.degrees(glove.offset[row]) == pytest.approx(2.0)
    assert np.degrees(glove.slope[row, 4]) == pytest.approx(98.0)
    assert np.allclose(np.delete(glove.slope, row, axis=0), np.delete(DEFAULT.slope, row, axis=0))
    channels = np.random.default_rng(4).uniform(0.0, 1.0, (20, 11))
    names = ",".join(name.replace("little", "pinky") for name in CHANNELS)
    rows = (f"{0.01 * k},{','.join(map(repr, row))}" for k, row in enumerate((LOW + channels * (HIGH - LOW)).tolist()))
    (tmp_path / "session.csv").write_text("\n".join([f"time,{names}", *rows]) + "\n")
    (tmp_path / "glove.toml").write_text(CALIBRATION)
    code, out, err = run("import", "session.csv")
    assert (code, out) == (2, "") and "raw counts; expected 0 to 1, or a calibration: --calibration" in err
    recording = read_recording(tmp_path / "session.csv", ReadOptions(dexmo=glove))
    assert np.allclose(recording.flexion, glove.angles(LOW + channels * (HIGH - LOW))[0])
    code, _, err = run("import", "session.csv", "--calibration", "none.toml")
    assert code == 2 and "none.toml: no such file" in err and len(err.splitlines()) == 1


def test_the_page_has_the_header_of_a_gloves_table(repository: Path) -> None:
    page = (repository / "docs" / "lab" / "recordings.md").read_text(encoding="utf-8")
    header = next(line for line in page.splitlines() if line.startswith("time,thumb_rotate"))
    assert format_of(Content(data=f"{header}\n".encode()), ReadOptions()).name == "dexmo"
    assert len(header.split(",")) == 12


def test_a_calibration_needs_a_dexmo(run: Run, tmp_path: Path) -> None:
    (tmp_path / "glove.toml").write_text(CALIBRATION)
    (tmp_path / "other.csv").write_text("a,b\n1,2\n2,3\n")
    code, _, err = run("import", "other.csv", "--calibration", "glove.toml")
    assert code == 2 and "a calibration of the Dexmo glove, but the file holds other columns" in err
