"""What looks like code of hhsim's own in docstrings and comments is there; ruff holds their layout."""

import ast
import builtins
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from tools.import_graph import REPOSITORY, modules

FILES = [path for folder in ("hhsim", "cli", "tools") for path in sorted((REPOSITORY / folder).rglob("*.py"))]
REFERENCE = re.compile(r"(?<!`)`([A-Za-z_][\w.]*?)(?:\(\))?`(?!`)")
ELSEWHERE = {"ParquetTestSet", "HapticCommand", "XrHandJointEXT", "XrHandJointLocationEXT", "sockaddr", "finally"}
"""Names of other software, and of the language."""
FILES_END = {"json", "csv", "py", "h5", "toml"}
COMPOSED = {"index_flex1", "index_1", "index_knuckle", "thumb_tip", "kept_free_stale_input"}
"""Names that are put together when the code runs."""


@cache
def tree_of(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def nodes_of(path: Path) -> list[ast.AST]:
    return list(ast.walk(tree_of(path)))


@cache
def words() -> frozenset[str]:
    """Every name and every word of a string in the code, without docstrings."""
    found = set(dir(builtins))
    for path in FILES:
        docs = {id(node) for node in docstrings(path)}
        found |= set(path.relative_to(REPOSITORY).with_suffix("").parts)
        for node in nodes_of(path):
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in docs:
                found |= set(re.findall(r"\w+", node.value))
            # Names, attributes, arguments, keywords, definitions, imports.
            found |= {str(getattr(node, key)) for key in ("id", "attr", "arg", "name", "asname") if hasattr(node, key)}
    return frozenset(word for name in found for word in name.split("."))


@cache
def classes() -> dict[str, frozenset[str]]:
    """Names that stand in each class, with those of the classes of ours that it is made of."""
    own: dict[str, tuple[set[str], list[str]]] = {}
    for path in FILES:
        for node in nodes_of(path):
            if isinstance(node, ast.ClassDef):
                inside, bases = own.setdefault(node.name, (set(), []))
                inside |= names_in(node)
                bases += [ast.unparse(base).partition("[")[0] for base in node.bases]

    def members(name: str) -> frozenset[str]:
        inside, bases = own[name]
        return frozenset(inside).union(*(members(base) for base in bases if base in own and base != name))

    return {name: members(name) for name in own}


def names_in(tree: ast.AST) -> set[str]:
    """Names that a file or a class defines, imports or assigns to, wherever in it."""
    found: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.ClassDef | ast.alias):
            found.add(getattr(node, "asname", None) or node.name)
        elif isinstance(node, ast.Name | ast.Attribute) and isinstance(node.ctx, ast.Store):
            found.add(node.id if isinstance(node, ast.Name) else node.attr)
    return found


def docstrings(path: Path) -> Iterator[ast.Constant]:
    for node in nodes_of(path):
        for statement in node.body if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) else ():
            value = statement.value if isinstance(statement, ast.Expr) else None
            if isinstance(value, ast.Constant) and isinstance(value.value, str):
                yield value


def is_there(reference: str) -> bool:
    """Whether a name is code of ours that is there, or looks like none of ours."""
    first, *rest = reference.split(".")
    if first == "hhsim":
        module = reference
        while module not in modules():
            module = module.rpartition(".")[0]
        inside = reference[len(module) + 1 :].split(".")
        if module == "hhsim":
            return reference in ("hhsim", "hhsim.methods", "hhsim.objects", "hhsim.trajectories")
        return inside == [""] or (inside[0] in names_in(tree_of(modules()[module])) and is_there(".".join(inside)))
    if rest and first in classes():
        return rest[0] in classes()[first]
    if rest and f"hhsim.{first}" in modules() and rest[-1] not in FILES_END:
        return is_there(f"hhsim.{reference}")
    return bool(rest) or first in words() | ELSEWHERE | COMPOSED


def lost(path: Path) -> list[str]:
    place = path.relative_to(REPOSITORY).as_posix()
    texts = [(node.lineno, node.value) for node in docstrings(path)]
    lines = enumerate(path.read_text(encoding="utf-8").splitlines(), start=1)
    texts += [(number, line[line.index("# ") :]) for number, line in lines if "# " in line]
    return [
        f"{place}:{number}: `{reference}`"
        for number, text in texts
        for reference in REFERENCE.findall(str(text))
        if not is_there(reference)
    ]


@pytest.mark.soak
def test_every_name_of_our_code_in_a_docstring_or_comment_is_there() -> None:
    assert [line for path in FILES for line in lost(path)] == []


@pytest.mark.soak
def test_what_is_there_is_told_from_what_is_not() -> None:
    there = ("hhsim.solver.qp", "hhsim.solver.qp.QpProblem.kkt_residual", "QpProblem.conditioned", "json.dumps")
    assert all(map(is_there, (*there, "hhsim.solver.qp.solve", "kernels.qp.active_set")))
    gone = ("hhsim.solver.gone", "hhsim.solver.qp.gone", "hhsim.solver.qp.QpProblem.gone", "QpProblem.gone")
    assert not any(map(is_there, (*gone, "kernels.distance", "gone_for_good_" + "x")))
