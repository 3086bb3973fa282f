"""HTML of a report: escaped in one place, well-formed, and readable in every colour scheme."""

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st
from report_reader import read_page

from hhsim.report.html import CARD_COLUMNS, MANY_COLUMNS, Html, element, escaped, figure, joined, page, picture, table
from hhsim.report.style import STYLE

NASTY = '</td><script>alert("x")</script>&amp; \' "'


@given(st.text())
def test_text_comes_back_as_it_was(text: str) -> None:
    read = read_page(element("p", text, title=text)).one("p")
    expected = escaped(text)
    assert "<" not in expected
    # A reader of HTML sees every line end as "\n", and none of what no document may hold.
    plain = re.sub(
        "[\x00-\x08\x0b-\x1f\x7f-\x9f\ud800-\udfff\ufdd0-\ufdef\ufffe\uffff]", "\N{REPLACEMENT CHARACTER}", text
    )
    assert read.text == plain
    assert read.attributes["title"] == plain
    assert expected.encode().decode() == expected


@given(st.lists(st.lists(st.text(max_size=8), min_size=2, max_size=2), max_size=4), st.text(max_size=12))
def test_a_table_holds_the_cells_that_it_is_given(rows: list[list[str]], caption: str) -> None:
    found = read_page(table(caption, ("one", "two"), rows, numbers=(1,)))
    assert found.rows("")[0] == ["one", "two"]
    assert found.rows("")[1:] == [[read_page(element("p", cell)).one("p").text for cell in row] for row in rows]
    assert [cell.attributes["scope"] for cell in found.all("th")] == ["col", "col"] + ["row"] * len(rows)
    assert all(cell.attributes.get("class") == "number" for cell in found.all("td"))


def test_a_checksum_may_be_broken_and_a_word_is_not() -> None:
    cells = read_page(table("sums", ("one", "two", "three"), [("x", "0" * 64, "deformation of the object")])).all("td")
    assert [cell.attributes.get("class") for cell in cells] == ["long", None]


@pytest.mark.parametrize(
    ("columns", "sentences", "cards"),
    [(4, False, None), (5, False, "cards"), (3, True, "cards"), (11, False, "cards"), (8, True, "cards many")],
)
def test_a_table_of_many_columns_is_cards_on_a_phone(columns: int, sentences: bool, cards: str | None) -> None:
    assert (CARD_COLUMNS, MANY_COLUMNS) == (5, 8)
    headings = [f"column {i}" for i in range(columns)]
    found = read_page(table("t", headings, [["x"] * columns], cards=sentences))
    assert found.one("table").attributes.get("class") == cards
    named = [cell.attributes.get("data-heading") for cell in found.all("td")]
    assert named == (headings[1:] if cards else [None] * (columns - 1))


def test_cards_of_many_columns_begin_on_a_wider_screen() -> None:
    phone, small = (STYLE.split(f"@media screen and (max-width: {width}) {{")[1] for width in ("54rem", "70rem"))
    assert phone.startswith("\n  table.cards, table.cards tbody")
    assert small.startswith("\n  table.cards.many, table.cards.many tbody")
    assert STYLE.count("{") == STYLE.count("}")


def test_markup_is_not_escaped_twice() -> None:
    inner = element("b", NASTY)
    assert isinstance(inner, Html)
    assert element("p", inner) == f"<p>{inner}</p>"
    assert joined([inner, "<"]) == f"{inner}&lt;"
    assert read_page(inner).one("b").text == NASTY


def test_attributes_without_a_value_and_without_a_place() -> None:
    assert element("p", hidden=True, lang=None, id=False, class_="x", aria_label="y") == (
        '<p hidden class="x" aria-label="y"></p>'
    )
    assert element("img", alt="") == '<img alt="">'


def test_a_page_says_what_it_is_and_asks_nobody() -> None:
    image = picture(b"\x89PNG", "a hand", 4, 3)
    found = read_page(page("T & T", STYLE, "hhsim report 1", figure("f", image, "Title", NASTY)))
    assert found.one("html").attributes["lang"] == "en"
    assert found.one("title").text == "T & T"
    metas = {
        meta.attributes.get("name") or meta.attributes.get("http-equiv"): meta.attributes for meta in found.all("meta")
    }
    assert metas["viewport"]["content"] == "width=device-width, initial-scale=1"
    assert "default-src 'none'" in str(metas["Content-Security-Policy"]["content"])
    assert found.one("img").attributes == {
        "src": "data:image/png;base64,iVBORw==",
        "alt": "a hand",
        "width": "4",
        "height": "3",
    }
    assert found.one("figcaption").text == f"Title {NASTY}"
    assert not found.all("script")


def luminance(color: str) -> float:
    """Relative luminance of WCAG 2.1."""
    values = [int(color[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    red, green, blue = (v / 12.92 if v <= 0.04045 else ((v + 0.055) / 1.055) ** 2.4 for v in values)
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


def contrast(one: str, other: str) -> float:
    light, dark = sorted((luminance(one), luminance(other)), reverse=True)
    return (light + 0.05) / (dark + 0.05)


SCHEMES = [
    dict(re.findall(r"--(\w+): (#[0-9a-f]{6})", block)) for block in re.findall(r":root \{(.*?)\}", STYLE, re.DOTALL)
]


def test_the_contrast_is_that_of_the_standard() -> None:
    # The extremes are known: black on white is 21.
    assert contrast("#000000", "#ffffff") == pytest.approx(21.0)


@pytest.mark.parametrize("colors", SCHEMES, ids=["light", "dark", "paper"])
def test_text_has_contrast_in_every_scheme(colors: dict[str, str]) -> None:
    colors = {**SCHEMES[0], **colors}
    for name in ("ink", "soft", "link", "good", "bad", "note"):
        for ground in ("paper", "band"):
            assert contrast(colors[name], colors[ground]) >= 4.5, f"{name} on {ground}"


def test_the_style_asks_for_nothing_from_outside() -> None:
    assert "url(" not in STYLE
    assert "@import" not in STYLE
    assert "<" not in STYLE
