"""`hhsim import` as a user runs it."""

import json
from pathlib import Path

import numpy as np
import pytest
from conftest import Run
from joint_samples import joint_sample, openxr_csv
from recording_samples import smooth_recording

from hhsim.hand.model import HandModel
from hhsim.motion.file import load_trajectory, save_trajectory
from hhsim.motion.trajectory import UNCHECKED
from hhsim.recordings.cleaning import clean_recording
from hhsim.recordings.joint_names import KEYPOINTS, OPENXR_JOINTS
from hhsim.result.reader import load_result
from hhsim.system.checksummed_file import SIZE

MOTION = clean_recording(smooth_recording()).trajectory


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
    code, out, err = run("import", str(damaged), "--out", "good.h5")
    assert (code, err) == (0, "")
    assert "session.csv, hhsim csv: right hand" in out
    for words in ("palm outlier", "fingers filled", "another number of cells", "299 samples where the file says"):
        assert words in out
    assert "299 of 299 samples" in out and "written to good.h5" in out
    motion = load_trajectory(tmp_path / "good.h5")
    assert motion.flags is not None and np.count_nonzero(motion.flags) == 2
    assert np.abs(motion.position - np.delete(MOTION.position, 70, axis=0)).max() < 0.01


def test_machines_get_one_document(run: Run, damaged: Path) -> None:
    code, out, err = run("import", str(damaged), "--json")
    assert (code, err) == (0, "")
    document = json.loads(out)
    assert document["samples_in"] == document["samples_out"] == 299
    assert document["flags"] == {"fingers_filled": 1, "palm_outlier": 1}
    assert set(document["flag_meanings"]) == set(document["flags"])
    assert document["mended"] == 2 and document["path"].endswith("session.h5")
    assert {finding["kind"] for finding in document["findings"]} == {"note", "palm_outlier", "fingers_filled"}


def test_a_recording_without_checksums_is_said_to_have_none(run: Run, damaged: Path, tmp_path: Path) -> None:
    def checksums(name: str) -> str:
        code, out, _ = run("import", name, "--out", f"of-{name}.h5", "--json")
        assert code == 0
        word = json.loads(out)["checksums"]
        assert load_trajectory(tmp_path / f"of-{name}.h5").checksums == word
        return str(word)

    save_trajectory(MOTION, tmp_path / "own.h5")
    (tmp_path / "bare.h5").write_bytes((tmp_path / "own.h5").read_bytes()[:-SIZE])
    np.savez(tmp_path / "take.npz", a=joint_sample().named(), t=joint_sample().motion.time)
    names = ("session.csv", "of-session.csv.h5", "own.h5", "bare.h5", "take.npz")
    assert [checksums(name) for name in names] == ["missing", "missing", "held", "missing", "held"]
    assert f"\n{UNCHECKED}\n" in run("import", "session.csv", "--out", "good.h5").out
    assert UNCHECKED not in run("import", "take.npz", "--out", "good.h5").out


def test_what_comes_out_goes_in_again_unchanged(run: Run, damaged: Path, tmp_path: Path) -> None:
    assert run("import", str(damaged), "--out", "one.csv", "--quiet") == (0, "", "")
    assert run("import", "one.csv", "--out", "two.csv", "--quiet") == (0, "", "")
    assert (tmp_path / "one.csv").read_bytes() == (tmp_path / "two.csv").read_bytes()


@pytest.mark.soak
def test_a_left_hand_replays_as_one(run: Run, repository: Path, tmp_path: Path) -> None:
    sample = repository / "trajectories" / "finger-tap.h5"
    code, out, err = run("import", str(sample), "--other-hand", "--out", "left.h5")
    assert (code, err) == (0, "") and "left hand" in out and "mirrored: x became -x" in out
    # The shipped sphere, a metre away: the hand is what counts here.
    motion = load_trajectory(tmp_path / "left.h5").placed([1.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0])
    save_trajectory(motion, tmp_path / "left.h5")
    options = ("--level", "2", "--rate", "100", "--quiet", "--out", "r.h5")
    for more, side in (((), "left"), (("--hand", "right"), "right")):
        code, _, err = run("replay", "sphere", "left.h5", *options, *more)
        assert code == 0, err
        assert load_result(tmp_path / "r.h5").scene["hand"]["side"] == side


@pytest.mark.soak
def test_joint_centres_give_a_motion_the_error_of_the_fit_and_a_hand(run: Run, tmp_path: Path) -> None:
    sample = joint_sample(length=0.175)
    (tmp_path / "quest.csv").write_text(openxr_csv(sample))
    code, out, err = run("import", "quest.csv", "--fit-hand", "me.toml", "--out", "quest.h5")
    assert (code, err) == (0, "")
    assert "a hand with the recorded bones" in out and "fit, rms [mm]" in out
    assert "written to quest.h5, its hand to me.toml" in out
    hand, motion = HandModel.from_toml(tmp_path / "me.toml"), load_trajectory(tmp_path / "quest.h5")
    # The hand file has micrometres.
    assert np.abs(hand.length - sample.hand.length).max() < 1e-6
    assert np.abs(hand.radius - sample.hand.radius).max() < 1e-6
    for k in (0, 20, 39):
        posed = hand.joints(motion.position[k], motion.orientation[k], motion.flexion[k], motion.abduction[k])
        recorded = sample.joints[k][[OPENXR_JOINTS.index(joint) for joint in KEYPOINTS[1:]]]
        assert np.abs(posed.reshape(20, 3) - recorded).max() < 5e-6
