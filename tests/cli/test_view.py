"""`hhsim view` and `hhsim replay --rerun` as users meet them."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

Run = Callable[..., Any]

SHORT = """
title = "short"
[[phase]]
name = "approach"
duration = 0.05
[[phase]]
name = "grasp"
duration = 0.1
"""


@pytest.fixture
def short(tmp_path: Path) -> str:
    (tmp_path / "short.toml").write_text(SHORT)
    return "short.toml"


def test_a_replay_is_shown_and_can_be_looked_at_again(run: Run, tmp_path: Path, short: str) -> None:
    answer = run("replay", "cube", short, "--level", "2", "--out", "short.h5", "--rerun", "short.rrd", "--quiet")
    assert (answer.code, answer.out) == (0, ""), answer.err
    assert (tmp_path / "short.rrd").stat().st_size > 10_000
    answer = run("view", "short.h5", "--rerun", "again.rrd", "--every", "10", "--spheres")
    assert answer.code == 0, answer.err
    assert answer.out == "15 of 150 ticks went to again.rrd\n"
    answer = run("view", "short.h5", "--rerun", "again.rrd", "--json")
    document = json.loads(answer.out)
    assert document["seconds"] > 0.0
    assert {name: document[name] for name in ("result", "ticks", "shown_ticks", "rerun")} == {
        "result": "short.h5",
        "ticks": 150,
        "shown_ticks": 150,
        "rerun": "again.rrd",
    }


def test_what_cannot_be_shown_is_told_before_the_replay(run: Run, tmp_path: Path, short: str) -> None:
    answer = run("replay", "cube", short, "--out", "short.h5", "--rerun", "nowhere/short.rrd")
    assert answer.code == 2
    assert "there is no folder" in answer.err
    assert not (tmp_path / "short.h5").exists()
    assert (
        run("view", "missing.h5", "--rerun", "x.rrd").err
        == "hhsim: error: missing.h5: no such file; expected a result (.h5)\n"
    )
