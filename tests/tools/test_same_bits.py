"""Scenes have the same bits with libraries of other processors, another C library, and on another kind of machine."""

import platform
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tools.foreign_python import EMULATOR
from tools.import_graph import REPOSITORY
from tools.same_bits import digest

EMULATED = ("coupled", "coupled, mesh", "progressive", "free", "live session run again")


def table(*arguments: str) -> str:
    """Run the tool; it must find no other bits. Its table is returned."""
    command = [sys.executable, "-m", "tools.same_bits", *arguments]
    done = subprocess.run(command, cwd=REPOSITORY, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def scenes(names: tuple[str, ...]) -> list[str]:
    return [word for name in names for word in ("--scene", name)]


@pytest.mark.soak
def test_libraries_of_other_processors() -> None:
    shown = table(*scenes(("coupled", "free", "live session run again")))
    assert shown.count(" same |") >= 3 * 6


@pytest.mark.soak
@pytest.mark.skipif(shutil.which("apt-get") is None, reason="needs packages of Debian")
def test_another_c_library(tmp_path: Path) -> None:
    made = [sys.executable, "-m", "tools.foreign_python", "libc", str(tmp_path / "libc")]
    if subprocess.run(made, cwd=REPOSITORY, capture_output=True).returncode:
        pytest.skip("no package of another C library is to be had")
    python = str(tmp_path / "libc" / "python")
    assert " same |" in table("--environment", "as it is", "--python", python, *scenes(("free", "coupled, mesh")))


@pytest.mark.soak
@pytest.mark.skipif(platform.machine() != "x86_64", reason="it is for x86-64 to compare with")
@pytest.mark.skipif(shutil.which(EMULATOR) is None, reason=f"needs {EMULATOR}, of Debian's qemu-user-static")
def test_an_emulated_aarch64(tmp_path: Path) -> None:
    made = [sys.executable, "-m", "tools.foreign_python", "aarch64", str(tmp_path / "aarch64")]
    if subprocess.run(made, cwd=REPOSITORY, capture_output=True).returncode:
        pytest.skip("no packages for aarch64 are to be had")
    python = str(tmp_path / "aarch64" / "python")
    shown = table("--environment", "as it is", "--python", python, *scenes(EMULATED))
    assert shown.count(" same |") == len(EMULATED)


def test_a_digest_tells_a_changed_bit_and_no_changed_time(tmp_path: Path) -> None:
    import h5py
    import numpy as np

    digests = []
    for pose, time in ((1.0, 5), (1.0, 6), (np.nextafter(1.0, 2.0), 5)):
        path = tmp_path / "run.h5"
        with h5py.File(path, "w") as file:
            file["hands/right/tick/graphic/position"], file["hands/right/tick/duration/total"] = [pose], [time]
        digests.append(digest(path))
    assert digests[0] == digests[1] != digests[2]
