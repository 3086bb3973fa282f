"""The seam of methods: what is registered and can be named, and that one more entry is a method everywhere."""

import importlib
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import h5py
import numpy as np
import pytest
from conftest import Run

from hhsim.errors import InputError, UnknownNameError
from hhsim.kernels.tick.block import HapticBlock, TickRecord
from hhsim.solver.method import (
    EVERYTHING,
    METHODS,
    OWN,
    USUAL,
    Method,
    find_method,
    method_names,
    methods_that,
    never_penetrates,
)
from hhsim.solver.options import SolverOptions
from hhsim.solver.workspace import TickWorkspace


class FollowEngine:
    """The graphic hand is the user's, wherever that is: what a method without contact comes to."""

    def __init__(self, workspace: TickWorkspace) -> None:
        self.workspace = workspace

    def begin(self) -> None: ...

    def run(self, haptic: HapticBlock, record: TickRecord) -> int:
        for name in haptic._fields:
            getattr(record, name)[:] = getattr(haptic, name)
        record.joints[:] = [self.workspace.model.joints(*sample) for sample in zip(*haptic)]
        return len(haptic.position)


@pytest.fixture
def follow(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """One more of our own methods."""
    monkeypatch.setitem(OWN, "follow", Method(summary="the user's hand, through everything", engine=FollowEngine))
    for package, name in (
        ("hhsim.cli.arguments", "scene_options"),
        ("hhsim.cli", "replay"),
    ):  # they list the methods once
        monkeypatch.delitem(sys.modules, f"{package}.{name}", raising=False)
        monkeypatch.delattr(importlib.import_module(package), name, raising=False)
    yield
    for module in ("hhsim.cli.arguments.scene_options", "hhsim.cli.replay"):
        sys.modules.pop(module, None)


def test_what_each_method_promises() -> None:
    assert list(METHODS) == ["coupled", "progressive", "paper", "penalty"]
    assert methods_that("never_penetrates") == ("coupled", "progressive")
    assert methods_that("takes_threads") == ("progressive",)
    assert methods_that("nearest_to_user") == ("coupled",)
    assert not never_penetrates("paper") and not never_penetrates("nobody's")
    for name, method in METHODS.items():
        assert method.summary and method.defaults.keys() == USUAL.keys()
        assert SolverOptions(method=name).margin == method.defaults["margin"]


def test_a_method_is_added_by_one_entry(follow: None, run: Run, tmp_path: Path) -> None:
    answer = run("replay", "cube", "touch", "--method", "follow", "--out", str(tmp_path / "follow.h5"))
    assert answer.code == 0, answer.err
    assert answer.out.startswith("cube, touch, follow")
    with h5py.File(tmp_path / "follow.h5") as file:
        for name in ("position", "orientation", "flexion", "abduction"):
            np.testing.assert_array_equal(
                file[f"hands/right/tick/graphic/{name}"][()], file[f"hands/right/tick/haptic/{name}"][()]
            )
        assert file["hands/right/tick/penetration_depth"][()].max() > 1e-3, "nothing kept the hand out of the cube"
        assert not file["hands/right/tick/force/total"][()].any()
    assert "follow" in run("replay", "--help").out
    refused = run("replay", "cube", "touch", "--method", "folow")
    assert refused.code == 2 and "follow" in refused.err


@pytest.fixture
def declared(installed: Callable[..., None]) -> None:
    """An installed package that declares two methods, one of which takes a name of ours, and one that is broken."""
    lines = ("theirs = outside_methods:Follow", "coupled = outside_methods:Follow", "broken = not_there:Follow")
    installed("hhsim.methods", *lines)


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
