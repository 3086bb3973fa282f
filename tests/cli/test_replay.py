"""`hhsim replay` as users meet it: what it prints, what it writes, and what it leaves behind when it is stopped."""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import h5py
import numpy as np
import pytest
from conftest import Run, Terminal
from linkage_samples import write_box
from own_command import HHSIM
from recording_samples import write_descent
from sampled import sampled
from short_grasp import short_grasp_text

from hhsim.result.reader import load_result
from hhsim.result.schema import TICK_COLUMNS, hand_columns

pytestmark = pytest.mark.slow


@pytest.fixture
def short(tmp_path: Path) -> Path:
    path = tmp_path / "short.toml"
    path.write_text(short_grasp_text())
    return path


def hhsim(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [*HHSIM, *arguments]
    return subprocess.run(command, capture_output=True, text=True, cwd=folder, stdin=subprocess.DEVNULL)


@pytest.mark.parametrize("surface", ["spheres", "mesh"])
def test_a_replay_prints_a_table_and_writes_every_tick(run: Run, tmp_path: Path, short: Path, surface: str) -> None:
    answer = run("replay", "cube", short.name, "--surface", surface, "--level", "2", "--rerun", "short.rrd")
    assert answer.code == 0, answer.err
    assert (tmp_path / "short.rrd").stat().st_size > 10_000
    (path,) = (tmp_path / "results").iterdir()
    mesh = surface == "mesh"
    assert path.name.endswith("-cube-short-coupled-mesh.h5" if mesh else "-cube-short-coupled.h5")
    assert answer.out.startswith(f"cube, short, coupled{', mesh' if mesh else ''}: 200 ticks\n")
    assert ("stays out of the object's mesh in every tick" in answer.out) == mesh
    assert answer.out.splitlines()[-1] == f"every tick is in results/{path.name}"
    result = load_result(path)
    assert result.complete
    assert result.ticks == 200
    assert [phase.name for phase in result.phases] == ["approach", "grasp", "hold"]
    assert result.scene["object"] == "cube"
    assert result.scene["seed"] == 0
    assert all(np.isfinite(result[name]).all() for name in ("graphic/joints", "force/phalanx", "force/palm_wrench"))
    assert result["contacts/candidates"].max() > 0
    assert result["penetration_depth"].max() <= 1e-6


@pytest.mark.soak
def test_the_same_input_gives_the_same_bytes_but_for_the_timings(run: Run, tmp_path: Path, short: Path) -> None:
    arguments = ("replay", "rock", short.name, "--level", "2", "--tremor", "0.1,0.2", "--quiet", "--out")
    # Once in this process, which has run other things, and once in a new one.
    assert run(*arguments, "a.h5") == (0, "", "")
    new = hhsim(tmp_path, *arguments, "b.h5")
    assert (new.returncode, new.stdout) == (0, ""), new.stderr
    first, second = load_result(tmp_path / "a.h5"), load_result(tmp_path / "b.h5")
    for column in TICK_COLUMNS:
        if not column.name.startswith("duration/"):
            assert first[column.name].tobytes() == second[column.name].tobytes(), column.name
    for name, array in first.static.items():
        assert array.tobytes() == second.static[name].tobytes(), name
    assert first.scene == second.scene


def test_what_the_scene_does_not_need_is_left_out_and_told(run: Run, tmp_path: Path, short: Path) -> None:
    options = ["--fingers", "index,thumb", "--max-error", "2mm", "--budget", "50000", "--json", "--out", "run.h5"]
    assert run("replay", "cube", short.name, *options).document()["fingers_modelled"] == 2
    result = load_result(tmp_path / "run.h5")
    assert result.scene["solver"]["fingers"] == result.scene["modelled"]["fingers"] == ["thumb", "index"]
    assert (result.scene["level"], result.scene["max_error"]) == (3, 2e-3)
    assert result.scene["solver"]["budget"] == 50_000
    table_text = run("replay", "cube", short.name, *options[:4], "--out", "run.h5").out
    assert "note: level 3 is the coarsest within 2 mm: 512 spheres, which reach out of the mesh by 1." in table_text


def test_a_replay_of_which_most_ticks_are_stuck_ends_with_1(
    run: Run, short: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # No input that is taken makes one: every run counts as one here.
    monkeypatch.setattr("hhsim.metrics.run.ticks.MOST_STUCK", -1.0)
    answer = run("replay", "cube", short.name, "--level", "2", "--ticks", "50", "--out", "run.h5", "--quiet")
    assert (answer.code, answer.out) == (1, "")
    assert "hhsim: missed: " in answer.err and "More than half of the ticks are stuck" in answer.err
    with_json = run("replay", "cube", short.name, "--level", "2", "--ticks", "50", "--out", "run.h5", "--json")
    assert with_json.code == 1 and json.loads(with_json.out)["verdict"]["mostly_stuck"] is True


@pytest.mark.parametrize(
    ("suffix", "samples"),
    sampled(
        [(suffix, samples) for suffix in (".csv", ".h5") for samples in ("interpolate", "hold")],
        lambda place, _: place in (0, 3),
    ),
)
def test_a_recording_of_ones_own_is_replayed(run: Run, tmp_path: Path, suffix: str, samples: str) -> None:
    write_descent(tmp_path / f"motion{suffix}")
    command = ("replay", "cube", f"motion{suffix}", "--samples", samples, "--level", "2")
    answer = run(*command, "--out", "run.h5", "--quiet")
    assert answer == (0, "", "")
    height = load_result(tmp_path / "run.h5")["haptic/position"][:, 2]
    assert (len(np.unique(height)) == 50) == (samples == "hold")


def test_a_mesh_of_ones_own_is_replayed_and_its_size_doubted(run: Run, tmp_path: Path, short: Path) -> None:
    write_box(tmp_path / "box.obj", (70.0, 70.0, 70.0))
    right = run("replay", "box.obj", short.name, "--unit", "mm", "--level", "2", "--out", "run.h5")
    assert right.code == 0, right.err
    assert np.ptp(load_result(tmp_path / "run.h5").body.vertices, axis=0) == pytest.approx(0.07)
    wrong = run("replay", "box.obj", short.name, "--level", "2", "--out", "wrong.h5")
    assert (wrong.code, len(wrong.err.splitlines())) == (2, 1)
    assert "is the file in millimetres? pass --unit mm" in wrong.err
    doubted = run("replay", "box.obj", short.name, "--size", "5000", "--level", "2", "--out", "large.h5")
    assert doubted.code == 0, "a size that was stated is not doubted"


LONG = short_grasp_text().replace("duration = 0.05\n", "duration = 30.0\n")


@pytest.mark.soak
def test_an_interrupt_keeps_the_ticks_and_says_where(tmp_path: Path) -> None:
    (tmp_path / "long.toml").write_text(LONG)
    path = tmp_path / "run.h5"
    command = [*HHSIM, "replay", "cube", "long.toml", "--level", "2", "--out", path.name]
    process = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    while process.poll() is None and not (path.exists() and has_ticks(path)):
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate()
    result = load_result(path)
    assert process.returncode == 130, err
    assert out == ""
    assert err.splitlines()[-1] == f"hhsim: interrupted; the {result.ticks:,} ticks so far are in run.h5 (complete = 0)"
    assert not result.complete
    assert 0 < result.ticks < 60_000


def has_ticks(path: Path) -> bool:
    try:
        with h5py.File(path, "r", locking=False) as file:
            return all(len(file["hands/right/tick"][column.name]) > 0 for column in hand_columns())
    except (OSError, KeyError):
        return False


def test_progress_shows_on_a_terminal_only(run: Run, short: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    command = ("replay", "cube", short.name, "--level", "2", "--out", "run.h5", "--json")
    with monkeypatch.context() as patched:
        patched.setattr("hhsim.cli.console.SILENCE", 3600.0)
        assert run(*command).err == ""
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    answer = run(*command)
    assert "ticks" in terminal.getvalue()
    assert json.loads(answer.out)["ticks"] == 200


@pytest.mark.soak
def test_a_recording_of_a_bare_hand_gets_its_object_placed(run: Run, tmp_path: Path) -> None:
    time_ = np.linspace(0.0, 0.49, 50)
    flexion = np.interp(time_, [0.0, 0.4], [0.1, 1.0])[:, None, None] * np.ones((1, 5, 3))
    np.savez(
        tmp_path / "fist.npz",
        t=time_,
        wrist_pos=np.tile([0.0, 0.0, 0.4], (50, 1)),
        wrist_quat_wxyz=np.tile([1.0, 0.0, 0.0, 0.0], (50, 1)),
        flex=flexion,
        abd=np.zeros((50, 5)),
    )
    command = ("replay", "cup", "fist.npz", "--place-object", "auto", "--level", "2", "--out", "fist.h5", "--json")
    document = run(*command).document()
    notes = " ".join(document["notes"])
    assert (
        "of 50 samples were mended on the way in: hhsim import tells what" in notes and "object placed where" in notes
    )
    placed = load_result(tmp_path / "fist.h5").scene["placement"]
    assert placed["how"] == "closing fingers" and placed["depth"] > 0.0 and len(placed["position"]) == 3
    assert document["placement"] == placed
    assert document["penetration_max"] <= 1e-6 and document["touching_max"] > 0
