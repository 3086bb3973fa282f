"""A method from outside all the way, and the conformance test, which tells a newcomer what is wrong and no more."""

import json
from pathlib import Path

import pytest
from conftest import Run
from drawings_alone import leave_report_undrawn
from short_grasp import short_grasp, short_result, short_scene

from hhsim.errors import InputError
from hhsim.metrics.run.registry import known_figures, run_metrics
from hhsim.replay.conformance import NOTE, OK, WRONG, check_method
from hhsim.replay.repeat import run_again
from hhsim.replay.replay import replay_scene
from hhsim.solver.method import EVERYTHING, outside_class
from hhsim.solver.options import SolverOptions
from hhsim.verify.verify import verify

RELEASED = short_grasp(release=0.05)


def test_what_cannot_be_known_has_no_row(tmp_path: Path) -> None:
    scene = short_scene(RELEASED)
    follow = replay_scene(scene, SolverOptions(method="outside_methods:Follow"), tmp_path / "follow.h5")
    names = {row.name for row in follow.rows}
    assert {"penetration_max", "contact_error_max", "tick_cpu_p50", "tracking_palm"} <= names
    assert not names & {"force_contact_mean", "stuck_ticks", "work_mean", "rows_max", "force_variation_tremor"}
    ours = replay_scene(scene, SolverOptions(method="outside_methods:OurOwn"), tmp_path / "ours.h5")
    more = {row.name for row in ours.rows} - names
    assert {"force_contact_mean", "force_variation_tremor"} <= more
    assert all(name.startswith(("force", "posture_jump")) for name in more)
    assert known_figures(EVERYTHING) == set(run_metrics())


def test_what_it_prints_and_where_it_goes_change_no_answer(run: Run, tmp_path: Path) -> None:
    more = ("--method", "outside_methods:Talks", "--ticks", "5", "--level", "2", "--out", "talks.h5", "--json")
    answer = run("replay", "sphere", "grasp", *more)
    assert answer.code == 0, answer.err
    assert json.loads(answer.out)["method"] == "outside_methods:Talks"
    assert answer.err.count("printed") == 6, "begin() and five ticks"
    assert (tmp_path / "talks.h5").is_file()


@pytest.mark.parametrize("name", ["Follow", pytest.param("OurOwn", marks=pytest.mark.soak)])
def test_the_referee_the_second_run_and_the_page_take_it(
    name: str, tmp_path: Path, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    leave_report_undrawn(monkeypatch)
    result = short_result(tmp_path / "result.h5", RELEASED, method=f"outside_methods:{name}")
    assert result.gives("times") and not result.gives("work") and result.gives("forces") == (name == "OurOwn")
    judged = verify(result, every=20, trust=True)
    assert judged.passed, [claim for claim in judged.claims if claim.failed]
    forces = next(claim for claim in judged.claims if claim.name == "forces")
    assert forces.verdict == "not judged"
    again = run("replay", str(tmp_path / "result.h5"), "--trust")
    assert again.code == 0 and "identical in every tick" in again.out
    page = run("report", str(tmp_path / "result.h5"), "--out", str(tmp_path / "page.html"))
    assert page.code == 0, page.err
    exported = run("export", str(tmp_path / "result.h5"), str(tmp_path / "ticks.csv"))
    assert exported.code == 0, exported.err


def test_a_second_run_says_where_the_methods_code_has_changed_since(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = "from outside_methods import Follow\n\n\nclass Edited(Follow):\n    SHIFT = 0.0\n\n"
    text += "    def answer(self, haptic):\n"
    text += "        return haptic._replace(position=haptic.position + self.SHIFT)\n"
    (tmp_path / "edited_method.py").write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    name = "edited_method:Edited"
    result = short_result(tmp_path / "result.h5", RELEASED, method=name)
    monkeypatch.setattr(outside_class(name), "SHIFT", 1e-3)
    same_file = run_again(result, trust=True)
    assert not same_file.identical and "file of its class alone" in same_file.notes[-1] and not same_file.made_elsewhere
    (tmp_path / "edited_method.py").write_text(text.replace("0.0", "1e-3"))
    changed = run_again(result, trust=True)
    assert changed.notes == (f"the code of method {name} has changed since",) and changed.made_elsewhere


def test_a_second_run_says_what_the_method_lacks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    name = "outside_methods:Follow"
    result = short_result(tmp_path / "result.h5", RELEASED, method=name)
    monkeypatch.setattr(outside_class(name), "missing", "needs a library: build it", raising=False)
    with pytest.raises(InputError, match=f"method {name} needs a library: build it"):
        run_again(result, trust=True)


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
