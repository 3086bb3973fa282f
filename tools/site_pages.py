"""Pages of the site that are no file of docs/, and links that lead out of docs/: the hook of mkdocs.yml.

`make site` builds the site. Links between pages are those that GitHub follows in the checkout. A file outside docs/
that a page links to becomes a page of its own, so that the site needs no other host.
"""

import importlib.metadata
import json
import posixpath
import re
import shutil
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

import hhsim
from tools.cli_reference import reference
from tools.gallery import page_to_turn

REPOSITORY = Path(__file__).resolve().parent.parent
FRONT = "README.md"
PAGES = {
    "README.md": FRONT,
    "docs/README.md": FRONT,
    "ARCHITECTURE.md": "architecture.md",
    "CHANGELOG.md": "changelog.md",
    "CONTRIBUTING.md": "contributing.md",
    "SECURITY.md": "security.md",
    "examples/README.md": "examples.md",
}
"""Pages of the site by files of the repository that are elsewhere."""
LINK = re.compile(r"(\]\()([^()\s:#]+)((?:#[^()\s]*)?\))")
FENCE = re.compile(r"(^ *```.*?^ *```$)", re.MULTILINE | re.DOTALL)
LANGUAGES = {".py": "python", ".sh": "bash", ".yml": "yaml", ".toml": "toml", ".cpp": "cpp", ".h": "cpp", ".hpp": "cpp"}
UNSEARCHED = "---\nsearch:\n  exclude: true\n---\n\n"
"""Begin of a page that is not in the index of the search, which browsers fetch with the first page."""
BINARY = {".stl", ".h5"}
MATHJAX = "assets/mathjax"
MATHJAX_SCRIPTS = """\
<script>window.MathJax = {{tex: {{inlineMath: [["\\\\(", "\\\\)"]], displayMath: [["\\\\[", "\\\\]"]]}},
options: {{ignoreHtmlClass: ".*", processHtmlClass: "arithmatex", enableMenu: false}}}};</script>
<script defer src="{root}{mathjax}/tex-chtml.js"></script>
</body>"""

API = """\
# Python

`import hhsim` gives these names, each imported at its first use. This page is for whoever calls hhsim from a program;
[the examples](../examples/README.md#hhsim-from-python) show them at work.

Units are SI: m, rad, s, N, N·m. The world is right-handed with z up.

"""


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages that are made: of the command line, of Python, of notebooks, of files outside docs/."""
    made: dict[str, str | bytes] = {"commands.md": reference(), "python.md": _api()}
    for source, uri in PAGES.items():
        if uri != FRONT:
            made[uri] = (UNSEARCHED if "/" not in source else "") + (REPOSITORY / source).read_text(encoding="utf-8")
    for file in list(files):
        if file.src_uri.endswith(".ipynb"):
            made[_page_of("docs/" + file.src_uri)] = notebook_page(Path(file.abs_src_path or ""))
            files.remove(file)
        elif file.src_uri.endswith(".glb"):
            files.append(File.generated(config, _page_of("docs/" + file.src_uri), content=page_to_turn(file.name)))
            files.remove(file)
    texts = {uri: text for uri, text in made.items() if isinstance(text, str)}
    texts[FRONT] = (REPOSITORY / FRONT).read_text(encoding="utf-8")
    texts |= {file.src_uri: file.content_string for file in files.documentation_pages() if file.src_uri not in texts}
    for uri, text in texts.items():
        for _, target, _ in LINK.findall(FENCE.sub("", text)):
            source = posixpath.normpath(posixpath.join(_folder(uri), target))
            page = _page_of(source)
            if page.startswith("source/") and page not in made and (REPOSITORY / source).exists():
                made[page] = _source_page(source)
    for uri, content in made.items():
        files.append(File.generated(config, uri, content=content))
    return files


def on_page_read_source(page: Page, config: MkDocsConfig) -> str | None:
    """Return the README as the first page."""
    return (REPOSITORY / FRONT).read_text(encoding="utf-8") if page.file.src_uri == FRONT else None


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Return the page with its links leading to pages of the site."""
    uri = page.file.src_uri

    def moved(found: re.Match[str]) -> str:
        source = posixpath.normpath(posixpath.join(_folder(uri), found[2]))
        return found[1] + posixpath.relpath(_page_of(source), posixpath.dirname(uri) or ".") + found[3]

    if uri.startswith("source/"):
        return markdown
    parts = FENCE.split(markdown)
    return "".join(part if number % 2 else LINK.sub(moved, part) for number, part in enumerate(parts))


def on_post_page(output: str, page: Page, config: MkDocsConfig) -> str:
    """Return a page with a name for its search, and with MathJax if it has formulas."""
    output = _named(output)
    if 'class="arithmatex"' not in output:
        return output
    root = "../" * page.url.count("/")
    return output.replace("</body>", MATHJAX_SCRIPTS.format(root=root, mathjax=MATHJAX))


def on_post_template(output: str, template_name: str, config: MkDocsConfig) -> str:
    """Return a page that is made of no Markdown, 404.html, with a name for its search."""
    return _named(output)


def _named(output: str) -> str:
    return output.replace('role="dialog"', 'role="dialog" aria-label="Search"')


def on_post_build(config: MkDocsConfig) -> None:
    """Copy MathJax and its fonts from their package into the site."""
    package = importlib.metadata.distribution("sphinx-mathjax-offline")
    held = Path(str(package.locate_file("sphinx-mathjax-offline/static/mathjax")))
    fonts = "output/chtml/fonts/woff-v2"
    there = Path(config.site_dir) / MATHJAX
    shutil.copytree(held / fonts, there / fonts, dirs_exist_ok=True)
    shutil.copy(held / "tex-chtml.js", there)


def _api() -> str:
    return API + "\n".join(f"::: hhsim.{name}\n" for name in hhsim.__all__)


def _folder(uri: str) -> str:
    """Return the folder of the repository that links of a page start from."""
    for source, page in PAGES.items():
        if page == uri:
            return posixpath.dirname(source)
    return posixpath.dirname(f"docs/{uri}")


def _page_of(source: str) -> str:
    """Return the page, or file of the site, that a file of the repository becomes."""
    if source in PAGES:
        return PAGES[source]
    if source.startswith("docs/"):
        return re.sub(r"\.ipynb$", ".md", source.removeprefix("docs/")).replace(".glb", ".html")
    return f"source/{source}" if Path(source).suffix in BINARY else f"source/{source}.md"


def _source_page(source: str) -> str | bytes:
    path = REPOSITORY / source
    if path.suffix in BINARY:
        return path.read_bytes()
    paths = sorted(one for one in path.iterdir() if one.is_file()) if path.is_dir() else [path]
    parts = [UNSEARCHED + f"# {source}\n"]
    for one in paths:
        parts += [f"## {one.name}\n"] if path.is_dir() else []
        if one.suffix == ".ipynb":
            return notebook_page(one)
        parts.append(_fence(LANGUAGES.get(one.suffix, "text"), one.read_text(encoding="utf-8")))
    return "\n".join(parts)


def notebook_page(path: Path) -> str:
    """Return a notebook as Markdown, with the outputs that it holds."""
    parts: list[str] = []
    for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]:
        text = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            parts.append(text)
            continue
        in_shell = text.startswith("!")
        parts.append(_fence("console", re.sub(r"(?m)^!", "$ ", text)) if in_shell else _fence("python", text))
        for output in cell["outputs"]:
            data = output.get("data", {})
            if "image/png" in data:
                picture = "".join(data["image/png"]).replace("\n", "")
                alt = cell["metadata"].get("alt", "Picture that the cell above draws")
                parts.append(f"![{alt}](data:image/png;base64,{picture})")
            else:
                parts.append(_fence("text", "".join(output.get("text", data.get("text/plain", "")))))
    return "\n\n".join(parts)


def _fence(language: str, text: str) -> str:
    return f"````{language}\n{text.rstrip()}\n````\n"
