"""`hhsim help`."""

import click

from hhsim.errors import UnknownNameError

from .arguments.written import Command


@click.command(cls=Command)
@click.argument("words", metavar="[COMMAND]...", nargs=-1)
@click.pass_context
def command(context: click.Context, words: tuple[str, ...]) -> None:
    """Show the help of hhsim, or of a command.

    \b
    Examples:
      hhsim help
      hhsim help replay
      hhsim help bench recorded
    """
    parent = context.find_root()
    found: click.Command = parent.command
    for word in words:
        if not isinstance(found, click.Group):
            raise click.UsageError(f"{parent.command_path} has no command '{word}': hhsim help {parent.info_name}")
        inner = found.get_command(parent, word)
        if inner is None:
            raise UnknownNameError("command", word, found.list_commands(parent))
        parent = click.Context(inner, parent, word, **inner.context_settings)
        found = inner
    click.echo(found.get_help(parent))
