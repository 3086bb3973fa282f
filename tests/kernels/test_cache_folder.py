"""Where the cache lies: nowhere that others can write, and never without a word about it."""

import grp
import os
import pwd
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from hhsim.kernels.cache_folder import CacheFolderWarning, cache_root


@pytest.fixture
def usual(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """The folder where nothing is named, in a home of the test's own."""
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setenv("HHSIM_CACHE_DIR", "")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path / "home" / ".cache" / "hhsim"


def test_the_named_folder_wins(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, usual: Path) -> None:
    monkeypatch.setenv("HHSIM_CACHE_DIR", str(tmp_path / "named" / "deep"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert cache_root() == tmp_path / "named" / "deep"
    assert cache_root().is_dir()
    monkeypatch.delenv("HHSIM_CACHE_DIR")
    assert cache_root() == tmp_path / "xdg" / "hhsim"
    monkeypatch.delenv("XDG_CACHE_HOME")
    assert cache_root() == usual
    assert usual.stat().st_mode & 0o077 == 0, "others may read or write it"


@pytest.mark.parametrize("named", ["/dev/null", "file/below"])
def test_one_that_cannot_be_made_is_told_once_and_the_usual_one_serves(
    named: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, usual: Path
) -> None:
    (tmp_path / "file").touch()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HHSIM_CACHE_DIR", named)
    with pytest.warns(CacheFolderWarning, match=f"^the cache folder {named} is not used: .*; used instead: {usual}$"):
        assert cache_root() == usual
    # Neither here nor in a child is it told again.
    code = "from hhsim.kernels.cache_folder import cache_root; print(cache_root())"
    found = subprocess.run([sys.executable, "-W", "error", "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout == f"{cache_root()}\n"


def test_one_that_others_can_write_is_not_used(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, usual: Path) -> None:
    named = tmp_path / "named"
    (named / "kernels").mkdir(parents=True)
    for folder, mode in ((named, 0o777), (named, 0o1777), (named / "kernels", 0o757)):
        monkeypatch.setenv("HHSIM_CACHE_DIR", str(named))
        before = folder.stat().st_mode
        folder.chmod(mode)
        with pytest.warns(CacheFolderWarning, match=f"others can write {folder} .*machine code"):
            assert cache_root() == usual
        folder.chmod(before)
    monkeypatch.setenv("HHSIM_CACHE_DIR", str(named))
    assert cache_root() == named


def test_a_group_of_the_owner_alone_may_write(monkeypatch: pytest.MonkeyPatch, usual: Path) -> None:
    """As it is where each user has a group; a larger group is others."""
    usual.mkdir(parents=True)
    usual.chmod(0o775)
    owner, members = pwd.getpwuid(os.getuid()).pw_name, ["somebody"]
    group = grp.struct_group((owner, "x", os.getgid(), members))
    monkeypatch.setattr(grp, "getgrgid", lambda _: group)
    with pytest.warns(CacheFolderWarning, match="others can write"):
        assert cache_root() != usual
    monkeypatch.setenv("HHSIM_CACHE_DIR", "")
    members.clear()
    assert cache_root() == usual
