"""The layout: who may import whom, held as one matrix; that tests lie as the library does."""

import ast
import re
import sys
from collections.abc import Callable, Iterable
from pathlib import Path

import pytest

from tools.architecture import LAYERS, PAGE, imported_by, order, table
from tools.import_graph import (
    PACKAGES,
    REPOSITORY,
    Import,
    circles,
    imports_of,
    is_package,
    library,
    lines_of,
    matrix,
    modules,
    package_of,
    reached_from,
)

MOST_LINES = {"replay": 44_600, "build_tree": 15_200}
"""Lines that a command can import, of some 77,000, with room for a few more; who lowers that lowers these."""
ROOMS = tuple(
    f"hhsim.{name}"
    for name in ("bench", "engines", "gate", "live", "repair", "report", "submissions", "sweep", "verify")
)
"""Packages of other commands, which neither of these imports."""

HEAVY = {"click", "rich", "rerun", "trimesh", "qpsolvers", "clarabel", "matplotlib", "scipy", "jinja2"}
"""Packages that are imported where they are used: together they cost more than a second."""

KERNEL_IMPORTS = {"numpy", "numba", "llvmlite", "math", "typing", "collections", "functools", "sys", "time"}
KERNEL_IMPORTS |= {"platform"}
JIT_FACTORY = {"jit", "jit_allocating", "jit_inline", "jit_noinline", "generic", "cache"}
IMPLEMENTS = re.compile(r"\w+\.of\(\w+\)|lowered\([\w()]+\)")
"""How a kernel is declared for a type."""

LIBRARY = library()
COMMAND_LINE = {name: path for name, path in modules().items() if name not in LIBRARY}
COMPILATION = tuple(
    f"hhsim.kernels.{name}" for name in ("jit", "callee", "by_reference", "kernel_cache", "cache_folder", "target")
)
"""What makes kernels of functions, and is none."""
KERNELS = {name: path for name, path in LIBRARY.items() if name.startswith("hhsim.kernels") and name not in COMPILATION}
FRONT = LIBRARY["hhsim"]
"""It names what users import, of every package, and imports none of it until it is asked for."""


def found_imports(files: Iterable[Path], wrong: Callable[[Import], bool]) -> list[str]:
    """Imports of these files that are wrong."""
    return [
        f"{path.relative_to(REPOSITORY)}:{imported.line} imports {imported.name}"
        for path in files
        for imported in imports_of(path)
        if wrong(imported)
    ]


def test_the_packages_are_those_on_disk() -> None:
    assert sorted(PACKAGES) == sorted(name for name in LIBRARY if is_package(name))


def test_a_package_imports_only_from_those_before_it() -> None:
    upward = [
        line
        for (importer, imported), lines in matrix().items()
        if importer != "hhsim" and PACKAGES.index(imported) > PACKAGES.index(importer)
        for line in lines
    ]
    assert upward == []
    assert found_imports([FRONT], lambda imported: imported.at_import and "hhsim" in imported.name) == []


def test_the_table_of_the_page_is_current_and_no_package_imports_from_a_layer_above_it() -> None:
    assert table() in PAGE.read_text(encoding="utf-8"), "run python -m tools.architecture"
    assert sorted(name for _, names in LAYERS for name in names) == sorted(order())
    layer = {name: number for number, (_, names) in enumerate(LAYERS) for name in names}
    for name, imported in imported_by().items():
        assert all(layer[name] <= layer[other] for other in imported), name


def test_no_two_files_import_each_other() -> None:
    assert circles() == []


def test_an_import_by_name_is_seen_and_one_for_types_alone_does_not_run(tmp_path: Path) -> None:
    path = tmp_path / "one.py"
    path.write_text(
        "from importlib import import_module\nif TYPE_CHECKING:\n    import hhsim.mesh.mesh\n"
        "def later():\n    return import_module('hhsim.solver.qp').solve\n"
    )
    assert [(found.name, found.at_import, found.runs) for found in imports_of(path)] == [
        ("importlib", True, True),
        ("hhsim.mesh.mesh", False, False),
        ("hhsim.solver.qp", False, True),
    ]


def test_nothing_below_imports_the_command_line_or_the_tools() -> None:
    above = ("hhsim.cli", "tools")
    assert found_imports(LIBRARY.values(), lambda imported: imported.name.startswith(above)) == []


@pytest.mark.parametrize(("command", "most"), MOST_LINES.items())
def test_a_command_reaches_no_more_than_it_needs(command: str, most: int) -> None:
    reached = reached_from(command)
    assert lines_of(reached) <= most
    assert {name for name in reached if name.startswith(ROOMS)} == set()


def test_tests_lie_as_the_library_does() -> None:
    folders = {
        path.parent.relative_to(REPOSITORY / "tests").as_posix() for path in (REPOSITORY / "tests").rglob("test_*.py")
    }
    packages = {package.replace(".", "/").removeprefix("hhsim").strip("/") or "." for package in PACKAGES}
    packages |= {package_of(name).replace(".", "/").removeprefix("hhsim/") for name in COMMAND_LINE}
    assert folders - packages - {"tools"} == set()


def test_kernels_import_only_numpy_numba_and_kernels() -> None:
    def foreign(imported: Import) -> bool:
        return not imported.name.startswith("hhsim.kernels") and imported.name.split(".")[0] not in KERNEL_IMPORTS

    assert found_imports(KERNELS.values(), foreign) == []


def test_the_jit_factory_imports_only_numpy_numba_and_the_standard_library() -> None:
    known = {"numpy", "numba", "llvmlite", *COMPILATION, *sys.stdlib_module_names}

    def foreign(imported: Import) -> bool:
        return known.isdisjoint({imported.name, imported.name.split(".")[0]})

    assert found_imports([LIBRARY[name] for name in COMPILATION], foreign) == []


def test_every_kernel_is_made_by_the_jit_factory() -> None:
    compilers = {"jit", "njit", "vectorize", "guvectorize", "cfunc", "stencil", "generated_jit"}
    found = []
    for path in KERNELS.values():
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            where = f"{path.relative_to(REPOSITORY)}:{getattr(node, 'lineno', 0)}"
            if isinstance(node, ast.Raise | ast.Try):
                found.append(f"{where}: kernels return status codes")
            elif isinstance(node, ast.FunctionDef):
                decorators = {ast.unparse(decorator) for decorator in node.decorator_list}
                decorators = {name for name in decorators if not IMPLEMENTS.fullmatch(name)}
                if not decorators <= JIT_FACTORY | {"property"}:
                    found.append(f"{where}: {node.name} is not made by the factory")
            elif isinstance(node, ast.ImportFrom) and node.module == "numba":
                if not compilers.isdisjoint(alias.name for alias in node.names):
                    found.append(f"{where}: imports a compiler")
            elif isinstance(node, ast.Attribute) and node.attr in compilers and ast.unparse(node.value) == "numba":
                found.append(f"{where}: calls numba.{node.attr}")
    assert found == []


def test_the_library_imports_heavy_packages_where_it_uses_them() -> None:
    def heavy(imported: Import) -> bool:
        return imported.at_import and imported.name.split(".")[0] in HEAVY

    assert found_imports(LIBRARY.values(), heavy) == []


def test_the_command_line_imports_nothing_slow_until_a_command_runs() -> None:
    # The gloves and pose sources that there are: tests/live/test_gloves.py looks at what they import.
    live = {"hhsim.live.gloves"}
    names = "errors", "ranges", "recordings.formats", "result.safety", "solver.method", "table.table"
    light = {*(f"hhsim.{name}" for name in names), *live, "click", *sys.stdlib_module_names}
    light |= {f"hhsim.system.{name}" for name in ("counted", "plain_json", "progress")}

    def slow(imported: Import) -> bool:
        own = imported.name == "hhsim" or imported.name.startswith("hhsim.cli")
        return imported.at_import and not own and light.isdisjoint({imported.name, imported.name.split(".")[0]})

    assert found_imports(COMMAND_LINE.values(), slow) == []
