"""Who imports whom in hhsim, read from the sources: what the layout's tests hold, and ARCHITECTURE.md draws."""

import ast
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[1]

PACKAGES = (
    "hhsim",
    *(
        f"hhsim.kernels{part}"
        for part in ("", ".hand", ".parallel", ".mesh", ".cover", ".contact", ".surfaces", ".qp", ".tick")
    ),
    *("hhsim.kernels.world", "hhsim.kernels.parts", "hhsim.kernels.live"),
    *("hhsim.system", "hhsim.table", "hhsim.mesh", "hhsim.trees", "hhsim.hand"),
    *("hhsim.linkage", "hhsim.robots", "hhsim.motion"),
    "hhsim.result",
    *(
        "hhsim.recordings",
        "hhsim.recordings.formats",
        "hhsim.metrics",
        "hhsim.metrics.run",
        "hhsim.metrics.field",
        "hhsim.scene",
    ),
    *("hhsim.solver", "hhsim.replay", "hhsim.submissions", "hhsim.verify"),
    *("hhsim.render", "hhsim.view"),
    *(f"hhsim.live{part}" for part in ("", ".drivers", ".session")),
    "hhsim.report",
    "hhsim.repair",
    "hhsim.sweep",
    "hhsim.gate",
    *("hhsim.bench", "hhsim.bench.paper", "hhsim.bench.robustness", "hhsim.bench.suites"),
    "hhsim.engines",
)
"""Every package of the library, lowest first: a module imports from its own package and from those before it."""


@dataclass(frozen=True)
class Import:
    """One imported module by its absolute name.

    Attributes:
        name: Of the module, or of the package where no module of it is named.
        line: Of the statement.
        at_import: False where the statement waits for a function to be called, or serves types alone.
        runs: False where it serves types alone.
        inside: What is imported from a module, as `module.name`.
    """

    name: str
    line: int
    at_import: bool
    runs: bool
    inside: str


@cache
def modules() -> dict[str, Path]:
    """Every module of the library and of the command line by its dotted name; packages by theirs."""
    found = {}
    for folder, prefix in (("hhsim", ()), ("cli", ("hhsim",))):
        for path in sorted((REPOSITORY / folder).rglob("*.py")):
            parts = (*prefix, *path.relative_to(REPOSITORY).with_suffix("").parts)
            found[".".join(parts).removesuffix(".__init__")] = path
    return found


@cache
def library() -> dict[str, Path]:
    """`modules` without the command line."""
    return {name: path for name, path in modules().items() if not name.startswith("hhsim.cli")}


def is_package(module: str) -> bool:
    """Whether a module is a package's own file."""
    return modules()[module].name == "__init__.py"


def package_of(module: str) -> str:
    """Package that a module lies in; a package's own file lies in itself."""
    return module if is_package(module) else module.rpartition(".")[0]


@cache
def imports_of(path: Path) -> tuple[Import, ...]:
    """Every import of one file of hhsim/ or cli/, wherever in the file."""
    return tuple(_imports_of(path))


def _imports_of(path: Path) -> Iterator[Import]:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    own = next((name for name, file in modules().items() if file == path), path.stem)
    package = own if path.name == "__init__.py" else own.rpartition(".")[0]
    for node, at_import, runs in _statements(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield Import(alias.name, node.lineno, at_import, runs, alias.name)
        elif isinstance(node, ast.ImportFrom):
            above = package.split(".")[: package.count(".") + 2 - node.level] if node.level else []
            base = ".".join([*above, *([node.module] if node.module else [])])
            for alias in node.names:
                inside = f"{base}.{alias.name}"
                yield Import(inside if inside in modules() else base, node.lineno, at_import, runs, inside)
    for call in ast.walk(tree):
        # By a name that is written out; the packages of a `hhsim.registry.Registry` are found, and not named.
        if isinstance(call, ast.Call) and ast.unparse(call.func).endswith("import_module"):
            name = call.args[0]
            if isinstance(name, ast.Constant) and isinstance(name.value, str):
                yield Import(name.value, call.lineno, False, True, name.value)


def _statements(tree: ast.Module) -> Iterator[tuple[ast.stmt, bool, bool]]:
    """Every statement, whether it runs when the file is imported, and whether it ever runs."""
    waiting: list[tuple[ast.AST, bool, bool]] = [(tree, True, True)]
    for outer, at_import, runs in waiting:
        typing = isinstance(outer, ast.If) and ast.unparse(outer.test) == "TYPE_CHECKING"
        later = typing or isinstance(outer, ast.FunctionDef | ast.AsyncFunctionDef)
        for inner in ast.iter_child_nodes(outer):
            if isinstance(inner, ast.stmt):
                yield inner, at_import and not later, runs and not typing
            if isinstance(inner, ast.stmt | ast.ExceptHandler | ast.match_case):
                waiting.append((inner, at_import and not later, runs and not typing))


def reached_from(command: str) -> set[str]:
    """Return the modules that a command of the command line can import, when it begins or where it needs them.

    Those of a `hhsim.registry.Registry`, and those that implement a generic kernel, are found by name and not followed.
    """
    reached: set[str] = set()
    waiting = ["hhsim.cli.main", f"hhsim.cli.{command}"]
    while waiting:
        module = waiting.pop()
        if module in modules() and module not in reached:
            reached.add(module)
            package = [] if module.count(".") < 2 else [module.rpartition(".")[0]]
            waiting += [found.name for found in imports_of(modules()[module]) if found.runs] + package
    return reached


def lines_of(names: Iterable[str]) -> int:
    """Return the number of lines of modules."""
    return sum(modules()[name].read_text(encoding="utf-8").count("\n") for name in names)


@cache
def matrix() -> dict[tuple[str, str], list[str]]:
    """For each pair of different packages, importer first: the imports between them, as `file:line imports module`."""
    found: dict[tuple[str, str], list[str]] = {}
    for module, path in library().items():
        for imported in imports_of(path):
            if imported.name in library():
                pair = package_of(module), package_of(imported.name)
                if pair[0] != pair[1]:
                    where = f"{path.relative_to(REPOSITORY)}:{imported.line} imports {imported.name}"
                    found.setdefault(pair, []).append(where)
    return found


def circles() -> list[list[str]]:
    """Groups of modules that import each other, directly or round a circle; what serves types alone does not count."""
    import networkx  # which is not there yet when `make` compiles the first kernels

    graph = networkx.DiGraph(
        (module, found.name)
        for module, path in library().items()
        for found in imports_of(path)
        if found.runs and found.name in library() and "hhsim" not in (module, found.name) and found.name != module
    )
    return [sorted(group) for group in networkx.strongly_connected_components(graph) if len(group) > 1]
