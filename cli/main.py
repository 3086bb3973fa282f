"""The `hhsim` command: a group that imports a command only when it is run, and the one place where errors are told."""

import importlib
import json
import os
import sys

import click

from hhsim import __version__
from hhsim.errors import HhsimError, UnknownNameError

COMMANDS = {
    "replay": "Replay a hand motion against an object, every tick measured.",
    "objects": "List the objects that come with hhsim.",
    "trajectories": "List the trajectories that come with hhsim.",
    "build-tree": "Build the sphere tree of an object and measure its error.",
    "info": "Show versions, processor, clock and what is missing.",
    "completion": "Print the script that completes hhsim commands in a shell.",
}
"""Every command with its one line; the module of a command is its name with underscores, and holds `command`."""

COMPLETION_VARIABLE = "_HHSIM_COMPLETE"
INTERRUPTED = 130
BROKEN_PIPE = 141


class LazyGroup(click.Group):
    """A group whose help needs none of its commands' modules."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names in the order of the table."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import the command."""
        if cmd_name not in COMMANDS:
            return None
        module = importlib.import_module(f".{cmd_name.replace('-', '_')}", __package__)
        command: click.Command = module.command
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the command, or name the near ones."""
        if args and args[0] not in COMMANDS and not args[0].startswith("-"):
            raise UnknownNameError("command", args[0], COMMANDS)
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the table of commands."""
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))


@click.group(cls=LazyGroup, invoke_without_command=True, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, message="hhsim %(version)s")
@click.pass_context
def hhsim(context: click.Context) -> None:
    """Replay a hand against a virtual object, and measure speed, contact and force at every tick.

    \b
    Start with:
      hhsim replay                    a five-finger grasp of the bunny
      hhsim replay cube pinch         another object, another motion
      hhsim replay mug.stl --unit mm  your own mesh

    Every command takes --json for machines. Exit codes: 0 ok, 1 a limit was missed, 2 usage or bad input, 3 cannot
    compare.
    """
    if context.invoked_subcommand is None:
        click.echo(context.get_help())


def main() -> None:
    """Run the command line and exit: the entry point."""
    wanted = os.environ.get(COMPLETION_VARIABLE)
    if wanted:
        from click.shell_completion import shell_complete

        sys.exit(shell_complete(hhsim, {}, "hhsim", COMPLETION_VARIABLE, wanted))
    try:
        code = _run()
        sys.stdout.flush()
    except HhsimError as error:
        code = _told(_with_notes(str(error), error), error.exit_code)
    except click.UsageError as error:
        command = error.ctx.command_path if error.ctx else "hhsim"
        code = _told(f"{error.format_message().rstrip('.')} (see {command} --help)", error.exit_code)
    except click.ClickException as error:
        code = _told(error.format_message(), error.exit_code)
    except KeyboardInterrupt as interrupt:
        code = _told(_with_notes("interrupted", interrupt), INTERRUPTED)
    except BrokenPipeError:
        # The reader has left: what is still buffered must not raise again when the interpreter closes stdout.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code = BROKEN_PIPE
    except OSError as error:
        place = f": {error.filename}" if error.filename else ""
        code = _told(f"{error.strerror or error}{place}", HhsimError.exit_code)
    sys.exit(code)


def _run() -> int:
    try:
        with hhsim.make_context("hhsim", sys.argv[1:]) as context:
            answer = hhsim.invoke(context)
    except click.exceptions.Exit as done:
        return done.exit_code
    return answer if isinstance(answer, int) else 0


def _with_notes(message: str, error: BaseException) -> str:
    return "; ".join([message, *getattr(error, "__notes__", ())])


def _told(message: str, code: int) -> int:
    """Tell an error: one line on stderr and, for machines, one JSON document on stdout."""
    line = " ".join(message.split())
    print(f"hhsim: {line}" if code == INTERRUPTED else f"hhsim: error: {line}", file=sys.stderr)
    if "--json" in sys.argv:
        print(json.dumps({"error": line}, ensure_ascii=False), flush=True)
    return code
