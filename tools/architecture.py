"""The table of packages in ARCHITECTURE.md, made from their imports and docstrings: `python -m tools.architecture`."""

import ast
import re

from tools.import_graph import PACKAGES, REPOSITORY, imports_of, is_package, library, matrix, modules

PAGE = REPOSITORY / "ARCHITECTURE.md"
COMMAND_LINE = "cli"
KERNELS = ("kernels", *(package.removeprefix("hhsim.") for package in PACKAGES if package.startswith("hhsim.kernels.")))
LAYERS: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("what a user types", (COMMAND_LINE,)),
    ("many runs, other engines", ("repair", "sweep", "gate", "bench", "engines")),
    ("shown, and with a glove", ("report", "live", "view", "render")),
    ("judged", ("verify", "submissions", "robots")),
    ("a run, tick by tick", ("replay", "scene", "solver", "metrics")),
    ("motions, files", ("linkage", "recordings", "result", "motion")),
    ("objects, the hand", ("system", "table", "mesh", "trees", "hand")),
    ("kernels: numba only", KERNELS),
)
"""Layers, highest first, with their packages."""
TABLE = re.compile(r"\| layer \| package .*?\n(?=\n)", re.DOTALL)
Graph = dict[str, set[str]]


def shown_as(package: str) -> str:
    """Return the name that a package is listed under: the kernels' own, of the others that of the highest one."""
    name = package.removeprefix("hhsim").removeprefix(".")
    return name if name.startswith("kernels") else name.partition(".")[0]


def order() -> list[str]:
    """Return every name in the order of the packages, lowest first."""
    return [*(name for name in dict.fromkeys(map(shown_as, PACKAGES)) if name), COMMAND_LINE]


def imported_by() -> Graph:
    """Return for each name those that it imports from. The errors beside the packages are left out: all use them."""
    graph: Graph = {name: set() for name in order()}
    for importer, imported in matrix():
        pair = shown_as(importer), shown_as(imported)
        if all(pair) and pair[0] != pair[1]:
            graph[pair[0]].add(pair[1])
    for module, path in modules().items():
        if module.startswith("hhsim.cli"):
            names = [found.name for found in imports_of(path) if found.name in library()]
            packages = {name if is_package(name) else name.rpartition(".")[0] for name in names}
            graph[COMMAND_LINE] |= set(map(shown_as, packages)) - {"", COMMAND_LINE}
    return graph


def reduced(graph: Graph) -> Graph:
    """Return the graph without what follows from the rest: a transitive reduction."""
    reach: Graph = {}
    for name in order():
        reach[name] = set().union(graph[name], *(reach[below] for below in graph[name]))
    return {
        name: {below for below in direct if not any(below in reach[other] for other in direct)}
        for name, direct in graph.items()
    }


def purpose(name: str) -> str:
    """Return the first sentence of a package's docstring, without the kernels' clause on style."""
    text = ast.get_docstring(ast.parse(modules()[f"hhsim.{name}"].read_text(encoding="utf-8"))) or ""
    return text.partition("\n\n")[0].replace("\n", " ").removesuffix(".").partition(";")[0]


def table() -> str:
    """Return the table."""
    lines = ["| layer | package | what it holds | imports, and what these import |", "|---|---|---|---|"]
    graph = reduced(imported_by())
    for layer, names in LAYERS:
        for name in names:
            below = ", ".join(f"`{other}`" for other in reversed(order()) if other in graph[name])
            lines.append(f"| {layer if name == names[0] else ''} | `{name}` | {purpose(name)} | {below} |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    PAGE.write_text(TABLE.sub(lambda found: table(), PAGE.read_text(encoding="utf-8")), encoding="utf-8")
