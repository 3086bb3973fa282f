"""Kernels that a wheel brings are loaded, and compiled where a byte of them is not what was built."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from hhsim.kernels.jit import JIT_ENABLED
from hhsim.kernels.kernel_cache import SUMS
from hhsim.kernels.target import BUILT_FOR, TARGET
from tools.build_wheel import pack

pytestmark = pytest.mark.skipif(not JIT_ENABLED, reason="without the compiler nothing is compiled")

RUN = """
import sys
from pathlib import Path
from hhsim.kernels import kernel_cache
kernel_cache.FOLDER = Path(sys.argv[1])
import numpy as np
from numba.core import event
with event.install_recorder("numba:compile") as compiled:
    from hhsim.kernels.rotation import quaternion_to_matrix
    matrix = np.zeros((3, 3))
    quaternion_to_matrix(np.array([0.8, 0.6, 0.0, 0.0]), matrix)
print(len(compiled.buffer), round(matrix[2, 1], 12))
"""
COMPILED, LOADED = " 0.96", "0 0.96"


def run(shipped: Path, cache: Path) -> tuple[str, str]:
    """Turn a quaternion into a matrix; what it prints and its warnings."""
    cache.mkdir(mode=0o700, exist_ok=True)
    environment = {name: value for name, value in os.environ.items() if name != "HHSIM_CPU"}
    done = subprocess.run(
        [sys.executable, "-c", RUN, str(shipped)],
        env=environment | {"HHSIM_CACHE_DIR": str(cache)},
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.strip(), done.stderr


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The compiled kernels of a wheel that has one."""
    folder = tmp_path_factory.mktemp("wheel")
    out, _ = run(folder / "nothing", folder / "built")
    assert out != LOADED and out.endswith(COMPILED)
    (folder / "compiled").mkdir()
    pack(folder / "built", folder / "compiled", TARGET)
    return folder / "compiled"


@pytest.fixture
def wheel(built: Path, tmp_path: Path) -> Path:
    """A copy of them, to be damaged."""
    return Path(shutil.copytree(built, tmp_path / "compiled"))


def test_a_shipped_kernel_is_loaded_and_nothing_is_compiled_or_written(wheel: Path, tmp_path: Path) -> None:
    assert run(wheel, tmp_path / "empty") == (LOADED, "")
    assert not list((tmp_path / "empty").rglob("*.nbc"))


@pytest.mark.parametrize("fault", ["damaged", "missing", "unlisted"])
@pytest.mark.quick("damaged")
def test_a_file_that_is_not_what_was_built_is_named_and_not_run(wheel: Path, tmp_path: Path, fault: str) -> None:
    (path,) = wheel.rglob("*.nbc")
    if fault == "damaged":
        content = bytearray(path.read_bytes())
        content[len(content) // 2] ^= 1
        path.write_bytes(content)
    elif fault == "missing":
        path.unlink()
    else:
        sums = wheel / SUMS
        kept = [line for line in sums.read_text().splitlines(keepends=True) if not line.endswith(f"{path.name}\n")]
        sums.write_text("".join(kept))
    out, warned = run(wheel, tmp_path / "empty")
    assert out != LOADED and out.endswith(COMPILED)
    assert (path.name in warned) == (fault != "unlisted")


def test_kernels_for_another_numba_are_told_and_not_used(wheel: Path, tmp_path: Path) -> None:
    (wheel / BUILT_FOR).write_text("x86_64 0.1.0 x86-64-v3\n")
    out, warned = run(wheel, tmp_path / "empty")
    assert out != LOADED and out.endswith(COMPILED)
    assert "0.1.0" in warned
