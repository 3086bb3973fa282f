"""The picture of ARCHITECTURE.md, drawn from the imports: `python -m tools.architecture`.

Writes docs/architecture.svg and prints who imports whom, as a matrix. With `--check` nothing is written: the exit code
is 1 where the committed picture shows other packages or arrows than there are, or counts that are off by more than
a tenth.
"""

import ast
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from html import escape
from textwrap import wrap

from tools.import_graph import PACKAGES, REPOSITORY, imports_of, is_package, library, matrix, modules

PICTURE = REPOSITORY / "docs" / "architecture.svg"
COMMAND_LINE = "cli"

KERNELS = ("kernels", *(package.removeprefix("hhsim.") for package in PACKAGES if package.startswith("hhsim.kernels.")))
LAYERS: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("what a user types", ("cli",)),
    ("many runs, other engines", ("repair", "board", "sweep", "engines")),
    ("shown, and with a glove", ("report", "live", "view", "render")),
    ("judged", ("gate", "verify", "bench", "submissions", "robots")),
    ("a run, tick by tick", ("replay", "scene", "solver", "metrics")),
    ("motions, files", ("linkage", "exchange", "recordings", "result", "motion")),
    ("objects, the hand", ("system", "table", "mesh", "trees", "hand")),
    ("kernels: numba only, arrays in and out", KERNELS),
)
"""Layers, highest first, and their boxes from left to right; an empty name leaves a place free."""

WIDTH = 1040
LEFT = 112
"""Where boxes begin; the layers' names stand before [px]."""
RIGHT = WIDTH - 20
TOP = 14
LAYER_GAP = 32
LAYER_RIM = 10
BOX_HEIGHT = 90
LOW_HEIGHT = 62
"""Of a box that has no sentence, or a layer to itself [px]."""
COLUMNS = 4
"""Of the layers above the kernels, whose boxes are smaller and more."""
COLUMN_GAP = 40
KERNEL_GAP = 14
ARC_DEPTH = 26
ARC_DEPTH_A_BOX = 6
LETTERS_A_LINE = 28
COUNT_SLACK = 0.1
"""Share that a count of the committed picture may be off by: not every commit draws it anew."""

COLORS = ("#4c566a", "#7b5ea7", "#b4687a", "#2f7fb5", "#2e8b83", "#5b8c3e", "#b07d2b", "#8c5a3c")
INK = "#1f2933"
FAINT = "#52606d"

Graph = dict[str, set[str]]
Counts = dict[str, tuple[int, int]]
Edge = tuple[str, str]
Point = tuple[float, float]


@dataclass(frozen=True)
class Box:
    """A package's place in the picture.

    Attributes:
        layer: Number from above, the kernels' being the last.
        column: Number from the left.
        left: Edge [px].
        top: Edge [px].
        width: Across [px].
        height: Down [px].
    """

    layer: int
    column: int
    left: float
    top: float
    width: float
    height: float

    @property
    def right(self) -> float:
        """Edge [px]."""
        return self.left + self.width

    @property
    def middle(self) -> float:
        """Between left and right [px]."""
        return self.left + self.width / 2

    @property
    def bottom(self) -> float:
        """Edge [px]."""
        return self.top + self.height


def box_of(package: str) -> str:
    """Box that a package is drawn in: the kernels' packages have one each, of the others only the highest."""
    name = package.removeprefix("hhsim").removeprefix(".")
    return name if name.startswith("kernels") else name.partition(".")[0]


def order() -> list[str]:
    """Every box in the order of the packages, lowest first."""
    return [*(name for name in dict.fromkeys(box_of(package) for package in PACKAGES) if name), COMMAND_LINE]


def imported_by() -> Graph:
    """For each box the boxes that it imports from. The errors beside the packages are left out: all use them."""
    graph: Graph = {name: set() for name in order()}
    for importer, imported in matrix():
        pair = box_of(importer), box_of(imported)
        if all(pair) and pair[0] != pair[1]:
            graph[pair[0]].add(pair[1])
    for module, path in modules().items():
        if module.startswith("hhsim.cli"):
            found = {box_of(_package(imported.name)) for imported in imports_of(path) if imported.name in library()}
            graph[COMMAND_LINE] |= found - {"", COMMAND_LINE}
    return graph


def _package(module: str) -> str:
    return module if is_package(module) else module.rpartition(".")[0]


def reduced(graph: Graph) -> Graph:
    """The graph without what follows from the rest: a transitive reduction."""
    reach: Graph = {}
    for name in order():
        reach[name] = set().union(graph[name], *(reach[below] for below in graph[name]))
    return {
        name: {below for below in direct if not any(below in reach[other] for other in direct)}
        for name, direct in graph.items()
    }


def counts() -> Counts:
    """Modules and lines of each box, a package's own file counted by its lines alone."""
    found: Counts = dict.fromkeys(order(), (0, 0))
    for module, path in modules().items():
        name = COMMAND_LINE if module.startswith("hhsim.cli") else box_of(_package(module))
        if name:
            before = found[name]
            lines = len(path.read_text(encoding="utf-8").splitlines())
            found[name] = before[0] + (path.name != "__init__.py"), before[1] + lines
    return found


def purpose(name: str) -> str:
    """What a package holds: the first sentence of its docstring, without the kernels' clause on style."""
    module = "hhsim.cli" if name == COMMAND_LINE else f"hhsim.{name}"
    text = ast.get_docstring(ast.parse(modules()[module].read_text(encoding="utf-8"))) or ""
    sentence = text.partition("\n\n")[0].replace("\n", " ").replace("`", "")
    return sentence.removesuffix(".").partition(";")[0]


def places() -> dict[str, Box]:
    """Where every box lies."""
    found = {}
    top = float(TOP)
    for layer, (_, names) in enumerate(LAYERS):
        gap = COLUMN_GAP if len(names) <= COLUMNS else KERNEL_GAP
        width = (RIGHT - LEFT - (len(names) - 1) * gap) / len(names)
        height = BOX_HEIGHT if len(names) == COLUMNS else LOW_HEIGHT
        top += LAYER_RIM
        for column, name in enumerate(names):
            if name:
                found[name] = Box(layer, column, LEFT + column * (width + gap), top, width, height)
        top += height + LAYER_RIM + LAYER_GAP
    return found


def _rounded(lines: int) -> str:
    unit = 10 ** max(len(str(lines)) - 2, 1)
    return f"{round(lines / unit) * unit:,}"


def _text(x: float, y: float, words: str, size: float, color: str, more: str = "") -> str:
    return f'<text x="{x:.0f}" y="{y:.0f}" font-size="{size:g}" fill="{color}"{more}>{escape(words)}</text>'


def _rectangle(left: float, top: float, width: float, height: float, look: str) -> str:
    return f'<rect x="{left:.1f}" y="{top:.1f}" width="{width:.1f}" height="{height:.1f}" {look}/>'


def _drawn_box(name: str, box: Box, count: tuple[int, int]) -> Iterator[str]:
    color = COLORS[box.layer]
    x = box.left + 11
    title = name.removeprefix("kernels.")
    yield _rectangle(
        box.left, box.top, box.width, box.height, f'rx="6" fill="#ffffff" stroke="{color}" stroke-width="1.6"'
    )
    yield _text(x, box.top + 20, title, 13 if name.startswith("kernels") else 15, color, ' font-weight="700"')
    data = f' data-name="{name}" data-modules="{count[0]}" data-lines="{count[1]}"'
    modules_, lines = f"{count[0]} modules", f"{_rounded(count[1])} lines"
    if name.startswith("kernels"):
        yield _text(x, box.top + 37, modules_, 10.5, FAINT, data)
        yield _text(x, box.top + 52, lines, 10.5, FAINT)
    else:
        letters = LETTERS_A_LINE if box.height == BOX_HEIGHT else COLUMNS * LETTERS_A_LINE
        for line, words in enumerate(wrap(purpose(name), letters)):
            yield _text(x, box.top + 37 + 14 * line, words, 11.5, INK)
        yield _text(x, box.bottom - 9, f"{modules_} · {lines}", 10.5, FAINT, data)


def _is_beside(edge: Edge, boxes: dict[str, Box]) -> bool:
    upper, lower = boxes[edge[0]], boxes[edge[1]]
    return upper.layer == lower.layer and abs(upper.column - lower.column) == 1


def _sides(edge: Edge, boxes: dict[str, Box]) -> tuple[str, str]:
    """Sides of two boxes that an arrow leaves and enters by: past a neighbour above it, among the kernels below."""
    upper, lower = boxes[edge[0]], boxes[edge[1]]
    if upper.layer != lower.layer:
        return "bottom", "top"
    return ("bottom", "bottom") if upper.layer == len(LAYERS) - 1 else ("top", "top")


def _ports(edges: list[Edge], boxes: dict[str, Box]) -> dict[tuple[Edge, str], Point]:
    """Where each arrow leaves and enters its boxes: one place each, in the order of where they come from."""
    ends: dict[tuple[str, str], list[tuple[float, Edge, str]]] = {}
    for edge in edges:
        for name, other, side in zip(edge, reversed(edge), _sides(edge, boxes), strict=True):
            ends.setdefault((name, side), []).append((boxes[other].middle, edge, name))
    found = {}
    for (name, side), own in ends.items():
        box = boxes[name]
        for number, (middle, edge, _) in enumerate(sorted(own), 1):
            x = middle if box.width > (RIGHT - LEFT) / 2 else box.left + box.width * number / (len(own) + 1)
            found[edge, name] = x, box.top if side == "top" else box.bottom
    return found


def _arrows(graph: Graph, boxes: dict[str, Box]) -> Iterator[str]:
    edges = [(name, below) for name in reversed(order()) for below in sorted(graph[name])]
    ports = _ports([edge for edge in edges if not _is_beside(edge, boxes)], boxes)
    lanes: dict[int, int] = {}
    for edge in edges:
        upper, lower = boxes[edge[0]], boxes[edge[1]]
        if _is_beside(edge, boxes):
            y = upper.top + upper.height * 0.7
            start, end = (upper.left, lower.right + 1) if lower.left < upper.left else (upper.right, lower.left - 1)
            way = f"M{start:.1f},{y:.1f} H{end:.1f}"
        else:
            (x0, y0), (x1, y1) = ports[edge, edge[0]], ports[edge, edge[1]]
            if lower.layer == upper.layer:
                depth = ARC_DEPTH + ARC_DEPTH_A_BOX * abs(upper.column - lower.column)
                y = y0 + depth if y0 == upper.bottom else y0 - depth
                way = f"M{x0:.1f},{y0:.1f} C{x0:.1f},{y:.1f} {x1:.1f},{y:.1f} {x1:.1f},{y1:.1f}"
            elif lower.layer == upper.layer + 1:
                y = (y0 + y1) / 2
                way = f"M{x0:.1f},{y0:.1f} C{x0:.1f},{y:.1f} {x1:.1f},{y:.1f} {x1:.1f},{y1:.1f}"
            else:
                way = _past_layers((x0, y0), (x1, y1), lanes)
        yield f'<path d="{way}" marker-end="url(#tip)"/>'


def _past_layers(start: Point, end: Point, lanes: dict[int, int]) -> str:
    """Way of an arrow past whole layers: down the gap between two columns that is nearest to it, a lane for each."""
    width = (RIGHT - LEFT - (COLUMNS - 1) * COLUMN_GAP) / COLUMNS
    gaps = [LEFT + gap * (width + COLUMN_GAP) - COLUMN_GAP / 2 for gap in range(1, COLUMNS)]
    nearest = min(range(len(gaps)), key=lambda gap: abs(gaps[gap] - (start[0] + end[0]) / 2))
    lane = lanes[nearest] = lanes.get(nearest, -1) + 1
    x = gaps[nearest] + (-8, 8, 0)[lane % 3]
    bend = LAYER_GAP / 2 + LAYER_RIM
    high, low = start[1] + 2 * bend, end[1] - 2 * bend
    return (
        f"M{start[0]:.1f},{start[1]:.1f} C{start[0]:.1f},{start[1] + bend:.1f} {x:.1f},{high - bend:.1f} "
        f"{x:.1f},{high:.1f} V{low:.1f} C{x:.1f},{low + bend:.1f} {end[0]:.1f},{end[1] - bend:.1f} "
        f"{end[0]:.1f},{end[1]:.1f}"
    )


def picture(count: Counts) -> str:
    """The picture as SVG, its numbers as they are given: modules and lines of each box."""
    boxes = places()
    lowest = max(box.bottom for box in boxes.values()) + LAYER_RIM + 50
    height = lowest + 32
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height:.0f}" width="{WIDTH}" '
        f"height=\"{height:.0f}\" font-family=\"system-ui, 'Segoe UI', 'DejaVu Sans', sans-serif\">",
        "<title>The packages of hhsim and what they import</title>",
        '<defs><marker id="tip" viewBox="0 0 8 8" refX="7.5" refY="4" markerWidth="8" markerHeight="8" '
        f'orient="auto" markerUnits="userSpaceOnUse"><path d="M0,0.5 L8,4 L0,7.5 z" fill="{FAINT}"/></marker></defs>',
        f'<rect width="{WIDTH}" height="{height:.0f}" fill="#ffffff"/>',
    ]
    for layer, (title, _) in enumerate(LAYERS):
        box = next(box for box in boxes.values() if box.layer == layer)
        top = box.top - LAYER_RIM
        bottom = lowest if layer == len(LAYERS) - 1 else box.bottom + LAYER_RIM
        look = f'rx="8" fill="{COLORS[layer]}" fill-opacity="0.09"'
        parts.append(_rectangle(10, top, WIDTH - 20, bottom - top, look))
        for line, words in enumerate(wrap(title, 13)):
            parts.append(_text(20, top + 27 + 15 * line, words, 11.5, COLORS[layer], ' font-weight="600"'))
    parts.append(f'<g fill="none" stroke="{FAINT}" stroke-width="1.3">')
    parts.extend(_arrows(reduced(imported_by()), boxes))
    parts.append("</g>")
    for name, box in boxes.items():
        parts.extend(_drawn_box(name, box, count[name]))
    note = (
        "A package may import from all that its arrows lead to, in one step or several. "
        "Arrows that follow from others are not drawn."
    )
    parts.extend([_text(20, height - 12, note, 11.5, FAINT), "</svg>"])
    return "\n".join(parts) + "\n"


def drawn_counts(svg: str) -> Counts:
    """The counts that a picture shows."""
    found = re.findall(r'data-name="([\w.]+)" data-modules="(\d+)" data-lines="(\d+)"', svg)
    return {name: (int(modules_), int(lines)) for name, modules_, lines in found}


def is_current(svg: str) -> bool:
    """Whether a picture shows the packages and arrows there are, and counts that are not far off."""
    drawn, true = drawn_counts(svg), counts()
    if drawn.keys() != true.keys():
        return False
    pairs = [pair for name in true for pair in zip(drawn[name], true[name], strict=True)]
    near = all(abs(shown - count) <= max(COUNT_SLACK * count, 1) for shown, count in pairs)
    return near and picture(drawn) == svg


def matrix_table() -> str:
    """Imports between packages as text: a line an importer, a column an imported package, both in their order."""
    found = matrix()
    number = {package: str(index) for index, package in enumerate(PACKAGES)}
    width = max(map(len, PACKAGES)) + 4
    lines = ["imports of the line's package from the column's; . where there may be some, blank where none may be"]
    lines.append(" " * width + "".join(f"{number[package]:>4}" for package in PACKAGES))
    for row, importer in enumerate(PACKAGES):
        cells = []
        for column, imported in enumerate(PACKAGES):
            count = len(found.get((importer, imported), ()))
            cells.append(str(count) if count else "." if column < row else "")
        lines.append(
            f"{number[importer]:>2} {importer:<{width - 3}}" + "".join(f"{cell:>4}" for cell in cells).rstrip()
        )
    return "\n".join(lines)


def main(arguments: list[str]) -> int:
    """Draw, or check: 0, or 1 where the committed picture is not current."""
    if arguments == ["--check"]:
        if is_current(PICTURE.read_text(encoding="utf-8")):
            return 0
        print(f"{PICTURE.relative_to(REPOSITORY)} is not current: run python -m tools.architecture", file=sys.stderr)
        return 1
    if arguments:
        print("usage: python -m tools.architecture [--check]", file=sys.stderr)
        return 2
    PICTURE.write_text(picture(counts()), encoding="utf-8")
    print(matrix_table())
    return 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
