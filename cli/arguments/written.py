"""Types of options that name what a command writes, and commands that keep hhsim's rule for outputs."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from hhsim.view.sink import RerunTarget


class WrittenPath(click.Path):
    """Path of a file or a folder that a command writes."""


class WrittenWord(click.types.StringParamType):
    """Word that may be the path of a file that a command writes, as of --rerun."""


OUTPUT = WrittenPath(path_type=Path)


class Command(click.Command):
    """A command that writes neither on its inputs nor through links, `hhsim.system.output_path` has the rule.

    Outputs are the parameters of the types above; whatever else of the command line names a file is an input.
    """

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command; raise OutputError, or UsageError for two outputs of one name, before it does anything."""
        from hhsim.system.output_path import keeping, require_apart

        inputs: list[Path] = []
        outputs: dict[Path, tuple[Path, str]] = {}
        for parameter in self.params:
            for path in _paths(ctx.params.get(parameter.name or "")):
                if not isinstance(parameter.type, WrittenPath | WrittenWord):
                    inputs.append(path)
                elif (before := outputs.setdefault(path.absolute(), (path, parameter.opts[0])))[0] is not path:
                    raise click.UsageError(f"{before[1]} and {parameter.opts[0]} both name {path}: name two files")
        with keeping(inputs):
            for path, _ in outputs.values():
                require_apart(path)
            return super().invoke(ctx)


def _paths(value: Any) -> Iterator[Path]:
    """Yield what may be paths in the value of a parameter."""
    if isinstance(value, str | Path):
        yield Path(value)
    elif isinstance(value, tuple | list):
        for each in value:
            yield from _paths(each)
    elif hasattr(value, "path"):
        yield from _paths(value.path)


RERUN = WrittenWord()
RERUN_METAVAR = "spawn|FILE.rrd|connect[=URL]"


def read_target(context: click.Context, parameter: click.Parameter, value: str | None) -> "RerunTarget | None":
    """Read `spawn`, FILE.rrd, `connect` or `connect=URL` of --rerun, and check at once that it can work."""
    if value is None:
        return None
    from hhsim.view.sink import check_target, parse_target

    target = parse_target(value)
    check_target(target)
    return target
