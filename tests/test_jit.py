"""The jit factory: where compiled kernels go, what makes them stale, and that each is compiled once."""

import ast
import os
import shutil
import subprocess
import sys
import tempfile
import textwrap
from pathlib import Path

import pytest

import hhsim
from hhsim.kernels.jit import cache_root

PACKAGE = Path(hhsim.__file__).parent


def kernel_cache(root: Path, module: str = "block", **environment: str) -> str:
    """Folder that a copy of the package under `root` would keep the kernels of a module in."""
    script = f"import hhsim.kernels.jit as jit; print(jit.__file__); print(jit.module_cache({module!r}).name)"
    found = subprocess.run(
        [sys.executable, "-c", script],
        cwd=root,
        env={**os.environ, "PYTHONPATH": str(root), "HHSIM_CACHE_DIR": str(root / "cache"), **environment},
        capture_output=True,
        text=True,
        check=True,
    ).stdout.split()
    assert Path(found[0]).is_relative_to(root), "not the copy"
    return found[1]


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    shutil.copytree(PACKAGE, tmp_path / "hhsim", ignore=shutil.ignore_patterns("__pycache__"))
    return tmp_path


def test_an_edit_of_a_kernel_makes_all_that_call_it_stale(copy: Path) -> None:
    before = kernel_cache(copy)
    assert kernel_cache(copy) == before
    for name in ("distance.py", "tick.py"):
        source = copy / "hhsim" / "kernels" / name
        source.write_text(source.read_text().replace("[m]", "[metres]", 1))
        after = kernel_cache(copy)
        assert after != before
        before = after


def test_an_edit_of_a_kernel_keeps_those_that_do_not_call_it(copy: Path) -> None:
    before = {module: kernel_cache(copy, module) for module in ("distance", "contact", "cover", "tick")}
    source = copy / "hhsim" / "kernels" / "contact.py"
    source.write_text(source.read_text() + "\n# one more line\n")
    stale = {module for module, folder in before.items() if kernel_cache(copy, module) != folder}
    assert stale == {"contact", "tick"}


def test_kernels_import_each_other_in_the_one_way_that_the_digest_follows() -> None:
    for source in (PACKAGE / "kernels").glob("*.py"):
        for node in ast.walk(ast.parse(source.read_text())):
            if isinstance(node, ast.ImportFrom) and (node.level or (node.module or "").startswith("hhsim")):
                assert node.level == 1 and node.module and "." not in node.module, f"{source.name}:{node.lineno}"
                assert node.col_offset == 0, f"{source.name}:{node.lineno}"


def test_an_edit_elsewhere_keeps_the_compiled_kernels(copy: Path) -> None:
    before = kernel_cache(copy)
    source = copy / "hhsim" / "metrics.py"
    source.write_text(source.read_text() + "\n# one more line\n")
    assert kernel_cache(copy) == before


def test_checked_and_unchecked_kernels_are_kept_apart(copy: Path) -> None:
    assert kernel_cache(copy, NUMBA_BOUNDSCHECK="1") != kernel_cache(copy)
    assert kernel_cache(copy, NUMBA_CPU_NAME="generic") != kernel_cache(copy)


def test_the_named_cache_folder_wins(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("HHSIM_CACHE_DIR", str(tmp_path / "named" / "deep"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert cache_root() == tmp_path / "named" / "deep"
    assert cache_root().is_dir()
    monkeypatch.delenv("HHSIM_CACHE_DIR")
    assert cache_root() == tmp_path / "xdg" / "hhsim"
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert cache_root() == tmp_path / "home" / ".cache" / "hhsim"


def test_where_the_cache_folder_cannot_be_made_a_temporary_one_serves(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    in_the_way = tmp_path / "file"
    in_the_way.touch()
    monkeypatch.setenv("HHSIM_CACHE_DIR", str(in_the_way / "below"))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    assert cache_root() == tmp_path / f"hhsim-{os.getuid()}"
    assert cache_root().is_dir()
    assert cache_root().stat().st_mode & 0o077 == 0, "others may read or write it"


@pytest.mark.slow
def test_every_kernel_of_a_replay_is_compiled_for_one_signature(tmp_path: Path) -> None:
    # A second signature would cost seconds at the first run of each user, for nothing. In a cache of its own: a kernel
    # that comes from a cache does not tell what its callees were compiled for.
    script = textwrap.dedent(
        f"""
        import sys
        sys.path.insert(0, {str(Path(__file__).parent)!r})
        import importlib, pkgutil
        from sphere_scenes import bumpy_ball, random_targets, still
        import hhsim.kernels
        from hhsim.hand import HandModel
        from hhsim.metrics import penetration
        from hhsim.solver import HandSolver
        from hhsim.solver_options import METHODS, THREADED_METHODS, SolverOptions
        from hhsim.warm_up import warm_up

        hand = HandModel.default()
        tree = bumpy_ball(300)
        for method in METHODS:
            for force in ("kkt", "paper"):
                threads = 2 if method in THREADED_METHODS else 1
                options = SolverOptions(method=method, force=force, threads=threads)
                warm_up(hand, options)
                solver = HandSolver(hand, tree.arrays(), options)
                solver.place(*(values[0] for values in still(1, [0.0, 0.0, 0.2])))
                record = solver.run(*random_targets(hand, 200, 0))
                palm = hand.palm_tree
                penetration(tree.arrays(), hand.radius, palm.leaf_center, palm.leaf_radius,
                            record.joints, record.position, record.orientation)
        for module in pkgutil.iter_modules(hhsim.kernels.__path__, "hhsim.kernels."):
            loaded = importlib.import_module(module.name)
            for name, kernel in vars(loaded).items():
                if getattr(kernel, "__module__", "") == module.name and hasattr(kernel, "signatures"):
                    print(f"{{module.name.split('.')[-1]}}.{{name}}", len(kernel.signatures))
        """
    )
    environment = {**os.environ, "HHSIM_CACHE_DIR": str(tmp_path)}
    found = subprocess.run(
        [sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=True
    ).stdout
    signatures = {line.split()[0]: int(line.split()[1]) for line in found.splitlines()}
    assert signatures["block.run_block"] == signatures["helper.help_out"] == 1
    assert {name: count for name, count in signatures.items() if count > 1} == {}


def test_a_temporary_cache_that_others_can_write_is_not_used(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    in_the_way = tmp_path / "file"
    in_the_way.touch()
    monkeypatch.setenv("HHSIM_CACHE_DIR", str(in_the_way / "below"))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    usual = tmp_path / f"hhsim-{os.getuid()}"
    usual.mkdir()
    usual.chmod(0o777)
    found = cache_root()
    assert found != usual
    assert found.stat().st_mode & 0o077 == 0
    usual.chmod(0o700)
    assert cache_root() == usual


def test_other_packages_keep_their_own_numba_cache_folder() -> None:
    code = "import numba as n; old = n.config.CACHE_DIR; import hhsim.kernels.tick; print(n.config.CACHE_DIR == old)"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "True\n"
