"""The seam of methods: what is registered, and that one new file is a method everywhere."""

import importlib
import math
import subprocess
import sys
import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from conftest import Run

import hhsim.solver.methods
from hhsim.errors import InputError
from hhsim.kernels.parallel.thread_team import PARTS
from hhsim.solver.method import METHODS, USUAL, methods_that, never_penetrates
from hhsim.solver.options import SolverOptions, Stiffness

FOLLOW = '''
"""`follow`: the graphic hand is the user's, wherever that is; what a method without contact comes to."""

import numpy as np

from hhsim.solver.method import Method


class FollowEngine:
    def __init__(self, workspace):
        self.workspace = workspace

    def begin(self):
        pass

    def run(self, haptic, record):
        for name in haptic._fields:
            getattr(record, name)[:] = getattr(haptic, name)
        record.joints[:] = [self.workspace.model.joints(*sample) for sample in zip(*haptic)]
        return len(haptic.position)


METHOD = Method(summary="the user's hand, through everything", engine=FollowEngine)
'''


@pytest.fixture
def follow(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """One more file in the package of methods."""
    folder = tmp_path / "methods"
    folder.mkdir()
    (folder / "follow.py").write_text(FOLLOW)
    monkeypatch.setattr(hhsim.solver.methods, "__path__", [*hhsim.solver.methods.__path__, str(folder)])
    importlib.invalidate_caches()
    for package, name in (("hhsim.cli.arguments", "options"), ("hhsim.cli", "replay")):  # they list the methods once
        monkeypatch.delitem(sys.modules, f"{package}.{name}", raising=False)
        monkeypatch.delattr(importlib.import_module(package), name, raising=False)
    yield
    for module in ("hhsim.cli.arguments.options", "hhsim.cli.replay", "hhsim.solver.methods.follow"):
        sys.modules.pop(module, None)


def test_what_each_method_promises() -> None:
    assert list(METHODS) == ["coupled", "progressive", "paper", "penalty"]
    assert methods_that("never_penetrates") == methods_that("takes_threads") == ("coupled", "progressive")
    assert methods_that("nearest_to_user") == ("coupled",)
    assert not never_penetrates("paper") and not never_penetrates("nobody's")
    for name, method in METHODS.items():
        assert method.summary and method.defaults.keys() == USUAL.keys()
        assert SolverOptions(method=name).margin == method.defaults["margin"]


OUTSIDE = "outside_methods:Follow"


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"method": "couple"}, "did you mean coupled"),
        ({"force": "kk"}, "kkt"),
        ({"surface": "triangles"}, "unknown surface 'triangles'"),
        ({"method": "paper", "frustum_ends": "flats"}, "flat"),
        ({"offset": 2e-4}, "ten offsets"),
        ({"method": "penalty", "period": 0.0}, "period is 0 s"),
        ({"method": "penalty", "response": math.inf}, "response is inf s"),
        ({"method": "penalty", "contact_response": -1.0}, "contact_response is -1 s: expected 0 to 1000"),
        ({"method": "penalty", "qp": "clarabel"}, "solves no quadratic program"),
        ({"method": "paper", "qp": "clarabel"}, "active-set"),
        ({"method": OUTSIDE, "qp": "clarabel"}, "takes no QP solver"),
        ({"method": OUTSIDE, "threads": 2}, "runs in one thread"),
        ({"threads": 2, "qp": "daqp"}, "'daqp' is driven in one thread"),
        *(({"threads": n}, f"threads is {n}: expected 1 to 6; a tick has 6 parts") for n in (0, -1, PARTS + 1)),
        (
            {"method": "paper", "surface": "mesh"},
            "method paper takes .* not mesh: .*between frustums and spheres",
        ),
        ({"method": "penalty", "surface": "mesh"}, "method penalty takes .* not mesh: .*triangles have no depth"),
    ],
    ids=str,
)
def test_options_that_make_no_sense_are_refused(options: dict[str, Any], says: str) -> None:
    with pytest.raises(InputError, match=says):
        SolverOptions(**options)


def test_a_contact_needs_a_positive_stiffness() -> None:
    with pytest.raises(InputError, match="stiffness penalty is 0"):
        Stiffness(penalty=0.0)


def test_a_method_is_added_by_one_file(follow: None, run: Run, tmp_path: Path) -> None:
    answer = run("replay", "cube", "touch", "--method", "follow", "--out", str(tmp_path / "follow.h5"))
    assert answer.code == 0, answer.err
    assert answer.out.startswith("cube, touch, follow")
    with h5py.File(tmp_path / "follow.h5") as file:
        for name in ("position", "orientation", "flexion", "abduction"):
            np.testing.assert_array_equal(file[f"tick/graphic/{name}"][()], file[f"tick/haptic/{name}"][()])
        assert file["tick/penetration_depth"][()].max() > 1e-3, "nothing kept the hand out of the cube"
        assert not file["tick/force/total"][()].any()
    assert "follow" in run("replay", "--help").out
    refused = run("replay", "cube", "touch", "--method", "folow")
    assert refused.code == 2 and "follow" in refused.err


def test_the_options_load_little() -> None:
    script = textwrap.dedent(
        """
        import sys
        from hhsim.solver.options import SolverOptions
        SolverOptions()
        print(*sorted(name for name in sys.modules if name.split(".")[0] == "hhsim"))
        print(*(name for name in ("numba", "h5py", "trimesh") if name in sys.modules))
        """
    )
    found = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout
    loaded, heavy = found.splitlines()
    assert len(loaded.split()) <= 20, loaded
    assert heavy == ""
