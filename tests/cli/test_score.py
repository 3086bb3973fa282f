"""`hhsim scene` and `hhsim score`: the way of a newcomer, and what they say of a wrong one."""

import json
from pathlib import Path
from xml.etree import ElementTree as Xml

import pytest
from conftest import Run
from joint_samples import joint_sample, openxr_csv

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
