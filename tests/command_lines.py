"""Whether `hhsim` would take a line as its help shows it, without running it."""

import importlib
import shlex
from typing import Any
from unittest.mock import patch

import click

hhsim: click.Group = importlib.import_module("hhsim.cli.main").hhsim


def parse(line: str) -> dict[str, Any]:
    """Parse a line such as `hhsim replay cube pinch --level 3  # a remark`; files need not exist, nor a viewer.

    Returns:
        The command's parameters by name; none of a line that asks for help.

    Raises:
        click.ClickException, HhsimError: As the command line would tell: no such command, option or choice, a value
            out of range, too many or too few words.
    """
    words = shlex.split(line, comments=True)
    if ">" in words:
        words = words[: words.index(">")]
    assert words[0] == "hhsim", line
    command: click.Command = hhsim
    context = click.Context(hhsim, info_name="hhsim", **hhsim.context_settings)
    rest = words[1:]
    while isinstance(command, click.Group) and rest and not rest[0].startswith("-"):
        name, found, rest = command.resolve_command(context, rest)
        assert found is not None
        context = click.Context(found, context, name)
        command = found
    with patch("hhsim.view.sink.check_target"):
        try:
            return command.make_context(context.info_name, rest, context.parent).params
        except click.exceptions.Exit as done:
            assert done.exit_code == 0, line
            return {}
