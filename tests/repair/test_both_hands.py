"""Both hands of one recording, repaired in one command."""

import json
from pathlib import Path
from typing import Any

import pytest
from conftest import Run
from drawings_alone import leave_pictures_white
from leap_document import keypoint_table, leap_hand
from repair_scenes import HAND
from short_grasp import shortened

from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.result.reader import load_result
from hhsim.scene.declared_bodies import load_object
from hhsim.scene.described_scene import SceneWords, described_scene
from hhsim.scene.motion_catalogue import load_script
from hhsim.scene.scene import tree_maker

HANDS = HAND, HandModel.default("left")


@pytest.fixture(scope="module")
def document() -> dict[str, Any]:
    """What a Leap Motion would have written of both hands in a cube, whose keypoints are repaired."""
    script = shortened(load_script("grasp"), 1.0)
    bodies, words = load_object("cube").with_trees(tree_maker(2)), SceneWords(object="cube", trajectory="grasp")
    scene = described_scene(words, bodies, HANDS, (script, script)).scene
    ticks = [HandConfiguration.of(hand.ticks) for hand in scene.hands]
    frames = []
    for i in range(0, ticks[0].ticks, 250):
        hands, pointables = [], []
        for number, (hand, side) in enumerate(zip(HANDS, ("right", "left"))):
            shown, joints = leap_hand(hand, ticks[number].at(i))
            hands.append({"id": 7 + number, "type": side, **shown, "confidence": 0.9})
            pointables += [{"handId": 7 + number, "type": f, **joints[f]} for f in range(5)]
        frames.append({"id": i, "timestamp": 1000 * i, "hands": hands, "pointables": pointables})
    return {"metadata": {"formatVersion": 1, "frames": len(frames), "generatedBy": "LeapJS"}, "frames": frames}


@pytest.mark.soak
def test_one_command_frees_both_hands_in_one_file(
    run: Run, tmp_path: Path, document: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "two.csv").write_text(keypoint_table(document))
    words = ("--object", "cube", "--hands", "both", "--max-correction", "100")
    answer = run("repair", "two.csv", *words, "--out", "free.csv", "--json")
    found = json.loads(answer.out)
    for side in ("right", "left"):
        figures = found["hands"][side]["figures"]
        assert figures["depth_cones_max_before"] > 0.005 and figures["depth_cones_max_after"] == 0.0, side
    names = {path.name for path in tmp_path.iterdir()}
    each = {f"free-{side}-{name}" for side in ("right", "left") for name in ("report.html", "result.h5", "worst.png")}
    assert names == {"two.csv", "free.csv", *each}
    for side in ("right", "left"):
        result = load_result(tmp_path / f"free-{side}-result.h5")
        assert (result.side, result.scene["trajectory"]) == (side, "two.csv")
        assert found["hands"][side]["result"] == f"free-{side}-result.h5"
    leave_pictures_white(monkeypatch)
    # Both are in the file: read again, neither is inside, and nothing is left to repair.
    again = run("repair", "free.csv", *words, "--out", "again.csv", "--json")
    assert again.code == 0
    for side in ("right", "left"):
        assert json.loads(again.out)["hands"][side]["figures"]["depth_cones_max_before"] < 1e-5
    assert len((tmp_path / "free.csv").read_text().splitlines()) == 1 + len(document["frames"])


def test_a_hand_that_is_not_there_leaves_nothing(
    run: Run, tmp_path: Path, document: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    leave_pictures_white(monkeypatch)
    frames = [{**frame, "hands": frame["hands"][:1]} for frame in document["frames"]]
    (tmp_path / "one.csv").write_text(keypoint_table({"frames": frames}))
    answer = run("repair", "one.csv", "--object", "cube", "--hands", "both", "--out", "free.csv")
    assert answer.code == 2 and "no left hand" in answer.err
    assert [path.name for path in tmp_path.iterdir()] == ["one.csv"]
    refused = run("repair", "one.csv", "--object", "cube", "--hands", "both", "--hand", "left", "--out", "free.csv")
    assert refused.code == 2 and "--hands both repairs two" in refused.err


def test_a_format_that_is_not_written_is_of_one_hand(run: Run, tmp_path: Path, document: dict[str, Any]) -> None:
    (tmp_path / "two.json").write_text(json.dumps(document))
    answer = run("repair", "two.json", "--object", "cube", "--hands", "both", "--out", "free.csv")
    assert answer.code == 2 and "repair each hand for itself: --hand right|left" in answer.err
    words = ("--object", "cube", "--hand", "right", "--max-correction", "100", "--pictures", "none")
    refused = run("repair", "two.json", *words, "--out", "free.json")
    assert refused.code == 2 and "leap is read and not written; expected a name in .npz or .csv" in refused.err
    answer = run("repair", "two.json", *words, "--out", "free.npz", "--json")
    found = json.loads(answer.out)
    depth = [found["figures"][f"depth_cones_max_{when}"] for when in ("before", "after")]
    assert answer.code == 0 and depth[0] > 0.005 and depth[1] == 0.0
    assert any("free.npz has 21 joints [m] in the axes of the file" in text for text in found["findings"])
