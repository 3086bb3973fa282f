"""A result as a table and for xarray: the values of the file, with names and units."""

import csv
import sys
from pathlib import Path

import numpy as np
import pytest
from short_grasp import short_result

from hhsim.errors import InputError, OutputError, UnknownNameError
from hhsim.hand.fingers import FINGERS
from hhsim.result.labelled import ALL, USUAL, export_ticks
from hhsim.result.reader import Result
from hhsim.result.schema import TICK_COLUMNS


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Result:
    return short_result(tmp_path_factory.mktemp("results") / "run.h5")


def test_a_data_set_has_every_value_by_name_with_its_unit(result: Result) -> None:
    pytest.importorskip("xarray")
    made = result.to_xarray()
    for column in TICK_COLUMNS:
        np.testing.assert_array_equal(made[column.name], result[column.name], err_msg=column.name)
        assert made[column.name].attrs == {"units": column.units, "long_name": column.long_name}
        assert len(made[column.name].dims) == 1 + len(column.shape)
    held = made.where(made.phase == "hold", drop=True)
    np.testing.assert_array_equal(held["force/total"], result["force/total"][result.phase("hold")])
    tip = made["graphic/joints"].sel(finger="index", point="tip", axis="z")
    np.testing.assert_array_equal(tip, result["graphic/joints"][:, FINGERS.index("index"), 3, 2])
    np.testing.assert_array_equal(made["graphic/orientation"].sel(quaternion="w"), result["graphic/orientation"][:, 0])
    assert made["graphic/flexion"].dims == ("time", "finger", "joint")
    assert made["force/phalanx"].dims == ("time", "finger", "phalanx", "axis")
    assert (str(made.hand.values), made.attrs["method"], made.attrs["object_name"]) == ("right", "coupled", "cylinder")
    assert set(result.to_xarray(["force"])) == {name for name in made if str(name).startswith("force/")}


def test_without_its_package_one_line_says_what_to_install(result: Result, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(InputError, match=r"^xarray is not installed: pip install 'hhsim\[xarray\]'$"):
        result.to_xarray()
    with pytest.raises(UnknownNameError, match="did you mean force/total"):
        result.to_xarray(["force/totl"])


def read(path: Path) -> tuple[list[str], np.ndarray]:
    with path.open(encoding="utf-8", newline="") as file:
        heading, *rows = csv.reader(file)
    return heading, np.array(rows, dtype=np.float64)


def test_every_tick_and_digit_is_read_back(result: Result, tmp_path: Path) -> None:
    headings = export_ticks(result, tmp_path / "all.csv", [ALL])
    first, table = read(tmp_path / "all.csv")
    assert first == ["tick", *headings] and len(set(headings)) == len(headings)
    assert table[:, 0].tolist() == list(range(result.ticks))
    at = 1
    for column in TICK_COLUMNS:
        size = int(np.prod(column.shape))
        stored = result[column.name].reshape(result.ticks, -1).astype(np.float64)
        np.testing.assert_array_equal(table[:, at : at + size], stored, err_msg=column.name)
        at += size
    phalanx, total = result["force/phalanx"], result["force/total"]
    assert list(headings[-6:]) == ["force/size [N]", *(f"force/finger[{finger}] [N]" for finger in range(5))]
    np.testing.assert_array_equal(table[:, at], np.linalg.norm(total, axis=1))
    np.testing.assert_array_equal(table[:, at + 1 :], np.linalg.norm(phalanx.sum(axis=2), axis=2))
    assert table[:, at + 1 :].max() > 0.0 and at + 6 == table.shape[1]


def test_the_usual_columns_have_their_units(result: Result, tmp_path: Path) -> None:
    headings = export_ticks(result, tmp_path / "ticks.csv")
    assert {heading.partition("[")[0].strip() for heading in headings} == set(USUAL)
    assert {"time [s]", "force/total[2] [N]", "penetration_depth [m]", "contacts/touching"} <= set(headings)
    assert export_ticks(result, tmp_path / "ticks.csv", ["time"]) == ("time [s]",), "ours is replaced"


def test_what_cannot_be_written_leaves_what_is_there(result: Result, tmp_path: Path) -> None:
    other = tmp_path / "motion.csv"
    other.write_text("time,position\n0,1\n")
    with pytest.raises(OutputError, match="is no table of ticks, so it is not replaced"):
        export_ticks(result, other)
    with pytest.raises(OutputError, match=r"has to end in \.csv"):
        export_ticks(result, tmp_path / "ticks.txt")
    with pytest.raises(OutputError, match="there is no folder"):
        export_ticks(result, tmp_path / "none" / "ticks.csv")
    with pytest.raises(InputError, match="unknown dataset 'force': did you mean"):
        export_ticks(result, tmp_path / "ticks.csv", ["force"])
    assert [path.name for path in tmp_path.iterdir()] == ["motion.csv"]
    assert other.read_text() == "time,position\n0,1\n"
