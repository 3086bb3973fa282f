"""Repair in memory: the arrays are those of the file that the command writes."""

import pydoc
import sys
from pathlib import Path

import numpy as np
import pytest
from repair_scenes import HAND, scene_case

import hhsim
from hhsim.errors import HhsimError, InputError
from hhsim.mesh.catalogue import load_object
from hhsim.recordings.registry import ReadOptions
from hhsim.repair.in_memory import RepairedMotion, repair
from hhsim.repair.recorded_scene import model_joints
from hhsim.repair.repair import repair_recording
from hhsim.repair.request import RepairRequest

RATE, LIMIT = 30.0, 0.03
SHIFT = np.linspace(0.0, 0.2, 12)[:, None] * [1.0, 0.5, 0.2]
JOINTS = model_joints(HAND, scene_case("sphere", "grasp", 100, 3, 15).frames) + SHIFT[:, None]


@pytest.fixture(scope="module")
def found() -> RepairedMotion:
    return hhsim.repair(JOINTS, "sphere", rate=RATE, hand="right", object_position=SHIFT, max_correction=LIMIT)


def test_arrays_are_repaired_as_the_file_that_holds_them(found: RepairedMotion, tmp_path: Path) -> None:
    path, out = tmp_path / "grasp.npz", tmp_path / "free.npz"
    upright = np.tile([1.0, 0.0, 0.0, 0.0], (len(JOINTS), 1))
    np.savez(path, keypoints=JOINTS, object_pos=SHIFT, object_quat_wxyz=upright, fps=RATE)
    read = ReadOptions(hand="right", length_unit="m")
    repair_recording(RepairRequest(path, "sphere", out, max_correction=LIMIT, read=read, pictures=False))
    np.testing.assert_allclose(found.joints, np.load(out)["keypoints"], atol=1e-12)
    of_file = repair(path, load_object("sphere").mesh, hand="right", max_correction=LIMIT, length_unit="m")
    np.testing.assert_array_equal(of_file.joints, found.joints)
    assert not (tmp_path / "free-report.html").exists()
    assert found.depth_before.max() > 5e-3 and not found.depth_after.any() and not found.marked.any()
    np.testing.assert_array_equal(found.joints[~found.changed], JOINTS[~found.changed])
    assert 0 < found.changed.sum() < len(JOINTS)


def test_a_sample_without_a_hand_stays_so() -> None:
    holed = JOINTS.copy()
    holed[2] = np.nan
    found = repair(holed, "sphere", rate=RATE, hand="right", object_position=SHIFT, max_correction=LIMIT)
    assert np.isnan(found.joints[2]).all() and np.isnan(found.depth_after[2]) and not found.changed[2]
    assert np.nanmax(found.depth_after) == 0.0


def test_as_a_data_set_it_has_the_same_values(found: RepairedMotion, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(InputError, match="xarray is not installed"):
        found.to_xarray()
    monkeypatch.undo()
    pytest.importorskip("xarray")
    made = found.to_xarray()
    assert made.sizes == {"time": 12, "joint": 21, "axis": 3}
    np.testing.assert_array_equal(made["joints"].sel(joint="index_tip"), found.joints[:, 8])


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"rate": None}, "no stamps of the samples"),
        ({"object_position": SHIFT[:5]}, "object_pos"),
        ({"joints": JOINTS[:, :20]}, r"no array of shape .T, 21, 3."),
        ({"joints": "none.npz", "object_position": None}, "no such file"),
        ({"joints": "grasp.npz"}, "expected them with joints alone"),
    ],
)
def test_what_does_not_fit_is_told_in_one_line(given: dict[str, object], said: str) -> None:
    words = {"joints": JOINTS, "rate": RATE, "object_position": SHIFT, **given}
    with pytest.raises(HhsimError, match=said) as caught:
        repair(words.pop("joints"), "sphere", hand="right", **words)
    assert "\n" not in str(caught.value)


def test_help_of_the_package_is_that_of_its_function() -> None:
    text = pydoc.plain(pydoc.render_doc(hhsim.repair))
    assert "object_position: Where the object's frame is" in text and "max_correction=0.015" in text
