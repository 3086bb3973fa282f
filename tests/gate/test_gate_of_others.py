"""A gate for other people's work: a method, a recording and a session, and what goes wrong in each."""

import json
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from conftest import Answer, Run
from gate_scene import SHORT
from live_session import write_session
from own_command import HHSIM
from sealed_change import changed
from short_grasp import short_grasp, short_scene

from hhsim.gate.gate import gate_result
from hhsim.gate.verdict import LOST
from hhsim.kernels.tick.state import STATUS_LAG, STATUS_STUCK
from hhsim.result.reader import load_result
from hhsim.result.safety import Safety

pytestmark = pytest.mark.slow

Gate = Callable[..., Answer]

METHOD = '''
"""A method of a company's own, which counts its work."""

import hhsim

EXTRA_WORK = 0
FREEZES = False


class Own:
    """hhsim's solver as a company wraps it."""

    gives_forces = True
    gives_work = True
    never_penetrates = True

    def __init__(self, scene):
        options = hhsim.SolverOptions(period=scene.period)
        self.solver = hhsim.HandSolver(scene.hand, scene.tree.arrays(), options)

    def begin(self, pose):
        self.solver.place(*pose)
        self.ticks, self.last = 0, None

    def tick(self, haptic):
        self.ticks += 1
        if FREEZES and self.ticks % 100 > 60:
            return self.last
        self.last = self.answer(haptic)
        return self.last

    def answer(self, haptic):
        tick = self.solver.run(*(values[None] for values in haptic))
        palm = tick.total[0] - tick.phalanx[0].sum(axis=(0, 1))
        shown, work = hhsim.HandConfiguration.of(tick).at(0), int(tick.work[0].sum()) + EXTRA_WORK
        return hhsim.TickAnswer(shown, tick.phalanx[0], palm, work=work)
'''

SUITE = """
version = 1
baseline = "baseline.json"
[limits]
penetration_max = 1e-6
stuck_ticks = 0
lag_ticks = 0
force_contact_max = 20.0
[[scene]]
name = "method"
object = "cube"
trajectory = "short.toml"
method = "own_method:Own"
[[scene]]
name = "recording"
object = "cylinder"
trajectory = "recording.csv"
level = 2
"""


def write_recording(path: Path) -> None:
    """A grasp, at 100 Hz."""
    ticks = short_scene(short_grasp(release=0.05)).hands[0].ticks
    fingers = ("thumb", "index", "middle", "ring", "little")
    names = ["time", "px", "py", "pz", "qw", "qx", "qy", "qz"]
    names += [f"{finger}_flex{joint}" for finger in fingers for joint in (1, 2, 3)] + [f"{one}_abd" for one in fingers]
    columns = (ticks.time, ticks.position, ticks.orientation, ticks.flexion, ticks.abduction)
    rows = np.concatenate([values.reshape(len(ticks.time), -1) for values in columns], axis=1)[::10]
    np.savetxt(path, rows, delimiter=",", header=f"# hand: right\n{','.join(names)}", comments="", fmt="%.9g")


def hhsim(*arguments: str, folder: Path) -> "subprocess.CompletedProcess[bytes]":
    """The command in a process of its own, as a user types it in a folder."""
    return subprocess.run([*HHSIM, *arguments], cwd=folder, capture_output=True)


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A repository of nothing but a method, a recording, and a suite with its baseline."""
    folder = tmp_path_factory.mktemp("company")
    (folder / "own_method.py").write_text(METHOD)
    (folder / "short.toml").write_text(SHORT)
    write_recording(folder / "recording.csv")
    (folder / "hhsim-gate.toml").write_text(SUITE)
    hhsim("gate", "--no-time", "--write-baseline", "baseline.json", folder=folder)
    return folder


@pytest.fixture
def gate(run: Run, monkeypatch: pytest.MonkeyPatch) -> Gate:
    """The command in a project's folder."""

    def called(folder: Path, *arguments: str) -> Answer:
        monkeypatch.chdir(folder)
        return run("gate", "--no-time", *arguments)

    return called


@pytest.fixture
def head(project: Path, tmp_path: Path) -> Path:
    """A checkout of it to change."""
    return Path(shutil.copytree(project, tmp_path / "head"))


def only(head: Path, scene: str) -> None:
    """Leave one scene in the suite."""
    parts = (head / "hhsim-gate.toml").read_text().split("[[scene]]\n")
    kept = [part for part in parts[1:] if part.startswith(f'name = "{scene}"')]
    (head / "hhsim-gate.toml").write_text("[[scene]]\n".join([parts[0], *kept]))


def method(old: str, new: str) -> Callable[[Path], None]:
    def plant(head: Path) -> None:
        text = (head / "own_method.py").read_text()
        assert old in text
        (head / "own_method.py").write_text(text.replace(old, new))

    return plant


REGRESSIONS: dict[str, tuple[Callable[[Path], object], str]] = {
    "freezes": (
        method("FREEZES = False", "FREEZES = True"),
        "method, joints off the input in free space, max: over the limit",
    ),
    "no work told": (method("gives_work = True", ""), f"method, work units: {LOST}"),
    "no forces told": (method("gives_forces = True", ""), f"method, largest force step while moving: {LOST}"),
}
"""What a change may do to a project, and the line that names the scene and the figure."""


@pytest.mark.soak
def test_what_is_not_hhsims_own_is_gated_and_green(project: Path, gate: Gate) -> None:
    answer = gate(project, "--json")
    assert answer.code == 0, answer.out + answer.err
    rows = json.loads(answer.out)["rows"]
    judged = {(row["scene"], row["name"]) for row in rows if row["limit"] is not None and row["head"] is not None}
    assert {*(("method", "penetration_max"), ("method", "work_units"), ("recording", "stuck_ticks"))} <= judged
    # What a method does not tell has no row, however the suite limits it.
    assert not {("method", "stuck_ticks"), ("method", "linearisations")} & judged


@pytest.mark.parametrize("regression", REGRESSIONS)
@pytest.mark.soak
def test_a_regression_of_others_is_red_and_named_in_one_line(head: Path, gate: Gate, regression: str) -> None:
    plant, line = REGRESSIONS[regression]
    only(head, line.split(",")[0])
    plant(head)
    answer = gate(head, "--quiet")
    assert answer.code == 1, answer.out + answer.err
    assert line in answer.err
    (told,) = (said for said in answer.err.splitlines() if line in said)
    assert told.startswith("hhsim: gate: ")


@pytest.mark.soak
def test_a_limit_on_what_a_run_does_not_have_is_told_in_a_line(head: Path, gate: Gate) -> None:
    only(head, "method")
    text = (head / "hhsim-gate.toml").read_text()
    (head / "hhsim-gate.toml").write_text(f"{text}[scene.limits]\nlag_max = 1e-6\nrows_max = 0\n")
    answer = gate(head)
    assert answer.code == 0, answer.out
    untold = "method: limit on stuck_ticks, lag_ticks, lag_max, rows_max not judged: the method does not tell it"
    assert f"note: {untold}" in answer.out.splitlines()


@pytest.mark.soak
def test_a_scene_that_the_base_lacks_is_judged_by_its_limits(
    project: Path, head: Path, tmp_path: Path, gate: Gate
) -> None:
    base = Path(shutil.copytree(project, tmp_path / "base"))
    (base / "recording.csv").unlink()
    (base / "own_method.py").unlink()
    for scene in ("recording", "method"):
        shutil.copy(project / "hhsim-gate.toml", head / "hhsim-gate.toml")
        only(head, scene)
        answer = gate(head, "--base-folder", str(base))
        assert answer.code == 0 and f"{scene}, inputs: new, so judged by limits alone" in answer.out, answer.out


@pytest.mark.soak
def test_a_base_folder_has_the_files_of_the_base(project: Path, head: Path, gate: Gate) -> None:
    only(head, "method")
    method("EXTRA_WORK = 0", "EXTRA_WORK = 900")(head)
    # A baseline that the head brings with it is not what the base did.
    assert gate(head, "--write-baseline", "baseline.json", "--quiet").code == 0
    answer = gate(head, "--base-folder", str(project), "--quiet")
    assert answer.code == 1 and "method, work units" in answer.err
    assert "no such folder" in gate(head, "--base-folder", "nowhere").err


@pytest.mark.soak
def test_a_result_is_judged_the_same_in_every_folder(project: Path, tmp_path: Path) -> None:
    """The module of its method, a suite and a baseline of the folder change nothing."""
    path = tmp_path / "own.h5"
    made = ("replay", "cube", "short.toml", "--method", "own_method:Own", "--out", str(path), "--quiet")
    assert hhsim(*made, folder=project).returncode == 0
    folders = {name: tmp_path / name for name in ("another method", "broken")}
    for folder in folders.values():
        folder.mkdir()
    (folders["another method"] / "own_method.py").write_text(METHOD.replace("never_penetrates = True", ""))
    (folders["broken"] / "own_method.py").write_text("raise SystemExit(3)")
    (folders["broken"] / "hhsim-gate.toml").write_text("version = ")
    answers = set()
    for folder in (project, *folders.values()):
        run = hhsim("gate", str(path), "--all", folder=folder)
        answers.add((run.returncode, run.stdout, run.stderr))
    ((exit_code, out, _),) = answers
    assert exit_code == 0 and b"penetration, max" in out
    (row,) = (row for row in gate_result(load_result(path)).rows if row.name == "penetration_max")
    assert row.limit == 1e-6, "its file says that the method promises it"


def test_a_session_is_judged_by_its_file_and_its_faults_are_named(tmp_path: Path) -> None:
    path = tmp_path / "session.h5"
    write_session(path)
    figures = {"stuck_ticks", "lag_ticks", "ended_early", "malformed_share", "freed_share"}
    assert not {row.name for row in gate_result(load_result(path)).missed} & figures
    with changed(path) as file:
        hand = file["hands/right"]
        hand["tick/status"][50:60] = STATUS_STUCK | STATUS_LAG
        hand["live/tick/safety"][50:60] = Safety.STALE_INPUT
        counters = {**json.loads(hand["live"].attrs["counters"]), "frames": 60_000, "malformed": 1280}
        hand["live"].attrs.update({"counters": json.dumps(counters), "ended": "the loop failed or was killed"})
    assert figures <= {row.name for row in gate_result(load_result(path)).missed}
