"""The table of ARCHITECTURE.md is of the packages and imports there are."""

import pytest

from tools.architecture import LAYERS, PAGE, imported_by, order, reduced, table


def test_the_table_is_current_and_names_each_package_once() -> None:
    assert table() in PAGE.read_text(encoding="utf-8"), "run python -m tools.architecture"
    assert sorted(name for _, names in LAYERS for name in names) == sorted(order())


def test_no_package_imports_from_a_layer_above_it() -> None:
    layer = {name: number for number, (_, names) in enumerate(LAYERS) for name in names}
    for name, imported in imported_by().items():
        assert all(layer[name] <= layer[other] for other in imported), name


@pytest.mark.soak
def test_what_follows_from_the_rest_is_left_out_and_nothing_else() -> None:
    def reach(graph: dict[str, set[str]], name: str) -> set[str]:
        return graph[name].union(*(reach(graph, other) for other in graph[name]))

    graph = imported_by()
    few = reduced(graph)
    for name in order():
        assert reach(few, name) == reach(graph, name)
    assert sum(map(len, few.values())) < sum(map(len, graph.values())) / 2
