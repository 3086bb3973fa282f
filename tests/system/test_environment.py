"""What hhsim asks of its environment, word of a compilation; and its histograms."""

import importlib.metadata
import json
import os
import platform
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hhsim import __version__
from hhsim.kernels import kernel_cache
from hhsim.system import environment as info
from hhsim.system.compile_notice import COMPILING
from hhsim.system.log_histogram import LogHistogram


def test_everything_is_stated_and_can_be_json() -> None:
    collected = info.collect()
    again = json.loads(json.dumps(collected))
    assert again["hhsim"] == __version__
    assert again["machine"]["cores"] >= 1
    assert again["machine"]["cpu"]
    assert again["kernels"]["folder"] == str(kernel_cache.KERNEL_CACHE)


def test_a_missing_optional_package_is_named_under_its_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    declared = ["numpy>=2", "no-such-viewer>=1; extra == 'view'", 'no-such-linter; extra == "lint"', "no-such-base<3"]
    monkeypatch.setattr(importlib.metadata, "requires", lambda name: declared)
    collected = info.collect()
    assert collected["missing"] == {"view": ["no-such-viewer"], "required": ["no-such-base"]}
    assert set(collected["packages"]) == {"numpy"}


def git(folder: Path, *arguments: str) -> str:
    identity = ["-c", "user.name=a", "-c", "user.email=a@b.c", "-c", "commit.gpgsign=false"]
    answer = subprocess.run(
        ["git", "-C", str(folder), *identity, *arguments], capture_output=True, text=True, check=True
    )
    return answer.stdout.strip()


def test_the_revision_is_that_of_the_checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    module = tmp_path / "hhsim" / "system" / "environment.py"
    module.parent.mkdir(parents=True)
    module.write_text("")
    (tmp_path / "pyproject.toml").write_text("")
    monkeypatch.setattr(info, "__file__", str(module))
    assert set(info.revision().values()) == {"unknown"}
    git(tmp_path, "init", "--quiet")
    git(tmp_path, "add", ".")
    assert set(info.revision().values()) == {"unknown"}
    git(tmp_path, "commit", "--quiet", "-m", "first")
    assert info.revision() == {"commit": git(tmp_path, "rev-parse", "HEAD"), "dirty": False}
    module.write_text("changed\n")
    assert info.revision()["dirty"] is True
    git(tmp_path, "commit", "--quiet", "--all", "-m", "second")
    git(tmp_path, "checkout", "--quiet", "--detach")
    (tmp_path / "notes").write_text("not of the repository\n")
    assert info.revision() == {"commit": git(tmp_path, "rev-parse", "HEAD"), "dirty": False}


def test_the_machine_is_described_but_not_named() -> None:
    text = json.dumps(info.collect()["machine"])
    assert not re.search(rf"\b{re.escape(platform.node())}\b", text) or platform.node() in ("", "localhost")


PROGRAM = """\
import logging, sys
import numpy as np
import numba
import hhsim

hhsim.HandSolver
logging.getLogger("hhsim").setLevel(sys.argv[1])
numba.njit(lambda: 1)()
from hhsim.kernels.rotation import quaternion_to_matrix, rotation_vector_between

one, other = np.array([1.0, 0.0, 0.0, 0.0]), np.empty(3)
quaternion_to_matrix(one, np.empty((3, 3)))
rotation_vector_between(one, one, other)
"""


@pytest.mark.soak
def test_a_program_is_told_once_that_kernels_are_compiled_and_can_silence_it(tmp_path: Path) -> None:
    def told(level: str, cache: str) -> str:
        environment = {**os.environ, "HHSIM_CACHE_DIR": str(tmp_path / cache)}
        command = [sys.executable, "-c", PROGRAM, level]
        return subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stderr

    assert told("WARNING", "a") == f"{COMPILING}\n"
    assert told("WARNING", "a") == ""  # it lies in the cache
    assert told("ERROR", "b") == ""


@given(st.integers(0, 2**32 - 1), st.integers(1, 4000), st.floats(0.0, 3.0))
@settings(max_examples=40)
def test_percentiles_are_those_of_numpy_to_a_thousandth(seed: int, count: int, spread: float) -> None:
    values = np.exp(np.random.default_rng(seed).normal(11.0, spread, count)).astype(np.int64) + 1
    histogram = LogHistogram()
    for block in np.array_split(values, 3):
        histogram.add(block)
    assert histogram.count == count
    assert histogram.largest == values.max()
    for percent in (1.0, 50.0, 99.0, 100.0):
        expected = np.percentile(values, percent, method="inverted_cdf")
        assert histogram.percentile(percent) == pytest.approx(expected, rel=1.001e-3)


def test_nothing_has_no_percentile_and_what_is_off_the_scale_is_kept_at_its_end() -> None:
    histogram = LogHistogram()
    histogram.add([])
    assert np.isnan(histogram.percentile(50.0)) and np.isnan(histogram.largest)
    histogram.add([0.0, 1e300])
    assert histogram.percentile(50.0) == pytest.approx(1.0, rel=1.001e-3)
    assert histogram.largest == 1e300
