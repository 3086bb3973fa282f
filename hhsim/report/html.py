"""HTML built from typed pieces: whatever is not markup of this module is escaped, in one place."""

import base64
import hashlib
import html
import re
from collections.abc import Iterable, Sequence
from typing import TypeAlias

VOID = ("br", "img", "input", "meta", "source")
"""Elements without content."""
PHONE = "screen and (max-width: 34rem)"
"""Media query of the screens that get narrow pictures."""
ASIDE = f"{PHONE}, screen and (min-width: 74rem)"
"""The same for pictures that stand beside another one where the screen is wide."""
CARD_COLUMNS = 5
"""Columns from which on a row of a table is a card on a phone."""
MANY_COLUMNS = 8
"""Tables of at least so many columns of sentences fit a wide screen alone."""
LONGEST_WORD = 32
"""Letters of a word that is not broken in a table."""
NO_TEXT = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\ud800-\udfff\ufdd0-\ufdef\ufffe\uffff]")
"""What no HTML document may hold, not even as a reference."""


class Html(str):
    """Markup that is shown as it is."""

    __slots__ = ()


Attribute: TypeAlias = str | int | bool | None


def escaped(text: str) -> Html:
    """Text as markup; markup as it is."""
    if isinstance(text, Html):
        return text
    return Html(html.escape(NO_TEXT.sub("\N{REPLACEMENT CHARACTER}", text)))


def joined(parts: Iterable[str]) -> Html:
    """Pieces one after the other."""
    return Html("".join(escaped(part) for part in parts))


def element(tag: str, *content: str, **attributes: Attribute) -> Html:
    """One element.

    Args:
        content: Text, which is escaped, or markup.
        attributes: By name, a trailing or inner "_" for what Python has no letter for (`class_`, `aria_label`); True
            for one without a value; None and False leave it out.
    """
    named = "".join(
        f" {name.rstrip('_').replace('_', '-')}" + ("" if value is True else f'="{escaped(str(value))}"')
        for name, value in attributes.items()
        if value is not None and value is not False
    )
    if tag in VOID:
        return Html(f"<{tag}{named}>")
    return Html(f"<{tag}{named}>{joined(content)}</{tag}>")


def paragraph(*content: str, **attributes: Attribute) -> Html:
    """A paragraph."""
    return element("p", *content, **attributes)


def section(name: str, title: str, *content: str) -> Html:
    """A part of the page with a heading and an anchor."""
    return element("section", element("h2", title), *content, id=name, aria_label=title)


def folded(name: str, title: str, *content: str) -> Html:
    """A part of the page that is closed until its heading is clicked, or a link to its anchor is followed."""
    heading = element("summary", element("h2", title))
    # The anchor lies inside: a browser opens what a link leads into.
    inside = element("div", *content, id=name)
    return element("section", element("details", heading, inside), aria_label=title)


def details(title: str, *content: str, is_open: bool = False) -> Html:
    """Something within a part of the page that is closed until its title is clicked."""
    return element("details", element("summary", title), *content, open=is_open)


def listed(items: Iterable[str], **attributes: Attribute) -> Html:
    """A list with bullets."""
    return element("ul", *(element("li", item) for item in items), **attributes)


def code(text: str) -> Html:
    """A command or a name as it is typed."""
    return element("code", text)


def commands(lines: Iterable[str]) -> Html:
    """Commands to be copied, a line each."""
    return element("pre", element("code", "\n".join(lines)), tabindex=0)


def table(
    caption: str,
    headings: Sequence[str],
    rows: Iterable[Sequence[str]],
    *,
    numbers: Iterable[int] = (),
    cards: bool = False,
) -> Html:
    """A table whose first cell heads its row; of many columns a row is a card on a phone, each cell with its heading.

    It scrolls in a box of its own where it is wider than the page all the same.

    Args:
        rows: Cells, as many as headings.
        numbers: Columns that are aligned right.
        cards: Whether rows are cards on a phone even of few columns, since cells hold sentences; of many columns they
            are on a small screen too.
    """
    right = set(numbers)
    many = cards and len(headings) >= MANY_COLUMNS
    cards = cards or len(headings) >= CARD_COLUMNS

    def align(column: int) -> str | None:
        return "number" if column in right else None

    head = [element("th", heading, scope="col", class_=align(i)) for i, heading in enumerate(headings)]
    body = []
    for row in rows:
        first, *others = row
        cells = [element("th", first, scope="row", class_=align(0))]
        cells += [
            element(
                "td",
                cell,
                class_=align(i) or ("long" if is_long(cell) else None),
                data_heading=headings[i] if cards else None,
            )
            for i, cell in enumerate(others, 1)
        ]
        body.append(element("tr", *cells))
    content = (
        element("caption", caption),
        element("thead", element("tr", *head)),
        element("tbody", *body),
    )
    whole = element("table", *content, class_="cards many" if many else "cards" if cards else None)
    return element("div", whole, class_="scroll", role="region", aria_label=caption, tabindex=0)


def is_long(cell: str) -> bool:
    """Whether a word of a cell, such as a checksum, has to be broken to fit a page."""
    return not isinstance(cell, Html) and max(map(len, cell.split()), default=0) > LONGEST_WORD


def picture(png: bytes, alt: str, width: int, height: int, narrow: bytes | None = None, media: str = PHONE) -> Html:
    """A PNG that is part of the page.

    Args:
        alt: What it says, for those who do not see it.
        narrow: Another PNG that takes its place where there is less room.
        media: Where that is, as a media query.
    """
    image = element("img", src=_data(png), alt=alt, width=width, height=height)
    if narrow is None:
        return image
    columns, rows = (int.from_bytes(narrow[at : at + 4]) for at in (16, 20))
    other = element("source", media=media, srcset=_data(narrow), width=columns, height=rows)
    return element("picture", other, image)


def _data(png: bytes) -> str:
    return f"data:image/png;base64,{base64.b64encode(png).decode('ascii')}"


def figure(name: str, image: str, title: str, caption: str) -> Html:
    """A picture with what it shows below it."""
    return element("figure", image, element("figcaption", element("strong", title), " ", caption), id=name)


def page(title: str, style: str, generator: str, *body: str, script: str = "") -> str:
    """A whole document that asks nobody for anything.

    Args:
        style: CSS.
        generator: The program that made it.
        script: JavaScript that runs when all of it is there.
    """
    # Were there a link to something outside by mistake, a browser would not follow it.
    policy = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"
    if script:
        # This one script and no other, whatever a name in a table may hold.
        digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode("ascii")
        policy += f"; script-src 'sha256-{digest}'"
        body = (*body, element("script", Html(script)))
    head = (
        element("meta", charset="utf-8"),
        element("meta", name="viewport", content="width=device-width, initial-scale=1"),
        element("meta", http_equiv="Content-Security-Policy", content=policy),
        element("meta", name="generator", content=generator),
        element("meta", name="color-scheme", content="light dark"),
        element("title", title),
        element("style", Html(style)),
    )
    whole = element("html", element("head", *head), Html("\n"), element("body", *body), lang="en")
    return f"<!DOCTYPE html>\n{whole}\n"
