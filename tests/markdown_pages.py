"""Pages of the documentation, taken apart: headings, links, code spans, fenced blocks, command lines."""

import json
import re
import shlex
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

FENCE = re.compile(r"^( *)```(\w*)\n(.*?)^\1```$", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"!?\[(?:[^\[\]]|\[[^\]]*\])*\]\(([^()\s]+(?:\([^()]*\))?[^()\s]*)\)")
SPAN = re.compile(r"(?<!`)`([^`\n]+(?:\n[^`\n]+)?)`(?!`)")
HEADING = re.compile(r"^#{1,6} +(.+?) *$", re.MULTILINE)
ROW = re.compile(r"^\|(.+)\|$", re.MULTILINE)


@dataclass(frozen=True)
class Page:
    """A Markdown file.

    Attributes:
        path: Of the file.
        text: All of it.
    """

    path: Path
    text: str

    @classmethod
    def read(cls, path: Path) -> "Page":
        """Read a file."""
        return cls(path, path.read_text(encoding="utf-8"))

    @property
    def is_moved(self) -> bool:
        """True of a page that only says where its text went."""
        return self.text.startswith("# Moved\n")

    @property
    def prose(self) -> str:
        """The text without its fenced blocks."""
        return FENCE.sub("", self.text)

    def blocks(self, language: str) -> list[str]:
        """The fenced blocks of a language."""
        return [body for _, found, body in FENCE.findall(self.text) if found == language]

    def links(self) -> list[str]:
        """Targets of all links and pictures."""
        return LINK.findall(SPAN.sub("", self.prose))

    def spans(self) -> list[str]:
        """All code spans outside of fenced blocks, on one line each."""
        return [" ".join(span.split()) for span in SPAN.findall(self.prose)]

    def anchors(self) -> set[str]:
        """The anchors of the headings, as GitHub makes them."""
        seen: Counter[str] = Counter()
        found = set()
        for heading in HEADING.findall(self.prose):
            plain = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", heading)
            slug = re.sub(r"[^\w\- ]", "", plain.lower()).replace(" ", "-")
            found.add(f"{slug}-{seen[slug]}" if seen[slug] else slug)
            seen[slug] += 1
        return found

    def rows(self) -> list[list[str]]:
        """All rows of all tables, a list of cells each."""
        return [[cell.strip() for cell in row.split("|")] for row in ROW.findall(self.prose)]

    def command_lines(self) -> list[str]:
        """Shell lines: what follows the prompt in console blocks, lines of bash blocks; comments cut off."""
        lines: list[str] = []
        for language in ("console", "bash", "sh", ""):
            for block in self.blocks(language):
                for line in block.replace("\\\n", " ").splitlines():
                    stripped = line.strip()
                    if stripped.startswith("$ ") or language in ("bash", "sh"):
                        lines.append(re.sub(r"(^|\s)#.*$", "", stripped.removeprefix("$ ")).strip())
        return [line for line in lines if line]

    def typed_calls(self, program: str) -> list[list[str]]:
        """Arguments of every call of a program in the shell lines."""
        return _calls(self.command_lines(), program)

    def named_calls(self, program: str) -> list[list[str]]:
        """The same in the code spans, which may leave away what does not matter."""
        return _calls(self.spans(), program)


def _calls(lines: list[str], program: str) -> list[list[str]]:
    found = []
    for line in lines:
        for part in re.split(r"&&|[|;>]|\$ ", line) if " " in line else []:
            words = [word for word in _words(part) if not re.fullmatch(r"[A-Z_]+=\S*", word)]
            if words and Path(words[0]).name == program:
                found.append(words[1:])
    return found


def _words(text: str) -> list[str]:
    try:
        return shlex.split(text)
    except ValueError:
        # An apostrophe of a sentence.
        return text.split()


def pages(repository: Path) -> list[Page]:
    """Every page of the repository that a reader may open."""
    paths = [repository / "README.md", repository / "ARCHITECTURE.md", *sorted((repository / "docs").rglob("*.md"))]
    read = [Page.read(path) for path in [*paths, *sorted((repository / "examples").glob("*.md"))]]
    return read + [notebook(path) for path in sorted((repository / "docs").rglob("*.ipynb"))]


def notebook(path: Path) -> Page:
    """The text of a notebook as a page; the lines of its cells that go to a shell are console blocks."""
    parts = []
    for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]:
        text = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            parts.append(text)
        elif text.startswith("!"):
            parts.append("```console\n" + re.sub(r"(?m)^!", "$ ", text) + "\n```")
    return Page(path, "\n\n".join(parts))
