"""The board as one HTML page that asks nobody for anything: its tables sort at a click and filter by words."""

from collections.abc import Sequence

from hhsim import __version__
from hhsim.board.collect import Board
from hhsim.board.shown import LEGEND, entry_table, said_of, standing_table
from hhsim.board.standings import Standing
from hhsim.report.html import Html, element, joined, listed, page, paragraph, section
from hhsim.report.style import STYLE
from hhsim.system.counted import counted
from hhsim.table.table import Column, Table

BOARD_STYLE = """
th button { font: inherit; color: inherit; background: none; border: 0; padding: 0; cursor: pointer;
  text-align: inherit; }
th button:focus-visible, input:focus-visible { outline: 2px solid var(--link); outline-offset: 2px; }
th[aria-sort="ascending"] button::after { content: " ▲"; }
th[aria-sort="descending"] button::after { content: " ▼"; }
label { display: block; margin: .75rem 0 0; }
input { font: inherit; width: min(100%, 30rem); padding: .35rem .5rem; color: var(--ink); background: var(--paper);
  border: 1px solid var(--soft); border-radius: .25rem; }
"""
SCRIPT = """
"use strict";
const value = (row, column) => row.cells[column].textContent.replace(/^[~]/, "").replaceAll(",", "");
function sort(table, column, down) {
  const rows = [...table.tBodies[0].rows];
  const order = (a, b) => {
    const [x, y] = [value(a, column), value(b, column)];
    const [p, q] = [parseFloat(x), parseFloat(y)];
    if (table.tHead.rows[0].cells[column].dataset.number === undefined) return x.localeCompare(y) * (down ? -1 : 1);
    if (isNaN(p) || isNaN(q)) return isNaN(p) - isNaN(q);
    return (p - q) * (down ? -1 : 1);
  };
  table.tBodies[0].append(...rows.sort(order));
  for (const head of table.tHead.rows[0].cells) head.removeAttribute("aria-sort");
  table.tHead.rows[0].cells[column].setAttribute("aria-sort", down ? "descending" : "ascending");
}
for (const button of document.querySelectorAll("th button")) {
  button.addEventListener("click", () => {
    const head = button.parentElement;
    sort(head.closest("table"), head.cellIndex, head.getAttribute("aria-sort") === "ascending");
  });
}
for (const input of document.querySelectorAll("input[data-table]")) {
  input.addEventListener("input", () => {
    const words = input.value.toLowerCase().split(/\\s+/).filter(Boolean);
    const rows = [...document.getElementById(input.dataset.table).tBodies[0].rows];
    let shown = 0;
    for (const row of rows) {
      const text = [...row.cells].map((cell) => cell.textContent).join(" ").toLowerCase();
      row.hidden = !words.every((word) => text.includes(word));
      shown += !row.hidden;
    }
    document.getElementById(input.dataset.table + "-count").textContent = `${shown} of ${rows.length} rows`;
  });
}
"""


def board_page(board: Board, standings: Sequence[Standing]) -> str:
    """The document: the standings, then each run."""
    title = f"Board of {counted(len(board.entries), 'run')}"
    body = (
        element("header", element("h1", title), paragraph(LEGEND, class_="soft")),
        element(
            "main",
            section("standings", "Methods", _table("methods", standing_table(board, standings))),
            section("runs", "Runs", _table("each-run", entry_table(board))),
            section("machines", "Machines and notes", listed(said_of(board), class_="tight")),
        ),
        element("footer", paragraph(f"Made by hhsim board, version {__version__}.")),
    )
    return page(title, STYLE + BOARD_STYLE, f"hhsim board {__version__}", *body, script=SCRIPT)


def _table(name: str, shown: Table) -> Html:
    head = [
        element("th", element("button", column.heading or "first", type="button"), scope="col", **_kind(column))
        for column in shown.columns
    ]
    align = ["number" if column.is_number else None for column in shown.columns]
    body = [
        element("tr", *(element("td", text, class_=side) for text, side in zip(cells, align))) for cells in shown.cells
    ]
    table = element("table", element("thead", element("tr", *head)), element("tbody", *body), id=name)
    box = element("div", table, class_="scroll", role="region", aria_label=name, tabindex=0)
    field = element("label", "Only rows with these words: ", element("input", type="search", data_table=name))
    count = element("p", f"{len(body)} of {len(body)} rows", class_="soft", id=f"{name}-count", role="status")
    return joined([field, count, box])


def _kind(column: Column) -> dict[str, str | bool | None]:
    return {"class_": "number" if column.is_number else None, "data_number": column.is_number}
