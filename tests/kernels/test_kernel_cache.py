"""Compiled kernels: what may make arrays, the processor, files that are loaded, stale or damaged, and their folder."""

import grp
import importlib
import math
import os
import pwd
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from llvmlite import binding
from numba.core.errors import NumbaError
from own_command import HHSIM

import hhsim
from hhsim.kernels import target
from hhsim.kernels.by_reference import by_reference
from hhsim.kernels.cache_folder import CacheFolderWarning, cache_root
from hhsim.kernels.jit import Array, jit, jit_allocating, jit_inline, jit_noinline
from hhsim.kernels.kernel_cache import SHIPPED, imported_kernels
from hhsim.kernels.target import CHOICE, NATIVE, TargetWarning, chosen_target, named_target
from tools.build_wheel import pack

pytestmark = pytest.mark.slow
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
        "    for known in ('kernel_sources', 'imported_kernels', 'implementing_kernels', 'module_digest'):\n"
        "        getattr(cache, known).cache_clear()\n"
        "    print(*(cache.module_folder(f'hhsim.kernels.{name}') for name in watched))"
    )
    read_from, *folders = output(copy, script, ",".join(WATCHED), ",".join(EDITS)).splitlines()
    assert Path(read_from).is_relative_to(copy), "not the copy"
    for (name, stale), (before, after) in zip(EDITS.items(), pairwise(folders), strict=True):
        changed = zip(WATCHED, before.split(), after.split(), strict=True)
        assert {module for module, old, new in changed if old != new} == stale, name


def test_the_digest_follows_every_kernel_that_a_module_takes_a_function_from() -> None:
    # By the functions that are there once the module is imported, not by how its imports are written.
    for path in (PACKAGE / "kernels").rglob("*.py"):
        module = ".".join(["hhsim", *path.relative_to(PACKAGE).with_suffix("").parts]).removesuffix(".__init__")
        loaded = importlib.import_module(module)
        homes = {getattr(value, "__module__", None) for value in vars(loaded).values()}
        used = {home for home in homes if isinstance(home, str) and home.startswith("hhsim.kernels.")} - {module}
        assert used <= imported_kernels(module), module


TURN = """
import sys, time
from pathlib import Path
import numpy as np
from hhsim.kernels import kernel_cache
from hhsim.kernels.rotation import quaternion_to_matrix
kernel_cache.SHIPPED = Path(sys.argv[1])
while not kernel_cache.SHIPPED.parent.exists():
    time.sleep(0.001)
matrix = np.empty((3, 3))
quaternion_to_matrix(np.array([1.0, 0.0, 0.0, 0.0]), matrix)
print(kernel_cache.compiled_kernels(), matrix.trace())
"""
COMPILED, LOADED = "1 3.0\n", "0 3.0\n"


def turn(folder: Path, shipped: Path = SHIPPED) -> tuple[str, str]:
    """How many kernels a process compiles to turn a quaternion into a matrix, and its warnings."""
    command = [sys.executable, "-c", TURN, str(shipped)]
    environment = {**os.environ, "HHSIM_CACHE_DIR": str(folder / "cache")}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    return done.stdout, done.stderr


@pytest.fixture(scope="module")
def compiled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("compiled")
    assert turn(folder) == (COMPILED, "")
    return folder


@pytest.mark.parametrize("ships", [False, True], ids=["kept", "shipped"])
@pytest.mark.parametrize("fault", ["none", "flipped", "flipped in the digest", "cut", "empty"])
@pytest.mark.quick("flipped-kept")
def test_a_file_is_loaded_and_a_damaged_one_is_named_and_compiled_anew(
    compiled: Path, tmp_path: Path, fault: str, ships: bool
) -> None:
    shipped = tmp_path / "wheel" / "compiled"
    if ships:
        pack(compiled / "cache", shipped)
    else:
        shutil.copytree(compiled / "cache", tmp_path / "cache")
        shipped.parent.mkdir()
    (path,) = tmp_path.rglob("*.nbc")
    whole = path.read_bytes()
    flipped = bytearray(whole)
    flipped[5 if "digest" in fault else len(whole) // 2] ^= 1
    path.write_bytes({"none": whole, "cut": whole[: len(whole) // 2], "empty": b""}.get(fault, bytes(flipped)))
    out, warned = turn(tmp_path, shipped)
    assert out == (LOADED if fault == "none" else COMPILED)
    assert (path.name in warned) == (fault != "none")
    if fault != "none":
        assert turn(tmp_path, shipped)[0] == LOADED
    assert len([*tmp_path.rglob("*.nbc")]) == 1 + (ships and fault != "none")


def test_of_processes_that_need_a_kernel_at_once_one_compiles_it(tmp_path: Path) -> None:
    environment = {**os.environ, "HHSIM_CACHE_DIR": str(tmp_path / "cache")}
    command = [sys.executable, "-c", TURN, str(tmp_path / "go" / "compiled")]
    processes = [subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) for _ in range(2)]
    # Each of them has its imports done, or compiles nothing as another has compiled it.
    time.sleep(1.0)
    (tmp_path / "go").mkdir()
    assert sorted(process.communicate()[0] for process in processes) == [LOADED, COMPILED]


def test_python_calls_what_another_process_has_compiled_for_a_caller(tmp_path: Path) -> None:
    calls = "arc_tangents(np.ones(1), np.ones(1), np.empty(1))", "print(arc_tangent(1.0, 1.0))"
    script = "import numpy as np; from hhsim.kernels.arithmetic import arc_tangent, arc_tangents; "
    found = [output(tmp_path, script + call, PYTHONPATH=str(PACKAGE.parent)) for call in calls]
    assert found == ["", f"{math.pi / 4.0}\n"]


@pytest.mark.soak
def test_checked_and_unchecked_kernels_are_kept_apart(tmp_path: Path) -> None:
    script = "import hhsim.kernels.kernel_cache as cache; print(cache.module_folder('hhsim.kernels.tick.block'))"
    kinds: list[dict[str, str]] = [{}, {"NUMBA_BOUNDSCHECK": "1"}, {"HHSIM_CPU": "native"}]
    assert len({output(tmp_path, script, **kind) for kind in kinds}) == 3


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


@pytest.mark.parametrize("decorator", [jit, jit_inline, jit_noinline, jit_allocating])
def test_a_kernel_that_does_not_say_so_can_make_no_array(decorator: Callable[..., Any]) -> None:
    @decorator
    def made(count: int) -> Any:
        return np.zeros(count)

    if decorator is jit_allocating:
        assert made(3).tolist() == [0.0, 0.0, 0.0]
        return
    with pytest.raises(NumbaError):
        made(3)


@pytest.mark.slow
@pytest.mark.soak
@pytest.mark.parametrize("options", ["--method coupled", "--method progressive --force paper", "--method paper"])
def test_ticks_with_checked_bounds_are_the_same_to_rounding(tmp_path: Path, options: str) -> None:
    def replay(arguments: str, **environment: str) -> str:
        command = [*HHSIM, "replay", *arguments.split()]
        given = {**os.environ, **environment}
        return subprocess.run(command, env=given, capture_output=True, text=True, check=True).stdout

    result = tmp_path / "checked.h5"
    checks = {"NUMBA_BOUNDSCHECK": "1", "NUMBA_OPT": "0", "HHSIM_CACHE_DIR": str(tmp_path / "cache")}
    assert "3,000 ticks" in replay(f"cube pinch {options} --out {result}", **checks)
    replay(str(result))


@by_reference
class Part(NamedTuple):
    """A record with an array."""

    values: Array


@by_reference
class Whole(NamedTuple):
    """A record that holds another one, and a tuple of some."""

    first: Part
    parts: tuple[Part, ...]


def total(whole: Whole, which: int) -> float:
    """Sum of two values, of which one is chosen when it runs."""
    return whole.first.values[0] + whole.parts[which].values[0]


def allocated(whole: Whole, which: int) -> Array:
    """The same in an array of its own."""
    return np.full(1, whole.first.values[0] + whole.parts[which].values[0])


@pytest.mark.parametrize("kernel", [jit(total), jit_allocating(allocated)], ids=["plain", "allocating"])
def test_a_call_keeps_no_hold_of_what_it_was_given(kernel: Any) -> None:
    arrays = [np.arange(2.0) + k for k in range(3)]
    whole = Whole(Part(arrays[0]), (Part(arrays[1]), Part(arrays[2])))
    before = [sys.getrefcount(array) for array in arrays]
    for which in (0, 1):
        assert float(np.sum(kernel(whole, which))) == 1.0 + which
    assert [sys.getrefcount(array) for array in arrays] == before


V3 = "x86-64-v3"


@pytest.fixture(autouse=True)
def unset(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("platform.machine", lambda: "x86_64")
    monkeypatch.setattr(binding, "get_host_cpu_features", lambda: dict.fromkeys(target.NEEDED[V3], True))


def test_the_named_target_is_taken_where_the_processor_can_run_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(CHOICE, raising=False)
    assert chosen_target() == named_target() == V3
    monkeypatch.setenv(CHOICE, "x86-64-v9")
    with pytest.warns(TargetWarning, match="x86-64-v9.*expected nothing or native"):
        assert chosen_target() == V3


def test_the_environment_decides_before_all(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(CHOICE, NATIVE)
    assert chosen_target() == NATIVE


def test_an_older_processor_compiles_for_what_it_has(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(CHOICE, raising=False)
    monkeypatch.setattr(binding, "get_host_cpu_features", lambda: {"avx2": True, "fma": False})
    assert chosen_target() == NATIVE
    assert named_target() is None
