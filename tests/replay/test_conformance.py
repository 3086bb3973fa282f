"""The conformance test tells a newcomer what is wrong, and nothing that is not."""

from pathlib import Path

import pytest
from conftest import Run

from hhsim.replay.conformance import NOTE, OK, WRONG, check_method


@pytest.mark.parametrize(
    ("name", "finding", "verdict", "says"),
    [
        ("Millimetres", "free space", WRONG, "another unit or frame?"),
        ("Mirrored", "free space", WRONG, "another unit or frame?"),
        ("Degrees", "joint limits", WRONG, "degrees?"),
        ("TurnedForces", "forces", WRONG, "turned?"),
        ("Promises", "depth", WRONG, "promises not to"),
        ("Boasts", "run", WRONG, "native_ns of 1000000000000000: expected 0 to"),
        ("Raises", "run", WRONG, "ZeroDivisionError"),
        ("NoTick", "import", WRONG, "lacks tick"),
        ("NotBuilt", "installed", WRONG, "needs a library that is not built"),
        ("Follow", "depth", NOTE, "inside the object"),
        ("Random", "repeatable", NOTE, "differs from tick 0"),
        ("Lazy", "first tick", NOTE, "prepare in __init__"),
    ],
)
@pytest.mark.quick(
    "Millimetres-free space-wrong-another unit or frame?",
    "TurnedForces-forces-wrong-turned?",
    "Boasts-run-wrong-native_ns of 1000000000000000: expected 0 to",
    "Raises-run-wrong-ZeroDivisionError",
    "NoTick-import-wrong-lacks tick",
    "NotBuilt-installed-wrong-needs a library that is not built",
    "Lazy-first tick-note-prepare in __init__",
)
def test_what_is_wrong_is_named(name: str, finding: str, verdict: str, says: str) -> None:
    found = {each.name: each for each in check_method(f"outside_methods:{name}")}
    assert found[finding].verdict == verdict
    assert says in found[finding].says
    wrong = {each.name for each in found.values() if each.verdict == WRONG}
    # A hand that is far away never touches: that follows from the first.
    assert wrong - {"contact"} == ({finding} if verdict == WRONG else set())


def test_our_own_method_from_outside_passes(run: Run) -> None:
    answer = run("methods", "check", "outside_methods:OurOwn")
    assert answer.code == 0 and answer.out.endswith("outside_methods:OurOwn can be measured\n")
    assert "a tick in contact takes" in answer.out
    assert answer.out.startswith("import ") and "──" not in answer.out, "three columns without headings have no rule"
    assert run("methods", "check", "outside_methods:NoTick").code == 1


@pytest.mark.soak
def test_the_example_is_sixty_lines_at_most_and_passes(repository: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    example = repository / "examples" / "project_out.py"
    assert len(example.read_text(encoding="utf-8").splitlines()) <= 60
    monkeypatch.syspath_prepend(str(example.parent))
    found = {finding.name: finding.verdict for finding in check_method("project_out:ProjectOut")}
    assert found == {**dict.fromkeys(found, OK), "depth": NOTE}, "phalanges between its balls are not looked at"
