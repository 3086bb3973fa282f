"""The viewer that gets ready beside a replay: the same recording, and nothing left behind when something fails.

A process that has imported rerun, as that of the tests has, cannot be forked; what forks runs in a python of its own.
"""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from rerun_files import Recording
from short_grasp import short_grasp, short_scene

from hhsim.replay.replay import replay_scene
from hhsim.result.reader import Result, load_result
from hhsim.solver.options import SolverOptions
from hhsim.view.background_viewer import can_fork
from hhsim.view.sink import parse_target
from hhsim.view.viewer import view_result

FORKED = """
import os, signal, sys
from pathlib import Path
from hhsim.view.sink import parse_target
from hhsim.view.background_viewer import ViewAhead, can_fork
result, target = Path(sys.argv[1]), parse_target(sys.argv[2])
assert can_fork()
with ViewAhead(target) as viewer:
    viewer.settle()
    viewer.settle()
    assert "rerun" not in sys.modules
    {body}
"""

linux = pytest.mark.skipif(sys.platform != "linux", reason="no process is forked here")


def forked(body: str, *arguments: object) -> subprocess.CompletedProcess[str]:
    """Run a body in which `viewer` is ready to show `result`."""
    words = [sys.executable, "-c", FORKED.format(body=body), *map(str, arguments)]
    return subprocess.run(words, capture_output=True, text=True)


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Result:
    scene = short_scene(short_grasp(hold=0.0))
    path = tmp_path_factory.mktemp("replay") / "short.h5"
    calls: list[str] = []

    def before_ticks() -> None:
        assert path.exists()
        calls.append("before ticks")

    replay_scene(
        scene, SolverOptions(), path, description={"hand_file": None}, before_ticks=before_ticks,
        progress=lambda what, done, total: calls.append(what),
    )  # fmt: skip
    assert calls.index("before ticks") == calls.index("ticks") - 1
    assert calls.count("before ticks") == 1
    return load_result(path)


@linux
def test_the_process_beside_writes_what_this_one_would(result: Result, tmp_path: Path) -> None:
    body = "print(viewer.show(result, lambda *step: print(*step)).to_json())"
    answer = forked(body, result.path, tmp_path / "beside.rrd")
    assert answer.returncode == 0, answer.stderr
    *steps, viewed = answer.stdout.splitlines()
    assert steps == ["ticks 0 150", "ticks 150 150"]
    here = view_result(result, parse_target(str(tmp_path / "here.rrd")))
    assert viewed == str({**here.to_json(), "rerun": str(tmp_path / "beside.rrd")})
    beside, same = Recording(tmp_path / "beside.rrd"), Recording(tmp_path / "here.rrd")
    assert (beside.blueprints, beside.fixed.keys()) == (1, same.fixed.keys())
    for entity, column in (
        ("/world/contacts/points", "Points3D:positions"),
        ("/world/forces", "Arrows3D:vectors"),
        ("/plots/time", "Scalars:scalars"),
    ):
        np.testing.assert_equal(beside.rows(entity, column), same.rows(entity, column))


@linux
@pytest.mark.soak
def test_what_the_process_beside_cannot_do_is_told_here_and_so_is_its_death(result: Result, tmp_path: Path) -> None:
    body = """
    def show(viewer):
        try:
            viewer.show(result)
        except Exception as error:
            print(type(error).__name__, error)
    target.path.parent.rmdir()
    show(viewer)
    with ViewAhead(parse_target(sys.argv[3])) as other:
        other.settle()
        os.kill(other._process.pid, signal.SIGKILL)
        show(other)
"""
    folder, path = tmp_path / "gone", tmp_path / "x.rrd"
    folder.mkdir()
    answer = forked(body, result.path, folder / "x.rrd", path)
    assert (answer.returncode, answer.stderr) == (0, "")
    failed, died = answer.stdout.splitlines()
    assert failed.startswith(f"OutputError there is no folder {folder} for x.rrd")
    assert died == f"HhsimError nothing went to {path}: the process that shows it ended with code -9"
    assert list(tmp_path.iterdir()) == []


@linux
@pytest.mark.soak
def test_a_replay_that_fails_leaves_neither_file_nor_process(result: Result, tmp_path: Path) -> None:
    body = """
    print(viewer._process.pid)
    os.setpgid(0, 0)
    raise SystemExit(7)
"""
    answer = forked(body, result.path, tmp_path / "x.rrd")
    assert (answer.returncode, answer.stderr) == (7, "")
    with pytest.raises(ProcessLookupError):
        os.kill(int(answer.stdout), 0)
    assert list(tmp_path.iterdir()) == []


def test_a_process_with_rerun_in_it_is_not_forked() -> None:
    import rerun  # noqa: F401

    assert not can_fork()
