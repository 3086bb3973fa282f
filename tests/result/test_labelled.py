"""A result for analysis: xarray, pandas and matplotlib are given the values of the file, with names and units."""

import sys

import numpy as np
import pytest
from short_grasp import short_result

from hhsim.errors import InputError, UnknownNameError
from hhsim.hand.fingers import FINGERS
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


def test_a_table_has_a_column_for_each_element(result: Result) -> None:
    pytest.importorskip("pandas")
    table = result.to_pandas()
    assert table.index.name == "time" and table.index.tolist() == result["time"].tolist()
    np.testing.assert_array_equal(table["force/phalanx[thumb,distal,y]"], result["force/phalanx"][:, 0, 2, 1])
    np.testing.assert_array_equal(table["force/size"], np.linalg.norm(result["force/total"], axis=1))
    assert table.shape[1] == 1 + sum(int(np.prod(column.shape)) for column in TICK_COLUMNS[1:]) + 6
    assert table.attrs["units"]["graphic/joints[little,tip,x]"] == "m"
    assert table.groupby("phase", observed=True)["lag"].count()["hold"] == len(result["lag"][result.phase("hold")])


def test_one_call_draws_what_is_asked_for(result: Result) -> None:
    from matplotlib import pyplot

    drawn = result.plot()
    curves = drawn.get_legend_handles_labels()[1]
    assert curves == ["force/size", *FINGERS] and drawn.get_ylabel() == "force [N]"
    np.testing.assert_array_equal(drawn.lines[0].get_ydata(), np.linalg.norm(result["force/total"], axis=1))
    assert [text.get_text() for text in drawn.texts] == [phase.name for phase in result.phases]
    assert result.plot("graphic/position", ax=drawn) is drawn and drawn.get_ylabel() == "graphic/position [m]"
    assert len(result.plot("penetration_depth").lines) == 1 + len(result.phases)
    with pytest.raises(InputError, match="graphic has rows along time in units of 1, m, rad: expected"):
        result.plot("graphic")
    with pytest.raises(UnknownNameError, match="did you mean force/total"):
        result.plot("force/totl")
    pyplot.close("all")


@pytest.mark.parametrize("package", ["xarray", "pandas"])
def test_without_its_package_one_line_says_what_to_install(
    package: str, result: Result, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(InputError, match=rf"^{package} is not installed: pip install 'hhsim\[{package}\]'$"):
        getattr(result, f"to_{package}")()
