"""HTML: escaped in one place, well-formed, and readable in every colour scheme."""

import re
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from report_reader import read_page

from hhsim.table.html import environment, render
from hhsim.table.table import Marked, Table

STYLE = render("report/style.css")
NASTY = '</td><script>alert("x")</script>&amp; \' "'


def filled(template: str, **values: Any) -> str:
    """A template of a few words with values in it."""
    return environment().from_string(template).render(values)


def table(headings: list[str], rows: list[list[str]], *, cards: bool = False, title: str = "t") -> str:
    """A table whose second column is of numbers."""
    shown = Table.of_cells(headings, rows, title, numbers=headings[1:2])
    return filled("{% from 'table/parts.html' import table %}{{ table(shown, cards) }}", shown=shown, cards=cards)


@given(st.text())
def test_text_comes_back_as_it_was(text: str) -> None:
    page = filled('<p title="{{ text }}">{{ text }}</p>', text=text)
    read = read_page(page).one("p")
    # A reader of HTML sees every line end as "\n", and none of what no document may hold.
    illegal = "[\x00-\x08\x0b-\x1f\x7f-\x9f\ud800-\udfff\ufdd0-\ufdef\ufffe\uffff]"
    plain = re.sub(illegal, "\N{REPLACEMENT CHARACTER}", text)
    assert read.text == read.attributes["title"] == plain
    assert page.count("<") == 2 and page.encode().decode() == page


@given(st.lists(st.lists(st.text(max_size=8), min_size=2, max_size=2), max_size=4), st.text(max_size=12))
def test_a_table_holds_the_cells_that_it_is_given(rows: list[list[str]], caption: str) -> None:
    found = read_page(table(["one", "two"], rows, title=caption))
    assert found.rows("")[0] == ["one", "two"]
    assert found.rows("")[1:] == [[read_page(filled("<p>{{ c }}</p>", c=c)).one("p").text for c in row] for row in rows]
    assert [cell.attributes["scope"] for cell in found.all("th")] == ["col", "col"] + ["row"] * len(rows)
    assert all(cell.attributes.get("class") == "number" for cell in found.all("td"))


def test_a_marked_cell_has_its_mood_and_the_words_below_it() -> None:
    found = read_page(table(["a", "b"], [["x", Marked("1.5", "bad", NASTY)], ["y", Marked("2")]]))
    assert (found.one("b").text, found.one("b").attributes["class"]) == ("1.5", "bad")
    assert found.one("small").text == NASTY
    assert [cell.text for cell in found.all("td")] == [f"1.5 {NASTY}", "2"]


def test_a_page_says_what_it_is_and_asks_nobody() -> None:
    found = read_page(render("report/page.html", title="T & T", generator="hhsim report", version="1"))
    assert found.one("html").attributes["lang"] == "en"
    assert found.one("title").text == "T & T"
    each = [meta.attributes for meta in found.all("meta")]
    metas = {meta.get("name") or meta.get("http-equiv"): meta for meta in each}
    assert metas["viewport"]["content"] == "width=device-width, initial-scale=1"
    assert metas["generator"]["content"] == "hhsim report 1"
    assert "default-src 'none'" in str(metas["Content-Security-Policy"]["content"])
    assert not found.all("script")


def luminance(color: str) -> float:
    """Relative luminance of WCAG 2.1."""
    values = [int(color[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    red, green, blue = (v / 12.92 if v <= 0.04045 else ((v + 0.055) / 1.055) ** 2.4 for v in values)
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


SCHEMES = [dict(re.findall(r"--(\w+): (#[0-9a-f]{6})", block)) for block in re.findall(r"(?s):root \{(.*?)\}", STYLE)]


@pytest.mark.parametrize("colors", SCHEMES, ids=["light", "dark", "paper"])
def test_text_has_contrast_in_every_scheme(colors: dict[str, str]) -> None:
    colors = {**SCHEMES[0], **colors}
    for name in ("ink", "soft", "link", "good", "bad", "note"):
        for ground in ("paper", "band"):
            dark, light = sorted(luminance(colors[which]) + 0.05 for which in (name, ground))
            assert light / dark >= 4.5, f"{name} on {ground}"


def test_the_style_asks_for_nothing_from_outside() -> None:
    assert not any(mark in STYLE for mark in ("url(", "@import", "<"))
