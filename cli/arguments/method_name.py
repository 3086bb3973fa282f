"""The option that names a method: one of hhsim's own, of an installed package, or a class in a module."""

import click
from click.shell_completion import CompletionItem

from hhsim.errors import UnknownNameError
from hhsim.solver.method import METHODS

isolate = click.option(
    "--isolate",
    is_flag=True,
    help="Run a method from outside in its own process; isolated: before its name says the same.",
)


class MethodName(click.ParamType[str]):
    """A name that `hhsim methods` lists, or `package.module:Class`."""

    name = "method"

    def get_metavar(self, param: click.Parameter, ctx: click.Context) -> str:
        """Return hhsim's own methods by name for the help."""
        return f"[{'|'.join(METHODS.names())}|NAME]"

    def convert(self, value: str, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return the name, or fail; a class is judged when it is imported."""
        if value not in METHODS and ":" not in value:
            from hhsim.solver.method_names import method_names

            if value not in method_names():
                self.fail(str(UnknownNameError("method", value, method_names())), param, ctx)
        return value

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        """Complete the names."""
        from hhsim.solver.method_names import method_names

        return [CompletionItem(name) for name in method_names() if name.startswith(incomplete)]
