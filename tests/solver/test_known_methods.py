"""Which methods can be named, and what is said of names that are none."""

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from conftest import Run

from hhsim.errors import InputError, UnknownNameError
from hhsim.solver.known_methods import find_method
from hhsim.solver.method import EVERYTHING, METHODS
from hhsim.solver.method_names import declared_methods, method_names
from hhsim.solver.options import SolverOptions


@pytest.fixture
def declared(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """An installed package that declares two methods, one of which takes a name of ours, and one that is broken."""
    info = tmp_path / "site" / "others-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: others\nVersion: 1.0\n")
    lines = ("theirs = outside_methods:Follow", "coupled = outside_methods:Follow", "broken = not_there:Follow")
    (info / "entry_points.txt").write_text("\n".join(["[hhsim.methods]", *lines]))
    monkeypatch.syspath_prepend(str(info.parent))
    declared_methods.cache_clear()
    yield
    declared_methods.cache_clear()


def test_ours_come_first_and_keep_their_names(declared: None) -> None:
    names = method_names()
    assert names[:4] == list(METHODS) and {"theirs", "broken"} <= set(names)
    assert names.count("coupled") == 1
    assert find_method("coupled") is METHODS["coupled"]


def test_what_a_package_declares_can_be_named(declared: None, run: Run) -> None:
    method = find_method("theirs")
    assert method.summary == "The user's hand, through everything"
    assert SolverOptions(method="theirs").margin == SolverOptions().margin
    shown = run("methods").out
    assert "theirs" in shown and "others" in shown
    assert "method 'broken' cannot be imported" in shown
    with pytest.raises(UnknownNameError, match="did you mean theirs"):
        find_method("their")


def test_a_class_of_any_module_can_be_named() -> None:
    method = find_method("outside_methods:OurOwn")
    assert method.never_penetrates and not method.compiled and not method.takes_threads
    assert method.gives == {"forces", "times", "runs"} < EVERYTHING
    assert find_method("outside_methods:Follow").gives == {"times", "runs"}


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("nowhere:Method", "No module named 'nowhere'"),
        ("outside_methods:Nothing", "AttributeError"),
        ("outside_methods:NoTick", "lacks tick"),
        ("outside_methods:INSTANCE", "is an instance"),
        ("outside_methods:itertools", "lacks begin and tick"),
        (":", "cannot be imported"),
    ],
)
def test_what_is_no_method_is_told_in_one_line(name: str, message: str, run: Run) -> None:
    with pytest.raises(InputError, match=message):
        find_method(name)
    answer = run("replay", "cube", "touch", "--method", name)
    assert answer.code == 2 and message in answer.err and answer.err.count("\n") == 1


def test_a_file_beside_the_data_is_found_and_takes_nobodys_place(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "beside_the_data.py").write_text("from outside_methods import Follow\n")
    (tmp_path / "numpy.py").write_text("raise SystemError\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    assert find_method("beside_the_data:Follow").summary
    assert sys.path.index(str(tmp_path)) == len(sys.path) - 1


def test_a_glove_waits_for_nobody_elses_method(run: Run) -> None:
    refused = run("live", "glove", "--method", "outside_methods:Follow")
    assert refused.code == 2 and "'outside_methods:Follow' is not one of 'coupled', " in refused.err
