"""What hhsim says about the machine and itself."""

import importlib.metadata
import json
import platform
import re
import subprocess
from pathlib import Path

import pytest

from hhsim import __version__
from hhsim.kernels import kernel_cache
from hhsim.system import environment as info


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
