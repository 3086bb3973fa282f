"""Two hands as users meet them: replay, and every command that reads what it wrote."""

import json
from pathlib import Path

import pytest
from conftest import Run
from drawings_alone import leave_report_undrawn
from short_grasp import short_grasp_text


@pytest.fixture(scope="module")
def kept() -> dict[str, bytes]:
    """What the one replay of these tests wrote."""
    return {}


@pytest.fixture
def both(run: Run, tmp_path: Path, kept: dict[str, bytes]) -> Path:
    path = tmp_path / "both.h5"
    (tmp_path / "short.toml").write_text(short_grasp_text())
    if not kept:
        answer = run("replay", "cube", "short.toml", "--hands", "both", "--out", path.name)
        assert (answer.code, answer.err) == (0, "")
        assert "right hand" in answer.out and "left hand" in answer.out
        assert "note: a tick of both hands, side by side: p50" in answer.out
        kept[path.name] = path.read_bytes()
    path.write_bytes(kept[path.name])
    return path


def test_it_is_verified_and_run_again_hand_by_hand(run: Run, both: Path) -> None:
    answer = run("replay", "both.h5")
    assert (answer.code, answer.out.count("identical in every tick")) == (0, 2)
    assert "both.h5/left: 200 ticks run again" in answer.out
    assert run("replay", "both.h5/left", "--quiet") == (0, "", "")
    document = json.loads(run("replay", "both.h5", "--json").out)
    assert [hand["result"] for hand in document["hands"]] == ["both.h5/right", "both.h5/left"]
    found = run("verify", "both.h5", "--json", "--quiet")
    assert found.code == 0 and len(json.loads(found.out)["hands"]) == 2


def test_it_is_judged_shown_and_reported(run: Run, both: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    answer = run("gate", "both.h5", "--json")
    rows = json.loads(answer.out)["rows"]
    assert answer.code == 0 and {row["scene"] for row in rows} == {"right", "left"}
    assert run("gate", "both.h5", "--baseline", "both.h5", "--quiet").code == 0
    one = run("gate", "both.h5", "--baseline", "both.h5/left", "--quiet")
    assert one.code == 2 and "not of as many hands" in one.err
    leave_report_undrawn(monkeypatch)
    assert run("report", "both.h5", "--out", "page.html").code == 0
    assert "left out" not in run("board", "both.h5").out
    assert "left of two hands" in (both.parent / "page.html").read_text()
    seen = run("view", "both.h5", "--rerun", "both.rrd", "--json")
    assert [Path(one["file"]).name for one in json.loads(seen.out)["files"]] == ["right", "left"]
    assert run("view", "both.h5", "--video", "both.gif", "--pixels", "160").code == 0
    assert run("export", "both.h5/left", "left.csv").code == 0


@pytest.mark.parametrize(
    ("arguments", "said"),
    [(("--repeat", "2"), "--repeat is of one hand"), (("--rerun", "one.rrd"), "--rerun is of one hand")],
)
def test_what_is_of_one_hand_is_refused(run: Run, tmp_path: Path, arguments: tuple[str, ...], said: str) -> None:
    (tmp_path / "short.toml").write_text(short_grasp_text())
    answer = run("replay", "cube", "short.toml", "--hands", "both", *arguments)
    assert answer.code == 2 and said in answer.err


def test_a_command_of_one_hand_says_how_to_name_it(run: Run, both: Path) -> None:
    for arguments in (("export", "both.h5", "x.csv"), ("compare", "both.h5", "both.h5")):
        answer = run(*arguments)
        assert answer.code == 2 and "both.h5/right or both.h5/left" in answer.err
    answer = run("verify", "both.h5/middle")
    assert answer.code == 2 and "no such file" in answer.err
