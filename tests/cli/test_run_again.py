"""`hhsim replay RESULT` as users meet it."""

from dataclasses import replace
from pathlib import Path

import pytest
from conftest import Run
from drawings_alone import leave_report_undrawn
from file_faults import forge_scene
from sealed_change import changed
from short_grasp import short_grasp_text

from hhsim.replay import repeat


@pytest.fixture(scope="module")
def replayed() -> dict[str, bytes]:
    """What the one replay of these tests wrote, once there is one."""
    return {}


@pytest.fixture
def result(run: Run, tmp_path: Path, replayed: dict[str, bytes]) -> Path:
    path = tmp_path / "run.h5"
    if not replayed:
        (tmp_path / "short.toml").write_text(short_grasp_text())
        assert run("replay", "cube", "short.toml", "--out", path.name, "--quiet").code == 0
        replayed[path.name] = path.read_bytes()
    path.write_bytes(replayed[path.name])
    return path


def test_a_result_is_run_again_and_every_array_named(run: Run, result: Path) -> None:
    before = result.read_bytes()
    answer = run("replay", "run.h5")
    assert (answer.code, answer.err) == (0, "")
    lines = answer.out.splitlines()
    assert lines[0] == "run.h5: 200 ticks run again, 25 of 25 arrays identical"
    assert lines[-1] == "identical in every tick"
    assert sum("identical" in line for line in lines[1:-1]) == 25
    assert run("replay", "run.h5", "--quiet") == (0, "", "")
    document = run("replay", "run.h5", "--json").document()
    assert document["identical"] and document["word"] == "identical"
    assert document["arrays"]["force/total"]["identical"]
    assert result.read_bytes() == before


def test_what_differs_is_told_and_exits_1(run: Run, result: Path) -> None:
    with changed(result) as file:
        file["hands/right/tick/force/total"][41, 0] += 1.0
    answer = run("replay", "run.h5")
    assert answer.code == 1
    (line,) = [line for line in answer.out.splitlines()[:-1] if "different" in line]
    assert line.split() == ["force/total", "different", "1", "41", "1", "1e-09", "N"]
    quiet = run("replay", "run.h5", "--quiet")
    assert (quiet.code, quiet.out) == (1, "") and answer.out.splitlines()[-1] in quiet.err
    document = run("replay", "run.h5", "--json").document(1)
    assert (document["word"], document["identical"]) == ("different", False)


def test_what_another_machine_rounds_otherwise_is_within_rounding_and_exits_0(run: Run, result: Path) -> None:
    with changed(result) as file:
        file["hands/right/tick/graphic/position"][41, 0] *= 1.0 + 1e-15
    quiet = run("replay", "run.h5", "--quiet")
    assert (quiet.code, quiet.out) == (0, "") and "within rounding" in quiet.err
    document = run("replay", "run.h5", "--json").document()
    array = document["arrays"]["graphic/position"]
    assert (document["word"], document["identical"]) == ("within rounding", False)
    assert array["first_tick_beyond_rounding"] is None


@pytest.mark.parametrize("kind", ["i4", "f4"])
def test_an_array_of_another_type_is_compared_by_its_numbers(run: Run, result: Path, kind: str) -> None:
    with changed(result) as file:
        ticks = file["hands/right/tick"]
        attributes, values = dict(ticks["lag"].attrs), ticks["lag"][:].astype(kind)
        del ticks["lag"]
        ticks.create_dataset("lag", data=values).attrs.update(attributes)
    document = run("replay", "run.h5", "--json").document()
    assert document["word"] == "identical" and document["arrays"]["lag"]["identical"]
    with changed(result) as file:
        file["hands/right/tick/lag"][41] = 3
    assert run("replay", "run.h5", "--json").document(1)["arrays"]["lag"]["first_tick"] == 41


STRANGER = """
from pathlib import Path
Path("ran").touch()
class Follower:
    def __init__(self, scene): pass
    def begin(self, pose): pass
    def tick(self, haptic): return haptic
"""


def test_code_that_a_result_names_is_imported_with_trust_alone(
    run: Run, result: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    leave_report_undrawn(monkeypatch)
    (tmp_path / "stranger.py").write_text(STRANGER)
    with changed(result) as file:
        forge_scene(file, lambda scene: scene["solver"].update(method="stranger:Follower"))
    answer = run("replay", "run.h5")
    assert (answer.code, answer.out, len(answer.err.splitlines())) == (2, "", 1)
    assert "run.h5 names a method by its code" in answer.err and "--trust, if you trust the file" in answer.err
    verified = run("verify", "run.h5", "--every", "100", "--json").document()
    (again,) = (claim for claim in verified["claims"] if claim["name"] == "second run")
    assert again["verdict"] == "not judged" and "--trust" in again["note"]
    for words in (("report", "run.h5", "--out", "run.html"), ("compare", "run.h5", "run.h5")):
        assert run(*words).code == 0
    assert not (tmp_path / "ran").exists()
    assert "200 ticks run again" in run("replay", "run.h5", "--trust").out
    assert (tmp_path / "ran").exists()


def test_ticks_that_cannot_be_run_exit_1(run: Run, result: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = repeat.run_again
    monkeypatch.setattr(repeat, "run_again", lambda *words, **given: replace(whole(*words, **given), ticks=150))
    answer = run("replay", "run.h5")
    assert (answer.code, answer.out.splitlines()[-1]) == (1, "not all ticks run: 150 of 200")
    quiet = run("replay", "run.h5", "--quiet")
    assert (quiet.code, quiet.out) == (1, "") and "hhsim: missed: " in quiet.err
