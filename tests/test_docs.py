"""The documentation's links, command lines, names and code blocks: what a reader follows or types exists."""

import ast
import importlib
import importlib.metadata
import importlib.util
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from urllib.parse import unquote

import click
import pytest
from conftest import REPOSITORY
from markdown_pages import Page, pages

from hhsim.mesh.catalogue import body_file_names, object_names
from hhsim.scene.motion_catalogue import trajectory_names

(POINT,) = importlib.metadata.entry_points(group="console_scripts", name="hhsim")
HHSIM: click.Group = importlib.import_module(POINT.module).hhsim
PAGES = pages(REPOSITORY)

PLACEHOLDER = re.compile(r"[A-ZΑ-Ω_|0-9.]+|.*(…|\.\.\.).*|[A-Z].*[A-Z]")
"""What stands for a value of the reader's own: OBJECT, N, results/…-bunny.h5."""
OTHERS_OPTIONS = {"--bind"}
"""Long options in code spans that are of other programs."""


def on_every_page(check: Callable[[Page], None]) -> Callable[[], None]:
    """Make a test of what holds on a page."""

    def test() -> None:
        for page in PAGES:
            check(page)

    return test


@on_every_page
def test_every_link_and_anchor_exists(page: Page) -> None:
    for target in page.links():
        if re.match(r"[a-z]+:", target):
            assert target.startswith("https://"), target
            continue
        file, _, anchor = unquote(target).partition("#")
        there = (page.path.parent / file).resolve() if file else page.path
        assert there.exists(), f"{page.path.name} links to {target}, which is not there"
        assert there.is_relative_to(REPOSITORY), target
        if anchor:
            assert anchor in Page.read(there).anchors(), f"{page.path.name}: {target} has no such heading"


NAMED_LINK = re.compile(r"\[`(\w+)`\]\(([^()\s]+\.py)\)")
"""A link on what a Python file defines."""


@on_every_page
def test_what_a_link_names_is_defined_in_the_file_it_leads_to(page: Page) -> None:
    for name, target in NAMED_LINK.findall(page.text):
        defined = {
            bound
            for node in ast.parse((page.path.parent / target).read_text(encoding="utf-8")).body
            for bound in (
                [node.name]
                if isinstance(node, ast.FunctionDef | ast.ClassDef)
                else [part.id for part in ast.walk(node) if isinstance(part, ast.Name)]
            )
        }
        assert name in defined, f"{page.path.name}: {target} has no {name}"


def test_the_index_names_every_page() -> None:
    index = Page.read(REPOSITORY / "docs" / "README.md")
    listed = {target.partition("#")[0] for target in index.links()}
    there = {path.relative_to(REPOSITORY / "docs").as_posix() for path in (REPOSITORY / "docs").rglob("*.md")}
    there -= {"README.md", *(page.path.name for page in PAGES if page.is_moved)}
    assert there <= listed, f"docs/README.md does not list {sorted(there - listed)}"


def test_the_page_of_commands_names_each_of_them() -> None:
    named = Page.read(REPOSITORY / "docs" / "cli.md").spans()
    assert set(HHSIM.list_commands(click.Context(HHSIM))) <= set(named)


def test_the_table_of_tools_names_each_of_them() -> None:
    text = (REPOSITORY / "CONTRIBUTING.md").read_text(encoding="utf-8")
    named = set(re.findall(r"`(\w+)`", text[text.index("## Tools") : text.index("## Habits")]))
    there = {path.stem for path in (REPOSITORY / "tools").iterdir() if not path.name.startswith("_")}
    assert named == there


def test_every_picture_of_the_docs_is_shown_and_says_what_it_shows() -> None:
    pictures = {".png", ".svg", ".gif"}
    shown = {Path(target).name for page in PAGES for target in page.links() if Path(target).suffix in pictures}
    assert {path.name for path in (REPOSITORY / "docs").iterdir() if path.suffix in pictures} == shown
    for page in PAGES:
        for alt in re.findall(r"!\[([^\]]*)\]", page.prose):
            assert len(alt) > 30, f"{page.path.name}: a picture has the text '{alt}'"


def _check_command(call: list[str], complete: bool) -> None:
    """Walk down the groups; then the options must exist, and values of closed sets be members."""
    words = [word for word in call if word != "…"]
    command: click.Command = HHSIM
    context = click.Context(command, info_name="hhsim", **command.context_settings)
    while isinstance(command, click.Group) and words and not words[0].startswith("-"):
        name = words.pop(0)
        if PLACEHOLDER.fullmatch(name):
            return
        found = command.get_command(context, name)
        assert found is not None, f"there is no command {name}"
        command, context = found, click.Context(found, info_name=name, parent=context)
    if not complete and words and words[-1].startswith("--"):
        # A code span may name an option and leave its value away.
        last = words.pop()
        assert last in {*_options(command, context), "--help"}, f"{command.name} has no option {last}"
    values, left, _ = command.make_parser(context).parse_args(list(words))
    assert not left, f"{command.name} takes no {left}"
    for parameter in command.params:
        value = values.get(parameter.name or "")
        given = value if isinstance(value, (list, tuple)) else [value]
        for text in given:
            if not isinstance(text, str) or PLACEHOLDER.fullmatch(text):
                continue
            kind = parameter.type
            if isinstance(kind, (click.Choice, click.types.FloatParamType)) or kind.name == "read_method":
                kind(text, parameter, context)
            elif isinstance(parameter, click.Argument) and not {".", "/"} & set(text):
                if parameter.name == "trajectory":
                    assert text in trajectory_names(), f"there is no trajectory {text}"
                elif parameter.name in ("object", "object_"):
                    assert text in (*object_names(), *body_file_names()), f"there is no object {text}"
    if complete:
        for parameter in command.params:
            if isinstance(parameter, click.Argument) and parameter.required:
                argument = values.get(parameter.name or "")
                assert isinstance(argument, (str, tuple)) and argument, f"{command.name} lacks an argument"


@on_every_page
def test_every_command_line_can_be_typed(page: Page) -> None:
    calls = [(call, True) for call in page.typed_calls("hhsim")] + [(call, False) for call in page.named_calls("hhsim")]
    for call, complete in calls:
        try:
            _check_command(call, complete)
        except (click.ClickException, AssertionError) as error:
            message = error.format_message() if isinstance(error, click.ClickException) else str(error)
            pytest.fail(f"{page.path.name}: hhsim {' '.join(call)}: {message}")


def test_a_command_line_that_cannot_be_typed_is_found() -> None:
    for line in ("replya", "replay --levle 3", "replay bunyn", "replay cube grab", "replay --method best", "gate x y"):
        with pytest.raises((click.ClickException, AssertionError)):
            _check_command(line.split(), complete=True)
    with pytest.raises(AssertionError, match="lacks an argument"):
        _check_command(["verify"], complete=True)
    _check_command(["verify"], complete=False)
    _check_command(["replay", "OBJECT", "whole-hand", "--level", "L"], complete=True)


def _options(command: click.Command, context: click.Context) -> Iterator[str]:
    for parameter in command.params:
        if isinstance(parameter, click.Option):
            yield from (*parameter.opts, *parameter.secondary_opts)
    if isinstance(command, click.Group):
        for name in command.list_commands(context):
            found = command.get_command(context, name)
            assert found is not None
            yield from _options(found, click.Context(found, info_name=name, parent=context))


def test_every_option_that_is_named_exists() -> None:
    known = {*_options(HHSIM, click.Context(HHSIM)), "--help", *OTHERS_OPTIONS}
    # What is run as `python -m hhsim.…` or `python -m tools.…` parses its own options.
    for path in (*(REPOSITORY / "hhsim").rglob("*.py"), *(REPOSITORY / "tools").rglob("*.py")):
        source = path.read_text(encoding="utf-8")
        if "add_argument(" in source:
            known |= set(re.findall(r"[\"'](--[a-z][a-z-]+)[\"']", source))
    for page in PAGES:
        for span in page.spans():
            for option in re.findall(r"(?:^| )(--[a-z][a-z-]+)", span):
                assert option in known, f"{page.path.name} names {option}, which no command has"


@on_every_page
def test_every_module_that_is_run_exists(page: Page) -> None:
    for call in [*page.typed_calls("python"), *page.named_calls("python")]:
        if call[:1] == ["-m"] and not PLACEHOLDER.fullmatch(call[1]):
            spec = importlib.util.find_spec(call[1])
            assert spec is not None and spec.origin is not None, f"{page.path.name}: no module {call[1]}"
            if call[1].startswith("hhsim"):
                assert "__main__" in Path(spec.origin).read_text(encoding="utf-8"), f"{call[1]} is no program"


NAMED_FILE = re.compile(r"(?:hhsim|tests|cli|objects|trajectories|examples|docs)/[\w./-]+|hhsim-gate\.toml|\w+\.md")


@on_every_page
def test_every_file_that_is_named_exists(page: Page) -> None:
    for span in page.spans():
        for name in NAMED_FILE.findall(span):
            if NAMED_FILE.fullmatch(span):
                assert (REPOSITORY / name).exists(), f"{page.path.name} names {name}"


@on_every_page
def test_every_dotted_name_exists(page: Page) -> None:
    for span in page.spans():
        if re.fullmatch(r"hhsim(\.\w+)+", span):
            module, _, name = span.rpartition(".")
            if importlib.util.find_spec(module) and hasattr(importlib.import_module(module), name):
                continue
            assert importlib.util.find_spec(span), f"{page.path.name} names {span}"


@on_every_page
def test_tables_are_rectangles(page: Page) -> None:
    # A row with a cell too many or too few is shown as text, or cut off.
    for table in re.split(r"\n(?!\|)", page.prose):
        rows = [row for row in table.splitlines() if row.startswith("|")]
        widths = {len(re.findall(r"(?<!\\)\|", re.sub(r"`[^`]*`", "", row))) for row in rows}
        assert len(widths) <= 1, f"{page.path.name}: {rows[0]}"
