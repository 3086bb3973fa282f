"""What is made of a result: a table, a data set of xarray, a motion."""

import csv
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
from file_faults import Fault, at, changed
from live_rings import make_setup, numbered_samples, session_file, solved_ticks
from short_grasp import short_grasp, short_result
from sphere_scenes import bumpy_ball

from hhsim.errors import InputError, OutputError, UnknownNameError
from hhsim.hand.fingers import FINGERS
from hhsim.hand.model import HandModel
from hhsim.recordings.registry import read_recording
from hhsim.replay.replay import replay_scene
from hhsim.result.labelled import ALL, USUAL, export_ticks
from hhsim.result.reader import Result, load_result
from hhsim.result.schema import TICK_COLUMNS
from hhsim.scene.motion_catalogue import resolve_trajectory
from hhsim.scene.scene import make_scene
from hhsim.solver.options import SolverOptions
from tools.shapes.generators import sphere


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


PLACE = (np.array([0.1, -0.2, 0.3]), np.array([0.8, 0.0, 0.6, 0.0]))


@pytest.fixture(scope="module")
def replayed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A replay beside an object that is neither at the world's origin nor upright."""
    path = tmp_path_factory.mktemp("replayed") / "run.h5"
    hand = HandModel.default()
    closure = make_scene(sphere(0.076, 3), bumpy_ball(200), hand, short_grasp(hold=0.1))
    scene = make_scene(sphere(0.076, 3), bumpy_ball(200), hand, closure.hands[0].trajectory.placed(*PLACE))
    replay_scene(scene, SolverOptions(), path)
    return path


def test_a_replay_of_a_replay_is_the_same(replayed: Path, tmp_path: Path) -> None:
    motion = resolve_trajectory(replayed)
    again = make_scene(sphere(0.076, 3), bumpy_ball(200), HandModel.default(), motion, mode="hold")
    replay_scene(again, SolverOptions(), tmp_path / "again.h5")
    first, second = load_result(replayed), load_result(tmp_path / "again.h5")
    for column in TICK_COLUMNS:
        if not column.name.startswith(("duration/", "haptic/orientation")):
            np.testing.assert_array_equal(first[column.name], second[column.name], err_msg=column.name)


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("session") / "session.h5"
    ticks = solved_ticks(make_setup(path))
    ticks["haptic_position"][:, 0] += 1e-4 * np.arange(len(ticks))
    samples = numbered_samples(ticks)
    # Two that were read together, and one that came before the first tick.
    samples["time_ns"][51] = samples["time_ns"][52]
    return session_file(path, ticks, "duration", samples=samples).path


def test_the_good_samples_of_a_session_are_its_motion(session: Path) -> None:
    motion, result = resolve_trajectory(session), load_result(session)
    used = [i for i in range(140) if i % 10 != 9 and i != 51]
    np.testing.assert_array_equal(motion.flexion, result["live/sample/flexion"][used])
    np.testing.assert_array_equal(motion.abduction, result["live/sample/abduction"][used])
    np.testing.assert_allclose(motion.time, 0.005 * np.array(used), atol=1e-12)
    assert (motion.device, motion.hand, motion.name) == ("test", "right", "session")
    # Read 0.1 ms before the tick: the palm was a tenth of a tick's way back, at the beginning where it began.
    at = 5 * np.array(used) - 0.1
    x = result["haptic/position"][:, 0]
    np.testing.assert_allclose(motion.position[:, 0], np.interp(at, np.arange(700), x), atol=2e-6)
    assert motion.position[0, 0] == x[0]


def test_a_session_is_imported_as_its_motion(session: Path) -> None:
    motion, recording = resolve_trajectory(session), read_recording(session)
    for name in ("time", "position", "flexion"):
        np.testing.assert_array_equal(getattr(recording, name), getattr(motion, name))
    assert recording.form == "hhsim"


def test_a_result_that_was_cut_short_is_a_motion_as_far_as_it_goes(session: Path, tmp_path: Path) -> None:
    path = tmp_path / "cut.h5"
    path.write_bytes(session.read_bytes())
    with changed(path) as file:
        file.attrs["complete"] = 0
        file["hands/right/tick/haptic/position"].resize(100, axis=0)
        file["hands/right/live/sample/flexion"].resize(31, axis=0)
    motion = resolve_trajectory(path)
    assert motion.sample_count == 28
    assert motion.position[-1, 0] == load_result(path)["haptic/position"][99, 0]


def no_ticks(file: h5py.File) -> None:
    file.attrs["complete"] = 0
    file["hands/right/live/tick/deadline"].resize(0, axis=0)


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (at("bad", "hands/right/live/sample/good", slice(None), np.zeros_like), "a session without a good sample of"),
        (lambda file: file["hands/right/live/tick/deadline"].resize(0, axis=0), "live/tick/deadline has 0 rows, "),
        (no_ticks, "a session without a tick: where the palm was"),
        (lambda file: file.__delitem__("hands/right/live/sample/abduction"), "unknown dataset 'live/sample/abduction'"),
        (at("nan", "hands/right/tick/haptic/position", 300, lambda x: np.nan * x), "position has 3 NaN or infinite"),
    ],
)
def test_what_holds_no_motion_is_told_in_one_line(session: Path, tmp_path: Path, spoil: Fault, says: str) -> None:
    path = tmp_path / "spoiled.h5"
    path.write_bytes(session.read_bytes())
    with changed(path) as file:
        spoil(file)
    with pytest.raises(InputError) as caught:
        resolve_trajectory(path)
    message = str(caught.value)
    assert message.startswith(str(path))
    assert says in message
    assert "\n" not in message
