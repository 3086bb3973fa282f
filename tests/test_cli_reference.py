"""The help texts, and the page docs/cli.md that is made of them."""

import importlib
import inspect
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click
import pytest
from command_lines import parse, shown_lines

from hhsim.errors import HhsimError

Run = Callable[..., Any]

reference: Callable[[], str] = importlib.import_module("hhsim.cli.reference").reference
COMMANDS: dict[str, Any] = {found.path: found for found in importlib.import_module("hhsim.cli.reference").commands()}
HELP_OPTION = "-h,--helpShowthismessageandexit."


def squashed(text: str) -> str:
    """Without what folding and Markdown change: white space, backticks, backslashes."""
    return re.sub(r"[\s`\\]", "", text)


def section(path: str) -> str:
    """What the page says of a command, without the marks of lists and blocks."""
    (text,) = re.findall(rf"(?ms)^## {re.escape(path)}\n(.*?)(?=^## |\Z)", reference())
    text = re.sub(r"(?m)^```(text|console)?$|^\$ ", "", text)
    text = re.sub(r"(?m)^- \[`[^`]* ([^` ]+)`\]\(#[\w-]+\): ", r"\1 ", text)
    return re.sub(r"(?m)^- `([^`]+)`: ", r"\1 ", text)


def options_of(found: Any) -> list[click.Option]:
    return [parameter for parameter in found.command.params if isinstance(parameter, click.Option)]


@pytest.mark.parametrize("path", COMMANDS)
def test_a_section_says_what_help_prints(run: Run, path: str) -> None:
    answer = run(*path.split()[1:], "--help")
    assert (answer.code, answer.err) == (0, "")
    printed = squashed(answer.out).removeprefix("Usage:").replace(HELP_OPTION, "")
    assert squashed(section(path)) == re.sub(r"Options:(?=$|Commands:|Suites:)", "", printed)


def test_the_page_has_a_section_for_every_command_and_links_that_lead_there() -> None:
    headings = re.findall(r"(?m)^## (hhsim.*)$", reference())
    assert headings == list(COMMANDS)
    anchors = {heading.replace(" ", "-") for heading in headings}
    links = re.findall(r"\]\(#([\w-]+)\)", reference())
    assert len(links) > 20 and set(links) <= anchors


@pytest.mark.parametrize("path", COMMANDS)
def test_the_examples_come_last_and_can_be_run(path: str) -> None:
    text = inspect.cleandoc(COMMANDS[path].command.help or "")
    # That of hhsim itself begins with what to start with, and ends with the exit codes.
    block, heading = (1, "Start with:") if path == "hhsim" else (-1, "Examples:")
    mark, title, *lines = text.split("\n\n")[block].splitlines()
    assert (mark, title) == ("\b", heading)
    assert lines[0].strip().startswith(path)
    for line in lines:
        parse(line.strip().split("  ")[0])


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("hhsim replya", "did you mean replay"),
        ("hhsim bench papre", "did you mean paper"),
        ("hhsim replay cube pinch never", "unexpected extra argument"),
        ("hhsim replay --metod coupled", "No such option"),
        ("hhsim replay --method couple", "is not one of"),
        ("hhsim replay --threads 0", "not in the range"),
        ("hhsim replay --tremor 1", "expected 2 numbers"),
        ("hhsim verify", "Missing argument"),
    ],
)
def test_a_line_that_hhsim_refuses_is_refused_here(line: str, told: str) -> None:
    with pytest.raises((click.ClickException, HhsimError)) as error:
        parse(line)
    said = error.value.format_message() if isinstance(error.value, click.ClickException) else str(error.value)
    assert told in said


def test_the_lines_of_the_page_can_be_run(repository: Path) -> None:
    lines = list(shown_lines(repository / "docs" / "cli.md"))
    assert len(lines) > 60
    for line in lines:
        parse(line)
