"""Commands of files: recordings in, trees and linkages, submissions scored."""

import json
import re
import shlex
from pathlib import Path
from xml.etree import ElementTree as Xml

import numpy as np
import pytest
from conftest import Run
from joint_samples import joint_sample, openxr_csv
from linkage_samples import write_box
from recording_samples import smooth_recording
from short_grasp import short_grasp_text

from hhsim.motion.file import load_trajectory, save_trajectory
from hhsim.motion.trajectory import UNCHECKED
from hhsim.recordings.cleaning import clean_recording
from hhsim.result.reader import load_result
from hhsim.system.checksummed_file import SIZE
from hhsim.trees.file import load_tree
from hhsim.trees.foreign_tree import save_sph

pytestmark = pytest.mark.usefixtures("read_here")

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
    assert np.count_nonzero(motion.flags) == 2
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


INPUTS = {
    # A command on the files of a folder, by its exit code and what it says.
    "import bvh-ring-mid/c6_mid.bvh": (0, "middle .*\n *ring "),
    "import bvh-unsided-hand/c4_unsided.bvh --hand right": (0, "right hand of 203 mm"),
    "import bvh-xsens-names/c5_xsens.bvh": (0, "right hand at 'RightHand'"),
    "import bvh-zero-positions/c2_zero6.bvh": (0, "0 in every frame: each stands at its OFFSET"),
    "import filled-called-held/a2_m1.npy --rate 30 --hand right": (0, "no hand was seen, so missing"),
    "import hdf5-of-others/r_generic.hdf5 --hand right --rate 30": (2, r"joints3d_right \(60, 21, 3\), object/pose"),
    "import joint-order-26-unity/s26_unity.npy --rate 30 --hand right": (
        2,
        "their order, --joint-order openxr or unity",
    ),
    "import npz-quat-xyzw/f4_xyzw.npz": (0, "no name tells the order of the quaternions, .*--pose-order"),
    "import openxr-location-flags/b1_flags.csv": (0, "without a valid position, says the device: missing"),
    "import ros-sec-nanosec/q_ros.csv --world-up y": (0, "right hand of 203 mm"),
    "build-tree obj-negative-indices/o_rel.obj --leaves 8": (0, "o_rel: 24 triangles"),
    "build-tree stl-ascii-no-endsolid/i2_two_noend.stl --leaves 8": (0, "no 'endsolid'(.|\n)*24 triangles"),
    "build-tree tree-spheres-of-metres/u_fan.stl --level 2": (0, r"\n +2 +64 +6\.(.|\n)*proved and checked"),
    "build-tree srdf-from/arm.urdf --from srdf-from/arm.srdf --as json": (0, "arm: 3 links"),
}


@pytest.mark.parametrize("line", INPUTS)
def test_a_file_that_somebody_brought_is_read_or_refused_for_what_it_is(
    line: str, run: Run, shared_data: Path, tmp_path: Path
) -> None:
    folder = shared_data / "field" / "inputs"
    words = [str(folder / word) if (folder / word).is_file() else word for word in shlex.split(line)]
    out = tmp_path / f"o.{'json' if 'json' in words else 'h5'}"
    expected, said = INPUTS[line]
    code, shown, told = run(*words, "--out", str(out))
    assert code == expected and re.search(said, told + shown), told + shown
    assert out.exists() == (code == 0) and (code == 0 or told.count("\n") == 1)


SCENE = ("cube", "touch", "--rate", "200")


@pytest.mark.soak
def test_a_newcomers_way(run: Run, tmp_path: Path) -> None:
    made = run("scene", *SCENE, "--out", "s", "--json")
    document = json.loads(made.out)
    assert made.code == 0 and document["ticks"] == 600
    assert set(document["files"]) == {path.name for path in (tmp_path / "s").iterdir()}
    readme = (tmp_path / "s" / "README.md").read_text()
    assert all(f"`{name}`" in readme for name in document["files"] if name != "README.md")
    Xml.parse(tmp_path / "s" / "hand.xml")
    numbers = json.loads((tmp_path / "s" / "hand.json").read_text())
    assert len(numbers["fingers"]) == 5 and len(numbers["palm_spheres"]) > 20
    # The motion is one that hhsim replays.
    assert run("replay", "cube", "s/motion.csv", "--out", "m.h5", "--quiet").code == 0

    scored = run("score", "s/example-submission.csv", "--out", "r.h5")
    assert scored.code == 0, scored.err
    assert "in the mesh, max" in scored.out and "off the least-energy pose, mean" in scored.out
    # By its own words the scene is made again, and everything is the same.
    alone = tmp_path / "alone.csv"
    alone.write_bytes((tmp_path / "s" / "example-submission.csv").read_bytes())
    again = run("score", "alone.csv", "--out", "r2.h5", "--json").document()
    first = run("score", "alone.csv", "--scene", "s", "--out", "r3.h5", "--json").document()
    names = ("scene", "mesh_depth_max", "off_best_mean", "penetration_max", "contact_error_max")
    assert [again[name] for name in names] == [first[name] for name in names]

    replayed = run("replay", "r.h5")
    assert replayed.code == 2 and "hhsim score measures their file anew" in replayed.err
    named = run("replay", "cube", "touch", "--method", "submission:x", "--out", "x.h5")
    assert named.code == 2 and "computed elsewhere" in named.err and not (tmp_path / "x.h5").exists()
    compared = run("compare", "m.h5", "r.h5")
    assert "tick in contact" not in compared.out.split("B is")[1]


def test_the_scene_of_a_recording_says_that_it_was_imported(run: Run, tmp_path: Path) -> None:
    (tmp_path / "take.csv").write_text(openxr_csv(joint_sample(count=8)))
    made = run("scene", "cube", "take.csv", "--rate", "200", "--level", "2", "--out", "s", "--json")
    assert made.code == 0 and json.loads(made.out)["ticks"] > 0
    assert "on the way in: hhsim import tells what" in made.err


def test_what_is_suspected_is_said_and_the_exit_code_is_1(run: Run, tmp_path: Path) -> None:
    run("scene", *SCENE, "--out", "s", "--quiet")
    lines = (tmp_path / "s" / "example-submission.csv").read_text().splitlines()
    head = next(i for i, line in enumerate(lines) if line.startswith("time"))
    rows = [line.split(",") for line in lines[head + 1 :]]
    scaled = [",".join([row[0], *(repr(1e3 * float(cell)) for cell in row[1:4]), *row[4:]]) for row in rows]
    (tmp_path / "s" / "mm.csv").write_text("\n".join([*lines[: head + 1], *scaled]))
    found = run("score", "s/mm.csv", "--out", "r.h5", "--json")
    assert found.code == 1 and "suspected" in found.err
    assert "another unit, frame, order or time?" in json.loads(found.out)["suspicions"][0]


@pytest.mark.soak
def test_two_hands_and_a_free_body_are_scored_and_other_blocks_are_refused(run: Run, tmp_path: Path) -> None:
    both = ("cube", "lift-both", "--hands", "both", "--free", "--rate", "100", "--level", "2")
    made = run("scene", *both, "--out", "s", "--json")
    files = json.loads(made.out)["files"]
    assert made.code == 0 and {"left_motion.csv", "right_hand.xml", "object.obj", "scene.xml"} < set(files)
    readme = (tmp_path / "s" / "README.md").read_text()
    assert all(f"`{name}`" in readme for name in files if name != "README.md")
    poses = (tmp_path / "s" / "example-submission.csv").read_text()
    # Also without the folder.
    (tmp_path / "mine.csv").write_text(poses)
    document = run("score", "mine.csv", "--out", "r.h5", "--json").document()
    assert set(document["hands"]) == {"right", "left"} and document["body_depth_max"] < 1e-6
    verified = run("verify", "r.h5", "--every", "50", "--json").document()
    assert "FAILS" not in json.dumps(verified)
    shown = run("score", "mine.csv", "--scene", "s", "--out", "r2.h5").out
    assert "right hand" in shown and "left hand" in shown and "bodies in each other, max" in shown

    alone = poses.replace("left_", "right_").replace(",right_", ",", 1)
    for text, told in (
        (poses.replace("object_", "cube_"), "has poses of bodies cube; expected those that are free: object"),
        (alone, "twice"),
        (poses.replace("object_qz", "object_speed"), "unknown column 'object_speed'"),
        (poses.replace(",left_px", ",px"), "columns of one hand and of the right and the left one; expected either"),
    ):
        (tmp_path / "wrong.csv").write_text(text)
        refused = run("score", "wrong.csv", "--out", "r3.h5")
        assert refused.code == 2 and len(refused.err.strip().splitlines()) == 1 and told in refused.err, refused.err
        assert not (tmp_path / "r3.h5").exists()


@pytest.fixture
def box(tmp_path: Path) -> Path:
    """A box away from the origin, in millimetres."""
    return write_box(tmp_path / "box.obj", (70.0, 70.0, 70.0), (200.0, 0.0, 30.0))


def test_a_file_of_the_toolkit_becomes_a_measured_tree(run: Run, tmp_path: Path, box: Path) -> None:
    assert run("build-tree", box.name, "--unit", "mm", "--level", "1", "--out", "own.h5", "--quiet").code == 0
    own = load_tree(tmp_path / "own.h5")
    # In the unit of the mesh file, counted from the middle of the box.
    save_sph(own.transformed(np.eye(3), [-0.2, 0.0, -0.03]).scaled(1e3), tmp_path / "theirs.sph")
    answer = run("build-tree", box.name, "--unit", "mm", "--from", "theirs.sph", "--out", "found.h5")
    assert answer.code == 0, answer.err
    assert "note: taken to count from the centre of the mesh's bounding box: mean gap " in answer.out
    assert answer.out.splitlines()[-1] == "8 leaves, read from theirs.sph, written to found.h5"
    assert "proved" not in answer.out.replace("proved bound", ""), "a file without proofs has none"
    found = load_tree(tmp_path / "found.h5")
    np.testing.assert_allclose(found.center, own.center, atol=1e-12)
    assert found.mesh_sha256 == own.mesh_sha256
    wrong = run("build-tree", box.name, "--unit", "mm", "--from", "theirs.sph", "--from-unit", "m")
    assert wrong.code == 2
    assert "is it in another unit" in wrong.err


def test_a_replay_takes_the_tree_of_a_file(run: Run, tmp_path: Path, box: Path) -> None:
    (tmp_path / "short.toml").write_text(short_grasp_text())
    assert run("build-tree", "cube", "--level", "2", "--out", "cube.h5", "--quiet").code == 0
    assert run("build-tree", "cube", "--level", "2", "--out", "cube.sph", "--quiet").code == 0
    joints = []
    for options in (["--level", "2"], ["--tree", "cube.h5"], ["--tree", "cube.sph"]):
        answer = run("replay", "cube", "short.toml", *options, "--out", "run.h5")
        assert answer.code == 0, answer.err
        result = load_result(tmp_path / "run.h5")
        assert result.scene["level"] == 2
        assert result.scene["tree"] == (options[1] if options[0] == "--tree" else None)
        assert (f"note: the sphere tree is that of {options[1]}" in answer.out) == (options[0] == "--tree")
        joints.append(result["graphic/joints"])
    # What ships was built on another processor, whose last bits differ.
    assert joints[0] == pytest.approx(joints[1], rel=0.0, abs=1e-9)
    assert np.array_equal(joints[1], joints[2])
    other = run("replay", box.name, "short.toml", "--unit", "mm", "--tree", "cube.h5")
    assert other.code == 2
    assert "cube.h5: built for the mesh" in other.err
