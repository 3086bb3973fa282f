"""Scenes have the same bits with libraries of other processors."""

import subprocess
import sys
from pathlib import Path

import pytest

from tools.import_graph import REPOSITORY
from tools.same_bits import digest


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
