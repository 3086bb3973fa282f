"""Print the help of every command as one Markdown page: `python -m tools.cli_reference > reference.md`."""

import inspect
import re
import textwrap
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import click

# cli/ installs as hhsim.cli, where mypy does not look for it.
from hhsim.cli.arguments.option_group import help_sections  # type: ignore[import-not-found]
from hhsim.cli.lazy_group import LazyGroup  # type: ignore[import-not-found]
from hhsim.cli.main import hhsim  # type: ignore[import-not-found]

WIDTH = 120
BEGIN = """\
# The command line

Every command, argument and option, as `--help` prints them; `python -m tools.cli_reference` made this page of them.

## What all commands share

- `-h`, `--help`: what a command does, its options, and examples that can be run.
- `--json`: stdout is one JSON document in SI units (m, rad, s, N) and nothing else; a number that is missing is `null`,
  an error is `{"error": "…"}`. Without it, tables are in mm, µm and µs, with the unit in the heading.
- `--out FILE`: where the output goes. Without it, a dated name in `results/` under the current folder. An existing file
  is replaced only if it is of the same kind, and only when the new one is complete; an input, and what a symbolic
  link leads to, never ([the rule](cli.md#what-an-output-replaces)).
- `-q`, `--quiet`: no progress and no table. Errors, warnings and missed limits still show.
- Progress goes to stderr, and only where that is a terminal. A table in a pipe is plain text, one line a row.
- An option that takes NAMES or NUMBERS takes them with commas, `--object bunny,cube`, or again and again, `--object
  bunny --object cube`.
- OBJECT is a name (`hhsim objects`) or a mesh file; TRAJECTORY is a name (`hhsim trajectories`), a script or a
  recording; RESULT is a file that `hhsim replay` or `hhsim live` wrote.

| exit code | what it says |
|---|---|
| 0 | done, and every limit was kept |
| 1 | done, and a limit was missed; the text of the command says which limits it has |
| 2 | wrong usage or bad input: stderr has one line with what is wrong, where, and what would be right |
| 3 | `hhsim gate`: the two sides cannot be compared |
| 130 | Ctrl-C; a replay keeps the ticks so far |
| 141 | whoever read the output has left |

| variable | what it does |
|---|---|
| `HHSIM_CACHE_DIR` | folder of compiled kernels and sphere trees; nobody else may write it. Default: `~/.cache/hhsim` |
| `NO_COLOR` | tables without colours |
| `COLUMNS` | the width that a table is folded to in a terminal |
| `NUMBA_DISABLE_JIT` | `1` runs the kernels as plain Python: to debug them, and much slower |
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
        members = found.command.lines.items()
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
