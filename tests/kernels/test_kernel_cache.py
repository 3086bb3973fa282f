"""Where compiled kernels go, and what makes them stale."""

import importlib
import os
import shutil
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import pytest

import hhsim
from hhsim.kernels.kernel_cache import imported_kernels

PACKAGE = Path(hhsim.__file__).parent


def output(root: Path, script: str, *arguments: str, **environment: str) -> str:
    """What a script prints that imports the modules under `root`; it writes no bytecode, which would hide edits."""
    variables = {**os.environ, "PYTHONPATH": str(root), "HHSIM_CACHE_DIR": str(root / "cache"), **environment}
    command = [sys.executable, "-B", "-c", script, *arguments]
    return subprocess.run(command, cwd=root, env=variables, capture_output=True, text=True, check=True).stdout


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    shutil.copytree(PACKAGE, tmp_path / "hhsim", ignore=shutil.ignore_patterns("__pycache__"))
    return tmp_path


WATCHED = (
    *("round_cone", "contact.detection", "contact.contact_points", "cover.greedy_cover"),
    *("tick.block", "world.tick"),
)
EDITS = {
    "kernels/round_cone.py": {*WATCHED} - {"cover.greedy_cover"},
    "kernels/contact/detection.py": {"contact.detection", "contact.contact_points", "tick.block", "world.tick"},
    "kernels/tick/tick.py": {"tick.block", "world.tick"},
    # The tick imports neither the surface nor the method: both are declared for the types that it is given.
    "kernels/surfaces/spheres.py": {"contact.detection", "contact.contact_points", "tick.block", "world.tick"},
    "kernels/world/progressive.py": set(),
    "metrics/metrics.py": set(),
}
"""Which of the modules that are watched an edit of a file makes stale."""


def test_an_edit_makes_the_kernels_stale_that_call_it_and_no_others(copy: Path) -> None:
    # In one process, which forgets between two edits what it has read: as many processes would take seconds.
    script = (
        "import sys, hhsim.kernels.kernel_cache as cache; from pathlib import Path\n"
        "watched, edits = (argument.split(',') for argument in sys.argv[1:])\n"
        "print(cache.__file__)\n"
        "for name in ['', *edits]:\n"
        "    for path in [Path('hhsim', name)] * bool(name):\n"
        "        path.write_text(path.read_text() + '\\n# one more line\\n')\n"
        "    for known in (cache._text, cache.imported_kernels, cache.implementing_kernels, cache.module_digest):\n"
        "        known.cache_clear()\n"
        "    print(*(cache.module_cache(f'hhsim.kernels.{name}').name for name in watched))"
    )
    read_from, *folders = output(copy, script, ",".join(WATCHED), ",".join(EDITS)).splitlines()
    assert Path(read_from).is_relative_to(copy), "not the copy"
    for (name, stale), (before, after) in zip(EDITS.items(), pairwise(folders), strict=True):
        changed = zip(WATCHED, before.split(), after.split(), strict=True)
        assert {module for module, old, new in changed if old != new} == stale, name


@pytest.mark.parametrize("path", sorted((PACKAGE / "kernels").rglob("*.py")), ids=lambda path: path.stem)
def test_the_digest_follows_every_kernel_that_a_module_takes_a_function_from(path: Path) -> None:
    # By the functions that are there once the module is imported, not by how its imports are written.
    module = ".".join(["hhsim", *path.relative_to(PACKAGE).with_suffix("").parts]).removesuffix(".__init__")
    loaded = importlib.import_module(module)
    homes = {getattr(value, "__module__", None) for value in vars(loaded).values()}
    used = {home for home in homes if isinstance(home, str) and home.startswith("hhsim.kernels.")} - {module}
    assert used <= set(imported_kernels(module))


@pytest.mark.parametrize("fault", ["flipped", "flipped in the digest", "cut", "empty"])
def test_a_damaged_file_is_compiled_anew(tmp_path: Path, fault: str) -> None:
    script = (
        "import numpy as np; from hhsim.kernels.rotation import quaternion_to_matrix as kernel\n"
        "from hhsim.kernels.kernel_cache import compiled_kernels\n"
        "matrix = np.empty((3, 3)); kernel(np.array([1.0, 0.0, 0.0, 0.0]), matrix)\n"
        "print(compiled_kernels(), matrix.trace())"
    )
    kept = {"PYTHONPATH": str(PACKAGE.parent), "NUMBA_DISABLE_JIT": "0"}
    assert output(tmp_path, script, **kept) == "1 3.0\n"
    (path,) = tmp_path.rglob("*.nbc")
    whole = path.read_bytes()
    damaged = bytearray(whole)
    damaged[5 if "digest" in fault else len(whole) // 2] ^= 1
    path.write_bytes({"cut": whole[: len(whole) // 2], "empty": b""}.get(fault, bytes(damaged)))
    assert output(tmp_path, script, **kept) == "1 3.0\n"
    assert output(tmp_path, script, **kept) == "0 3.0\n"


@pytest.mark.soak
def test_checked_and_unchecked_kernels_are_kept_apart(tmp_path: Path) -> None:
    script = "import hhsim.kernels.kernel_cache as cache; print(cache.module_cache('hhsim.kernels.tick.block').name)"
    kinds: list[dict[str, str]] = [{}, {"NUMBA_BOUNDSCHECK": "1"}, {"HHSIM_CPU": "native"}]
    assert len({output(tmp_path, script, **kind) for kind in kinds}) == 3
