"""`hhsim import` as a user runs it."""

import json
from pathlib import Path

import numpy as np
import pytest
from conftest import Run
from recording_samples import smooth_recording

from hhsim.motion.file import load_trajectory, save_trajectory
from hhsim.recordings.repair import repair
from hhsim.result.reader import load_result

MOTION = repair(smooth_recording()).trajectory


@pytest.fixture
def damaged(tmp_path: Path) -> Path:
    """Our own CSV with a hole, a spike and a line cut short."""
    path = tmp_path / "session.csv"
    save_trajectory(MOTION, path)
    lines = path.read_text().splitlines()
    first = next(i for i, line in enumerate(lines) if line.startswith("time,")) + 1
    cells = lines[first + 20].split(",")
    lines[first + 20] = ",".join([*cells[:1], "9.5", *cells[2:]])
    cells = lines[first + 50].split(",")
    lines[first + 50] = ",".join([*cells[:10], "", *cells[11:]])
    lines[first + 70] = lines[first + 70][:40]
    path.write_text("\n".join(lines) + "\n")
    return path


def test_a_damaged_recording_is_mended_and_said_to_be(run: Run, damaged: Path, tmp_path: Path) -> None:
    code, out, err = run("import", str(damaged), "--out", "good.h5", "--plot", "good.png")
    assert (code, err) == (0, "")
    assert "session.csv, hhsim csv: right hand" in out
    for words in ("palm outlier", "fingers filled", "another number of cells", "299 samples where the file says"):
        assert words in out
    assert "299 of 299 samples" in out and "written to good.h5, drawn in good.png" in out
    motion = load_trajectory(tmp_path / "good.h5")
    assert motion.flags is not None and np.count_nonzero(motion.flags) == 2
    assert np.abs(motion.position - np.delete(MOTION.position, 70, axis=0)).max() < 0.01
    assert (tmp_path / "good.png").read_bytes().startswith(b"\x89PNG")


def test_machines_get_one_document(run: Run, damaged: Path) -> None:
    code, out, err = run("import", str(damaged), "--json")
    assert (code, err) == (0, "")
    document = json.loads(out)
    assert document["samples_in"] == document["samples_out"] == 299
    assert document["flags"] == {"fingers_filled": 1, "palm_outlier": 1}
    assert set(document["flag_meanings"]) == set(document["flags"])
    assert document["mended"] == 2 and document["path"].endswith("session.h5")
    assert {finding["kind"] for finding in document["findings"]} == {"note", "palm_outlier", "fingers_filled"}


def test_what_comes_out_goes_in_again_unchanged(run: Run, damaged: Path, tmp_path: Path) -> None:
    assert run("import", str(damaged), "--out", "one.csv", "--quiet") == (0, "", "")
    assert run("import", "one.csv", "--out", "two.csv", "--quiet") == (0, "", "")
    assert (tmp_path / "one.csv").read_bytes() == (tmp_path / "two.csv").read_bytes()


def test_refusals_are_one_line_and_leave_nothing(run: Run, damaged: Path, tmp_path: Path) -> None:
    empty = tmp_path / "empty.csv"
    empty.touch()
    (tmp_path / "other.csv").write_text("t,x\n0,1\n")
    cases = [
        (("import", "none.npz"), "none.npz: no such file"),
        (("import", str(empty)), "empty; expected a recording"),
        (("import", str(tmp_path)), "a folder; expected a recording"),
        (("import", str(damaged), "--format", "nzp"), "unknown format 'nzp': did you mean npz"),
        (("import", str(damaged), "--format", "npz"), "not an .npz archive"),
        (("import", str(damaged), "--columns", "none.toml"), "none.toml: no such file"),
        (("import", str(damaged), "--palm-axes", "x,y", "--format", "csv"), "expected three of x, y, z"),
        (("import", str(damaged), "--out", "good.txt"), "good.txt is no name for a trajectory: it has to end"),
        (("import", str(damaged), "--out", "other.csv"), "other.csv exists and is no trajectory, so it is"),
        (("import", str(damaged), "--out", str(damaged)), "is the recording itself"),
        (("import", str(damaged), "--plot", "plot.doc"), "plot.doc is no picture by its ending"),
        (("import", str(damaged), "--scale-to", "190"), "--hand-length"),
        (("import", str(damaged), "--from", "90"), "no sample from 90 to inf s"),
        (("import", str(damaged), "--time-unit", "ms"), "--time-unit"),
    ]
    for arguments, words in cases:
        code, out, err = run(*arguments)
        assert code == 2 and out == "" and words in err, (arguments, err)
        assert len(err.strip().splitlines()) == 1
    assert not list(tmp_path.glob("**/*.h5"))


def test_a_left_hand_replays_as_one(run: Run, repository: Path, tmp_path: Path) -> None:
    sample = repository / "trajectories" / "finger-tap.h5"
    code, out, err = run("import", str(sample), "--mirror", "--out", "left.h5")
    assert (code, err) == (0, "") and "left hand" in out and "mirrored: x became -x" in out
    # The shipped sphere, a metre away: the hand is what counts here.
    motion = load_trajectory(tmp_path / "left.h5").placed([1.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0])
    save_trajectory(motion, tmp_path / "left.h5")
    for options, side in (((), "left"), (("--hand", "right"), "right")):
        code, _, err = run("replay", "sphere", "left.h5", "--level", "2", "--quiet", "--out", "r.h5", *options)
        assert code == 0, err
        assert load_result(tmp_path / "r.h5").scene["hand"]["side"] == side
