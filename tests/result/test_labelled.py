"""A result for analysis: xarray is given the values of the file, with names and units."""

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


def test_without_its_package_one_line_says_what_to_install(result: Result, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(InputError, match=r"^xarray is not installed: pip install 'hhsim\[xarray\]'$"):
        result.to_xarray()
    with pytest.raises(UnknownNameError, match="did you mean force/total"):
        result.to_xarray(["force/totl"])
