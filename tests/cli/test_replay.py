"""`hhsim replay` as users meet it: what it prints, what it writes, and what it leaves behind when it is stopped."""

import json
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from conftest import Run, Terminal, sampled
from drawings_alone import leave_report_undrawn
from file_faults import changed, forge_scene
from own_command import HHSIM
from recording_samples import write_descent
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


def test_a_replay_of_which_most_ticks_are_stuck_ends_with_1(
    run: Run, short: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # No input that is taken makes one: every run counts as one here.
    monkeypatch.setattr("hhsim.metrics.run.ticks.MOST_STUCK", -1.0)
    answer = run("replay", "cube", short.name, "--level", "2", "--ticks", "50", "--out", "run.h5", "--json")
    assert answer.code == 1 and json.loads(answer.out)["verdict"]["mostly_stuck"] is True


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
    palm = {"wrist_pos": np.tile([0.0, 0.0, 0.4], (50, 1)), "wrist_quat_wxyz": np.tile(np.eye(4)[0], (50, 1))}
    np.savez(tmp_path / "fist.npz", t=time_, **palm, flex=flexion, abd=np.zeros((50, 5)))
    command = ("replay", "cup", "fist.npz", "--place-object", "auto", "--level", "2", "--out", "fist.h5", "--json")
    document = run(*command).document()
    notes = " ".join(document["notes"])
    assert "of 50 samples were mended on the way in: hhsim import tells what" in notes
    assert "object placed where" in notes
    placed = load_result(tmp_path / "fist.h5").scene["placement"]
    assert placed["how"] == "closing fingers" and placed["depth"] > 0.0 and len(placed["position"]) == 3
    assert document["placement"] == placed
    assert document["penetration_max"] <= 1e-6 and document["touching_max"] > 0


def test_a_command_of_one_hand_says_how_to_name_it(run: Run, tmp_path: Path) -> None:
    (tmp_path / "short.toml").write_text(short_grasp_text())
    answer = run("replay", "cube", "short.toml", "--hands", "both", "--out", "both.h5")
    assert answer.code == 0, answer.err
    assert "right hand" in answer.out and "left hand" in answer.out
    assert "note: a tick of both hands, side by side: p50" in answer.out
    for arguments in (("export", "both.h5", "x.csv"), ("compare", "both.h5", "both.h5")):
        answer = run(*arguments)
        assert answer.code == 2 and "both.h5 holds two hands: --hand right or --hand left names one" in answer.err
    assert run("compare", "both.h5", "both.h5", "--hand", "right,left").code == 0
    assert run("replay", "cube", "short.toml", "--out", "one.h5", "--quiet").code == 0
    answer = run("export", "one.h5", "x.csv", "--hand", "left")
    assert answer.code == 2 and "one.h5 has no left hand: it holds the right one" in answer.err
    one = run("gate", "both.h5", "--baseline", "one.h5", "--quiet")
    assert one.code == 2 and "not of as many hands" in one.err


@pytest.fixture(scope="module")
def replayed() -> dict[str, bytes]:
    """What the one replay of these tests wrote, once there is one."""
    return {}


@pytest.fixture
def result(run: Run, tmp_path: Path, replayed: dict[str, bytes]) -> Path:
    path = tmp_path / "run.h5"
    if not replayed:
        (tmp_path / "short.toml").write_text(short_grasp_text())
        assert run("replay", "cube", "short.toml", "--out", path.name, "--quiet").code == 0
        replayed[path.name] = path.read_bytes()
    path.write_bytes(replayed[path.name])
    return path


def test_a_result_is_run_again_and_every_array_named(run: Run, result: Path) -> None:
    before = result.read_bytes()
    answer = run("replay", "run.h5")
    assert (answer.code, answer.err) == (0, "")
    lines = answer.out.splitlines()
    assert lines[0] == "run.h5: 200 ticks run again, 25 of 25 arrays identical"
    assert lines[-1] == "identical in every tick"
    assert sum("identical" in line for line in lines[1:-1]) == 25
    assert run("replay", "run.h5", "--quiet") == (0, "", "")
    document = run("replay", "run.h5", "--json").document()
    assert document["identical"] and document["word"] == "identical"
    assert document["arrays"]["force/total"]["identical"]
    assert result.read_bytes() == before


@pytest.mark.parametrize(
    ("name", "change", "code", "word"),
    [
        ("force/total", lambda x: x + 1.0, 1, "different"),
        ("graphic/position", lambda x: x * (1.0 + 1e-15), 0, "within rounding"),
    ],
)
def test_what_differs_is_told_and_exits_1_beyond_rounding(
    run: Run, result: Path, name: str, change: Callable[[Any], Any], code: int, word: str
) -> None:
    with changed(result) as file:
        file[f"hands/right/tick/{name}"][41, 0] = change(file[f"hands/right/tick/{name}"][41, 0])
    answer = run("replay", "run.h5")
    assert answer.code == code
    (line,) = [line for line in answer.out.splitlines()[:-1] if word in line]
    assert line.split()[0] == name
    quiet = run("replay", "run.h5", "--quiet")
    assert (quiet.code, quiet.out) == (code, "") and answer.out.splitlines()[-1] in quiet.err
    document = run("replay", "run.h5", "--json").document(code)
    assert (document["word"], document["identical"]) == (word, False)
    assert document["arrays"][name]["first_tick_beyond_rounding"] == (41 if code else None)


@pytest.mark.parametrize("kind", ["i4", "f4"])
def test_an_array_of_another_type_is_compared_by_its_numbers(run: Run, result: Path, kind: str) -> None:
    with changed(result) as file:
        ticks = file["hands/right/tick"]
        attributes, values = dict(ticks["lag"].attrs), ticks["lag"][:].astype(kind)
        del ticks["lag"]
        ticks.create_dataset("lag", data=values).attrs.update(attributes)
    document = run("replay", "run.h5", "--json").document()
    assert document["word"] == "identical" and document["arrays"]["lag"]["identical"]
    with changed(result) as file:
        file["hands/right/tick/lag"][41] = 3
    assert run("replay", "run.h5", "--json").document(1)["arrays"]["lag"]["first_tick"] == 41


STRANGER = """
from pathlib import Path
Path("ran").touch()
class Follower:
    def __init__(self, scene): pass
    def begin(self, pose): pass
    def tick(self, haptic): return haptic
"""


def test_code_that_a_result_names_is_imported_with_trust_alone(
    run: Run, result: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    leave_report_undrawn(monkeypatch)
    (tmp_path / "stranger.py").write_text(STRANGER)
    with changed(result) as file:
        forge_scene(file, lambda scene: scene["solver"].update(method="stranger:Follower"))
    answer = run("replay", "run.h5")
    assert (answer.code, answer.out, len(answer.err.splitlines())) == (2, "", 1)
    assert "run.h5 names a method by its code" in answer.err and "--trust, if you trust the file" in answer.err
    verified = run("verify", "run.h5", "--every", "100", "--json").document()
    (again,) = (claim for claim in verified["claims"] if claim["name"] == "second run")
    assert again["verdict"] == "not judged" and "--trust" in again["note"]
    for words in (("report", "run.h5", "--out", "run.html"), ("compare", "run.h5", "run.h5")):
        assert run(*words).code == 0
    assert not (tmp_path / "ran").exists()
    assert "200 ticks run again" in run("replay", "run.h5", "--trust").out
    assert (tmp_path / "ran").exists()
