"""The site: its navigation leads to every page, its pages are light, whole and need no other host."""

import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import pytest
import yaml
from conftest import REPOSITORY
from markdown_pages import Page

DOCS = REPOSITORY / "docs"
MADE = {"commands.md", "python.md", "architecture.md", "contributing.md", "changelog.md", "examples.md"}
"""Pages that tools/site_pages.py makes."""
README_WORDS, DOCS_WORDS = 700, 30_000
"""Most words of the README, and of the pages of docs/ but its lab book."""
FIRST_PAGE = 1_500_000
"""What the first page may take, with its pictures and the theme [bytes]."""


class Loader(yaml.SafeLoader):
    """Reads mkdocs.yml; the functions that it names are not called."""


Loader.add_multi_constructor("tag:yaml.org,2002:python/", lambda loader, suffix, node: suffix)


def navigation(entry: Any) -> list[str]:
    if isinstance(entry, str):
        return [entry]
    return [uri for one in (entry.values() if isinstance(entry, dict) else entry) for uri in navigation(one)]


def test_the_navigation_leads_to_every_page() -> None:
    named = navigation(yaml.load((REPOSITORY / "mkdocs.yml").read_text(encoding="utf-8"), Loader)["nav"])
    assert len(named) == len(set(named))
    there = {
        path.relative_to(DOCS).with_suffix(".md").as_posix()
        for kind in ("md", "ipynb")
        for path in DOCS.rglob(f"*.{kind}")
    }
    moved = {path.name for path in DOCS.glob("*.md") if Page.read(path).is_moved}
    assert there - moved <= set(named)
    assert {uri for uri in set(named) - there if "/" not in uri} <= MADE


def test_the_readme_and_the_pages_are_short() -> None:
    assert len((REPOSITORY / "README.md").read_text(encoding="utf-8").split()) <= README_WORDS
    # What make gallery writes, and the keys of files, which are looked up.
    written = [path for path in DOCS.glob("*.md") if path.name not in ("gallery.md", "toml.md")]
    assert sum(len(path.read_text(encoding="utf-8").split()) for path in written) <= DOCS_WORDS


class Targets(HTMLParser):
    """Links, pictures, scripts and anchors of a page of HTML."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: list[str] = []
        self.loaded: list[str] = []
        self.anchors: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        found = dict(attrs)
        self.anchors.add(found.get("id") or "")
        for key in ("href", "src"):
            target = found.get(key)
            if target and not target.startswith("data:"):
                (self.links if tag == "a" else self.loaded).append(target)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("mkdocs", reason="mkdocs is not installed: make site")
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--quiet", "--site-dir", str(folder)]
    answer = subprocess.run(command, cwd=REPOSITORY, capture_output=True, text=True)
    assert answer.returncode == 0, answer.stderr
    return folder


@pytest.mark.soak
def test_every_link_of_the_site_leads_somewhere_and_nothing_comes_from_elsewhere(site: Path) -> None:
    pages = {
        path: Targets(path.read_text(encoding="utf-8")) for path in site.rglob("*.html") if path.name != "404.html"
    }
    assert len(pages) > 25
    for path, targets in pages.items():
        assert [target for target in targets.loaded if re.match(r"(https?:)?//", target)] == []
        for target in [*targets.links, *targets.loaded]:
            if re.match(r"[a-z]+:", target):
                continue
            file, _, anchor = unquote(target).partition("#")
            there = (path.parent / file).resolve() if file else path
            assert there.exists(), f"{path.name} links to {target}"
            if anchor and there in pages:
                assert anchor in pages[there].anchors, f"{path.name}: {target} has no such heading"


@pytest.mark.soak
def test_the_first_page_is_light(site: Path) -> None:
    page = site / "index.html"
    loaded = {(site / target).resolve() for target in Targets(page.read_text(encoding="utf-8")).loaded}
    fetched = [page, *(path for path in loaded if path.is_file()), site / "search" / "search_index.json"]
    assert sum(path.stat().st_size for path in fetched) <= FIRST_PAGE


def test_pages_of_notebooks_show_their_outputs() -> None:
    pytest.importorskip("mkdocs", reason="mkdocs is not installed: make site")
    from tools.site_pages import notebook_page

    page = Page(Path("x.md"), notebook_page(REPOSITORY / "examples" / "notebook.ipynb"))
    assert page.text.startswith("# hhsim in a notebook") and "````python\nimport matplotlib" in page.text
