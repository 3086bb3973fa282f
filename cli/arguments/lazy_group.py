"""A click group whose help imports none of its commands."""

import importlib
from collections.abc import Callable, Mapping
from typing import Any

import click

from hhsim.errors import InputError, UnknownNameError


class LazyGroup(click.Group):
    """A group that imports a command when it is run.

    `lines` has every command with its one line, `module` the module of a command, `kind` what its commands are called,
    and `meant` advice for words that are no command.
    """

    def __init__(
        self,
        name: str | None = None,
        lines: Mapping[str, str] | None = None,
        module: Callable[[str], str] = lambda name: name.replace("-", "_"),
        kind: str = "command",
        meant: Mapping[str, str] | None = None,
        **options: Any,
    ) -> None:
        super().__init__(name, **options)
        if lines is not None:
            self.lines = lines
        self.module = module
        self.kind = kind
        self.meant = meant or {}

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names in the order of the help."""
        return list(self.lines)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import the command."""
        if cmd_name not in self.lines:
            return None
        found: click.Command = importlib.import_module(f"..{self.module(cmd_name)}", __package__).command
        return found

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the command, or raise an error that names the near ones."""
        if args and args[0] not in self.lines and not args[0].startswith("-"):
            if args[0] in self.meant:
                raise InputError(f"unknown {self.kind} '{args[0]}': {self.meant[args[0]]}")
            raise UnknownNameError(self.kind, args[0], self.lines)
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the table of commands."""
        with formatter.section(f"{self.kind.capitalize()}s"):
            formatter.write_dl(list(self.lines.items()))


@click.pass_context
def show_help(context: click.Context) -> None:
    """Show a group's help where no command was named."""
    if context.invoked_subcommand is None:
        click.echo(context.get_help())
