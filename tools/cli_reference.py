"""Print the help of every command as one Markdown page: `python -m tools.cli_reference > reference.md`."""

import inspect
import re
import textwrap
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import click

# cli/ installs as hhsim.cli, where mypy does not look for it.
from hhsim.cli.arguments.command import LazyGroup, help_sections  # type: ignore[import-not-found]
from hhsim.cli.main import hhsim  # type: ignore[import-not-found]

WIDTH = 120
BEGIN = """\
# Every command

Every command, argument and option, as `--help` prints them. [What all commands share](cli.md): options, exit codes,
variables, and what an output replaces.
"""


class CommandHelp(NamedTuple):
    """A command, its path such as `hhsim live glove`, and the context that its help is made in."""

    path: str
    command: click.Command
    context: click.Context


def commands(
    command: click.Command = hhsim, name: str = "hhsim", parent: click.Context | None = None
) -> Iterator[CommandHelp]:
    """Yield every command, a group before its own, in the order of the help."""
    context = click.Context(command, parent, name, **command.context_settings)
    yield CommandHelp(context.command_path, command, context)
    if isinstance(command, LazyGroup):
        for inner in command.list_commands(context):
            found = command.get_command(context, inner)
            assert found is not None, inner
            yield from commands(found, inner, context)


def reference() -> str:
    """Return the whole page, in Markdown."""
    return "\n".join([BEGIN, *(_section(found) for found in commands())])


def _section(found: CommandHelp) -> str:
    usage = found.command.get_usage(found.context).removeprefix("Usage: ")
    paragraphs = inspect.cleandoc(found.command.help or "").split("\n\n")
    parts = [f"## {found.path}", _block("text", [" ".join(usage.split())]), *map(_paragraph, paragraphs)]
    for heading, records in help_sections(found.command, found.context).items():
        # Without --help, which all commands share.
        items = [_item(*record) for record in records if not record[0].endswith("--help")]
        if items:
            parts += [f"{heading}:", "\n".join(items)]
    if isinstance(found.command, LazyGroup):
        anchor = found.path.replace(" ", "-")
        members = found.command.lines().items()
        lines = [f"- [`{found.path} {name}`](#{anchor}-{name}): {line}" for name, line in members]
        parts += [f"{found.command.kind.capitalize()}s:", "\n".join(lines)]
    return "\n\n".join(parts) + "\n"


def _paragraph(text: str) -> str:
    """Return a docstring's paragraph; one after click's mark for "do not fold" is a heading and lines as they are."""
    if not text.startswith("\b"):
        # A dash or a plus at the begin of a line would begin a list.
        return re.sub(r"(?m)^(?=[-+*#] )", r"\\", _folded(_marked(" ".join(text.split()))))
    heading, *lines = text.removeprefix("\b").strip("\n").splitlines()
    if heading == "Examples:":
        return f"{heading}\n\n{_block('console', [f'$ {line.strip()}' for line in lines])}"
    return f"{heading}\n\n{_block('text', [line.strip() for line in lines])}"


def _block(language: str, lines: Sequence[str]) -> str:
    return "\n".join([f"```{language}", *lines, "```"])


def _item(option: str, help: str) -> str:
    return _folded(f"- `{option}`: {_marked(' '.join(help.split()))}", indent="  ")


def _marked(text: str) -> str:
    """Return the text with its options set as code."""
    return re.sub(r"(?<![\w-])(--[a-z][\w-]*)", r"`\1`", text)


def _folded(text: str, indent: str = "") -> str:
    return textwrap.fill(text, WIDTH, subsequent_indent=indent, break_on_hyphens=False, break_long_words=False)


if __name__ == "__main__":
    print(reference(), end="")
