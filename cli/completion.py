"""`hhsim completion`."""

import click

from .arguments.written import Command


@click.command(cls=Command)
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
@click.pass_context
def command(context: click.Context, shell: str) -> None:
    """Print the script that completes hhsim commands in a shell.

    It completes commands, options, and the names of objects and trajectories, once it lies where the shell looks for
    such scripts.

    \b
    Examples:
      hhsim completion bash > ~/.local/share/bash-completion/completions/hhsim
      hhsim completion zsh > ~/.zfunc/_hhsim
      hhsim completion fish > ~/.config/fish/completions/hhsim.fish
    """
    from click.shell_completion import get_completion_class

    from .main import COMPLETION_VARIABLE

    maker = get_completion_class(shell)
    assert maker is not None, shell
    click.echo(maker(context.find_root().command, {}, "hhsim", COMPLETION_VARIABLE).source())
