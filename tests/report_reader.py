"""Reads a page of HTML strictly: every element is closed where it should be, and nothing is said twice."""

from dataclasses import dataclass, field
from html.parser import HTMLParser

VOID = {"br", "img", "meta", "source"}


@dataclass
class Element:
    """One element with its text, that of the elements in it included."""

    tag: str
    attributes: dict[str, str | None]
    parents: tuple[str, ...]
    text: str = ""


@dataclass
class Page:
    """What a page holds, in its order."""

    elements: list[Element] = field(default_factory=list)

    def all(self, tag: str) -> list[Element]:
        return [element for element in self.elements if element.tag == tag]

    def one(self, tag: str) -> Element:
        (found,) = self.all(tag)
        return found

    def by_id(self, name: str) -> Element:
        (found,) = (element for element in self.elements if element.attributes.get("id") == name)
        return found

    def rows(self, caption: str) -> list[list[str]]:
        """Cells of the one table whose caption begins so, its head included."""
        tables = [i for i, element in enumerate(self.elements) if element.tag == "table"]
        found = []
        for start, end in zip(tables, [*tables[1:], len(self.elements)]):
            inside = self.elements[start:end]
            if any(e.tag == "caption" and e.text.startswith(caption) for e in inside):
                depth = len(inside[0].parents)
                cells: list[list[str]] = []
                for element in inside[1:]:
                    if len(element.parents) <= depth:
                        break
                    if element.tag == "tr":
                        cells.append([])
                    elif element.tag in ("th", "td"):
                        cells[-1].append(element.text)
                found.append(cells)
        (rows,) = found
        return rows


class _Reader(HTMLParser):
    def __init__(self) -> None:
        super().__init__(convert_charrefs=True)
        self.page, self.open = Page(), list[Element]()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        names = [name for name, _ in attrs]
        assert len(names) == len(set(names)), f"<{tag}> has an attribute twice"
        element = Element(tag, dict(attrs), tuple(parent.tag for parent in self.open))
        self.page.elements.append(element)
        if tag not in VOID:
            self.open.append(element)

    def handle_endtag(self, tag: str) -> None:
        assert self.open, f"</{tag}> closes nothing"
        assert self.open[-1].tag == tag, f"</{tag}> closes <{self.open[-1].tag}>"
        self.open.pop()

    def handle_data(self, data: str) -> None:
        for element in self.open:
            element.text += data


def read_page(text: str) -> Page:
    """Read a document, or a piece of one."""
    reader = _Reader()
    reader.feed(text)
    reader.close()
    assert not reader.open, f"<{reader.open[-1].tag}> is never closed"
    return reader.page
