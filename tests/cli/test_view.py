"""`hhsim view` and `hhsim replay --rerun` as users meet them."""

import json
from pathlib import Path

import pytest
from conftest import Run
from short_grasp import short_grasp_text


@pytest.fixture
def short(tmp_path: Path) -> str:
    (tmp_path / "short.toml").write_text(short_grasp_text())
    return "short.toml"


def test_a_replay_is_shown_and_can_be_looked_at_again(run: Run, tmp_path: Path, short: str) -> None:
    answer = run("replay", "cube", short, "--level", "2", "--out", "short.h5", "--rerun", "short.rrd", "--quiet")
    assert (answer.code, answer.out) == (0, ""), answer.err
    assert (tmp_path / "short.rrd").stat().st_size > 10_000
    answer = run("view", "short.h5", "--rerun", "again.rrd", "--every", "10", "--spheres")
    assert answer.code == 0, answer.err
    assert answer.out == "20 of 200 ticks went to again.rrd\n"
    answer = run("view", "short.h5", "--rerun", "again.rrd", "--json")
    document = json.loads(answer.out)
    assert document["seconds"] > 0.0
    expected = {"result": "short.h5", "ticks": 200, "shown_ticks": 200, "rerun": "again.rrd"}
    assert expected.items() <= document.items()


def test_a_film_is_made_without_a_viewer(run: Run, tmp_path: Path, short: str) -> None:
    assert run("replay", "cube", short, "--level", "2", "--out", "short.h5", "--quiet").code == 0
    answer = run("view", "short.h5", "--video", "short.gif", "--pixels", "160")
    assert (answer.code, answer.out) == (0, "6 frames of 200 ticks, 0.2 s, in short.gif\n"), answer.err
    assert (tmp_path / "short.gif").read_bytes().startswith(b"GIF89a")
