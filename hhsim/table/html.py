"""HTML pages from Jinja2 templates, which lie beside the modules that fill them; all text in them is escaped."""

import base64
import re
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jinja2 import Environment

TEMPLATES = Path(__file__).parents[1]
LONGEST_WORD = 32
"""Letters of a word that is not broken in a table."""
NO_TEXT = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\ud800-\udfff\ufdd0-\ufdef\ufffe\uffff]")
"""Letters that no HTML document may hold, not even as a reference."""


def render(template: str, **values: Any) -> str:
    """Return the page of a template under hhsim/, such as "report/report.html", with its values by their names."""
    return environment().get_template(template).render(values)


@cache
def environment() -> "Environment":
    """Return the environment that compiles the templates."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    made = Environment(
        loader=FileSystemLoader(TEMPLATES), autoescape=True, finalize=_legal, undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    made.filters["base64"] = lambda data: base64.b64encode(data).decode("ascii")
    made.filters["png_size"] = lambda png: tuple(int.from_bytes(png[at : at + 4]) for at in (16, 20))
    # A word of such a cell, as a checksum is, has to be broken to fit a page.
    made.tests["long"] = lambda cell: max(map(len, cell.split()), default=0) > LONGEST_WORD
    return made


def _legal(value: Any) -> Any:
    if not isinstance(value, str) or hasattr(value, "__html__"):
        return value
    return NO_TEXT.sub("\N{REPLACEMENT CHARACTER}", value)
