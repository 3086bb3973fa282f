"""Where compiled kernels go, and what makes them stale."""

import importlib
import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import pytest
from sampled import sampled

import hhsim
from hhsim.kernels.kernel_cache import imported_kernels
from hhsim.kernels.kernel_files import KernelFiles

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
    *("round_cone_distance", "contact.detection", "contact.penetration", "cover.greedy_cover"),
    *("tick.block", "tick.tick"),
)
EDITS = {
    "kernels/round_cone_distance.py": {*WATCHED} - {"cover.greedy_cover"},
    "kernels/contact/detection.py": {"contact.detection", "contact.penetration", "tick.block", "tick.tick"},
    "kernels/tick/tick.py": {"tick.block", "tick.tick"},
    # The tick imports neither the surface nor the method: both are declared for the types that it is given.
    "kernels/surfaces/spheres.py": {"contact.detection", "contact.penetration", "tick.block", "tick.tick"},
    "kernels/tick/progressive.py": {"tick.block", "tick.tick"},
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


FORMS = (
    "from hhsim.kernels.far.callee import callee",
    "from ..far.callee import callee",
    "from hhsim.kernels.far import callee as module\ncallee = module.callee",
    "import hhsim.kernels.far.callee as module\ncallee = module.callee",
    "from .. import far\nfrom ..far import callee as module\ncallee = module.callee",
)
"""How a kernel may come by its callee; the last one every time, all of them in the soak."""


def planted(root: Path, answer: int, forms: Sequence[str], cache: Path | None = None) -> list[str]:
    """What callers whose callee lies two packages away answer, and how many were loaded, in a process of its own."""
    files = {"far/callee.py": f"from hhsim.kernels.jit import jit\n\n\n@jit\ndef callee():\n    return {answer}\n"}
    for i, imported in enumerate(forms):
        files[f"middle/between_{i}.py"] = (
            f"from hhsim.kernels.jit import jit\n{imported}\n\n\n@jit\ndef between():\n    return callee() + 1\n"
        )
        files[f"near/caller_{i}.py"] = (
            "from hhsim.kernels import middle\nfrom hhsim.kernels.jit import jit\n"
            f"from hhsim.kernels.middle import between_{i} as other\n\nbetween = other.between\n\n\n"
            "@jit\ndef caller():\n    return between() + 1\n"
        )
    for name, text in files.items():
        path = root / "hhsim" / "kernels" / name
        path.parent.mkdir(exist_ok=True)
        (path.parent / "__init__.py").write_text(f'"""The {path.parent.name} ones."""\n')
        path.write_text(text)
    script = (
        "import importlib\n"
        f"for i in range({len(forms)}):\n"
        "    caller = importlib.import_module(f'hhsim.kernels.near.caller_{i}').caller\n"
        "    print(caller(), sum(caller.stats.cache_hits.values()))"
    )
    return output(root, script, HHSIM_CACHE_DIR=str(cache or root / "cache")).splitlines()


@pytest.mark.parametrize(("forms",), sampled([(FORMS[-1:],), (FORMS,)], lambda place, _: place == 0), ids=len)
def test_an_edit_of_a_callee_two_packages_away_compiles_the_caller_anew(
    copy: Path, tmp_path: Path, forms: Sequence[str]
) -> None:
    assert planted(copy, 40, forms) == ["42 0"] * len(forms)
    # Another checkout of the same sources runs what is compiled.
    other = tmp_path / "elsewhere"
    shutil.copytree(PACKAGE, other / "hhsim", ignore=shutil.ignore_patterns("__pycache__"))
    assert planted(other, 40, forms, cache=copy / "cache") == ["42 1"] * len(forms), "not taken from the cache"
    assert planted(copy, 50, forms) == ["52 0"] * len(forms), "the callee of before"


@pytest.mark.parametrize("path", sorted((PACKAGE / "kernels").rglob("*.py")), ids=lambda path: path.stem)
def test_the_digest_follows_every_kernel_that_a_module_takes_a_function_from(path: Path) -> None:
    # By the functions that are there once the module is imported, not by how its imports are written.
    module = ".".join(["hhsim", *path.relative_to(PACKAGE).with_suffix("").parts]).removesuffix(".__init__")
    loaded = importlib.import_module(module)
    homes = {getattr(value, "__module__", None) for value in vars(loaded).values()}
    used = {home for home in homes if isinstance(home, str) and home.startswith("hhsim.kernels.")} - {module}
    assert used <= set(imported_kernels(module))


@pytest.mark.soak
def test_what_is_compiled_for_a_foreign_type_lies_apart(tmp_path: Path) -> None:
    script = (
        "import numpy as np, surface; from hhsim.kernels.contact.surface import cone_distance\n"
        "from hhsim.kernels.contact.penetration import clearances\n"
        "from hhsim.kernels.hand.hand_shape import HandShape, StoredHands\n"
        "shape = HandShape(np.zeros((5, 4)), np.zeros((1, 3)), np.zeros(1))\n"
        "placed = (np.zeros((1, 5, 4, 3)), np.zeros((1, 3)), np.eye(3)[None])\n"
        "palm, finger = np.empty(1), np.empty((1, 5))\n"
        "clearances(surface.Level(0.5), StoredHands(shape, *placed), 9.0, palm, finger)\n"
        "print(palm[0], sum(clearances.stats.cache_hits.values()))"
    )
    source = (
        "from typing import NamedTuple\nfrom hhsim.kernels.jit import jit\n"
        "from hhsim.kernels.contact.surface import cone_distance\n"
        "class Level(NamedTuple):\n    height: float\n"
        "@cone_distance.of(Level)\n@jit\ndef away(level, cone, limit, stack):\n    return min(limit, {} + cone.z)\n"
    )

    def found(offset: float) -> str:
        (tmp_path / "surface.py").write_text(source.format(offset))
        return output(tmp_path, script)

    assert found(1.0) == "1.0 0\n"
    assert found(1.0) == "1.0 1\n", "not taken from the cache"
    assert found(2.0) == "2.0 0\n", "the surface of before"


def test_a_file_that_names_a_type_of_before_is_as_if_missing(tmp_path: Path) -> None:
    # A kernel that calls nothing keeps its folder while the types that others pass to it come and go.
    script = (
        "import hhsim.kernels.rotation as module; from typing import NamedTuple\n"
        "from hhsim.kernels.copy import copy_values as copied\n"
        "from hhsim.kernels.kernel_cache import KernelCache\n"
        "from numba import typeof\n"
        "class {0}(NamedTuple):\n    value: float\n"
        "{0}.__module__ = module.__name__; module.{0} = {0}\n"
        "cache, kind = KernelCache(copied.py_func), (typeof({0}(1.0)),)\n"
        "cache._impl.locator.ensure_cache_path()\n"
        "print(cache._cache_file.load(kind)); cache._cache_file.save(kind, 7); print(cache._cache_file.load(kind))"
    )
    assert output(tmp_path, script.format("Former")) == "None\n7\n"
    assert output(tmp_path, script.format("Former")) == "7\n7\n"
    assert output(tmp_path, script.format("Later")) == "None\n7\n"


def test_two_that_compile_at_once_never_share_a_file(tmp_path: Path) -> None:
    one, other = (KernelFiles(str(tmp_path), "kernel") for _ in range(2))
    assert one.load("first") is None
    one.save("first", 1)
    other.save("second", 2)
    one.save("first", 3)
    assert (other.load("first"), one.load("second")) == (3, 2)
    assert len(list(tmp_path.glob("*.nbc"))) == 2


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
