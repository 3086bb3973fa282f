"""Commands whose options are the parameters of a function or fields of a class, and groups that import them when run.

The type of a parameter says its kind: `Literal` a choice, `bool` a flag, `Path` a file that is read, and `Annotated` a
kind of click's, a range of msgspec's, or a function that reads the text.
"""

import importlib
import inspect
from collections.abc import Callable, Container, Iterator, Mapping
from dataclasses import dataclass, fields
from functools import wraps
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, ClassVar, Literal, Union, dataclass_transform, get_args, get_origin, get_type_hints

import click
from click.core import ParameterSource

from hhsim.errors import UnknownNameError

FILE = click.Path(path_type=Path)
MOST_COUNT = 1_000_000_000
OTHERS = "Other options"
MOST_OPTIONS = 15
"""Number of options up to which they stand under one heading."""


class WrittenPath(click.Path):
    """Path of a file or a folder that a command writes."""


class Number(click.FloatRange):
    """A number from `min` to `max`; NaN is refused too."""

    def _describe_range(self) -> str:
        return f"{self.min:g}<=x<={self.max:g}"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Return the number, or fail."""
        found = float(super().convert(value, param, ctx))
        if found != found:
            self.fail(f"{value} is not in the range {self._describe_range()}.", param, ctx)
        return found


@dataclass(frozen=True)
class Declared:
    """An option or an argument before it has a name."""

    flags: tuple[str, ...]
    settings: dict[str, Any]
    is_argument: bool = False

    def parameter(self, name: str, hint: Any, heading: str = OTHERS) -> click.Parameter:
        """Return click's parameter of this name, of the kind that the type says."""
        if self.is_argument:
            return click.Argument([name], type=click_type(hint), **self.settings)
        settings = {"is_flag": True} if hint is bool else {"type": click_type(hint)}
        made = click.Option([*(self.flags or (f"--{name.replace('_', '-')}",)), name], **settings | self.settings)
        made.heading = heading  # type: ignore[attr-defined]
        return made


def option(help: str = "", metavar: str | None = None, *flags: str, **settings: Any) -> Any:
    """Declare an option, spelled like its name where no flags are given; other settings as of click.Option."""
    return Declared(flags, {"help": help, "metavar": metavar, **settings})


def argument(metavar: str | None = None, **settings: Any) -> Any:
    """Declare an argument; settings as of click.Argument."""
    return Declared((), {"metavar": metavar, **settings}, is_argument=True)


def click_type(hint: Any) -> Any:
    """Return what reads the text of an option of this type: a type of click's, or a function."""
    if get_origin(hint) in (Union, UnionType):
        (hint,) = (each for each in get_args(hint) if each is not NoneType)
    if get_origin(hint) is Literal:
        return click.Choice(get_args(hint))
    if get_origin(hint) is tuple:
        return click_type(get_args(hint)[0])
    if get_origin(hint) is not Annotated:
        return FILE if hint is Path else hint
    kind, said = get_args(hint)[:2]
    if not hasattr(said, "ge"):
        return said
    return click.IntRange(int(said.ge), int(said.le)) if kind is int else Number(said.ge, said.le)


@dataclass_transform(frozen_default=True, kw_only_default=True, field_specifiers=(option,))
class OptionGroup:
    """Options under one heading: a frozen dataclass, each of whose fields has an `option` for a default."""

    heading: ClassVar[str] = OTHERS

    def __init_subclass__(cls, heading: str = "") -> None:
        cls.heading = heading or cls.heading
        dataclass(frozen=True, kw_only=True)(cls)

    @classmethod
    def parameters(cls) -> Iterator[click.Parameter]:
        """Yield the options."""
        hints = get_type_hints(cls, include_extras=True)
        record: Any = cls
        for field in fields(record):
            declared: Any = field.default
            yield declared.parameter(field.name, hints[field.name], cls.heading)

    @classmethod
    def of_values(cls, values: dict[str, Any]) -> "OptionGroup":
        """Return the record of the values of these options."""
        return cls(**values)

    def given(self) -> dict[str, Any]:
        """Return the fields that are not None: those of the command line, and those with a default."""
        return {name: value for name, value in vars(self).items() if value is not None}


class Command(click.Command):
    """A command of many options has a heading for each group of them; none writes on its inputs nor through links.

    `hhsim.system.output_path` has that rule. Outputs are the parameters of the types above; whatever else of the
    command line names a file is an input.
    """

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options under their headings."""
        for heading, records in help_sections(self, ctx).items():
            with formatter.section(heading):
                formatter.write_dl(records)

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command; raise OutputError, or UsageError for two outputs of one name, before it does anything."""
        from hhsim.system.output_path import keeping, require_apart

        inputs: list[Path] = []
        outputs: dict[Path, tuple[Path, str]] = {}
        for parameter in self.params:
            for path in _paths(ctx.params.get(parameter.name or "")):
                if not isinstance(parameter.type, WrittenPath):
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


def make_command(function: Callable[..., Any], *more: click.Parameter) -> Command:
    """Return the command of a function: of its parameters, which are declared or groups of options, and of some more.

    Groups come as records of their class.
    """
    hints, params = get_type_hints(function, include_extras=True), list(more)
    groups: dict[str, tuple[type[OptionGroup], list[str]]] = {}
    for name, each in inspect.signature(function).parameters.items():
        if isinstance(each.default, Declared):
            params.append(each.default.parameter(name, hints[name]))
        elif each.kind is not inspect.Parameter.VAR_KEYWORD:
            own = list(hints[name].parameters())
            groups[name] = hints[name], [each.name or "" for each in own]
            params += own

    @wraps(function)
    def callback(**values: Any) -> Any:
        for name, (group, names) in groups.items():
            values[name] = group.of_values({each: values.pop(each) for each in names})
        return function(**values)

    return Command(None, callback=callback, params=params, help=function.__doc__)


def help_sections(command: click.Command, context: click.Context) -> dict[str, list[tuple[str, str]]]:
    """Return each option's help by heading; one heading for all of a command of few options."""
    options = [each for each in command.get_params(context) if isinstance(each, click.Option)]
    # The option --help is one more.
    grouped = len(options) - 1 > MOST_OPTIONS
    sections: dict[str, list[tuple[str, str]]] = {}
    for each in options:
        if record := each.get_help_record(context):
            sections.setdefault(getattr(each, "heading", OTHERS) if grouped else "Options", []).append(record)
    return sections


def is_typed(context: click.Context, name: str) -> bool:
    """Return True for a parameter that the command line gives."""
    return context.get_parameter_source(name) is ParameterSource.COMMANDLINE


def refuse_typed(why: str, *, names: Container[str] = (), but: Container[str] | None = None) -> None:
    """Raise UsageError, "OPTION WHY", for a typed option of these `names`, or of all `but` some."""
    context = click.get_current_context()
    for parameter in context.command.params:
        name = parameter.name or ""
        if is_typed(context, name) and (name in names or (but is not None and name not in but)):
            typed_as = parameter.opts[0]
            raise click.UsageError(f"{typed_as if typed_as.startswith('-') else typed_as.upper()} {why}")


class LazyGroup(click.Group):
    """A group whose help imports none of its commands.

    `lines` returns every command with its one line, `find` imports or makes one, and `kind` is what its commands are
    called.
    """

    def __init__(
        self,
        name: str,
        lines: Callable[[], Mapping[str, str]],
        find: Callable[[str], click.Command],
        kind: str = "command",
        callback: Callable[..., Any] | None = None,
        **options: Any,
    ) -> None:
        super().__init__(name, invoke_without_command=True, callback=callback or show_help, **options)
        self.lines, self.find, self.kind = lines, find, kind

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names in the order of the help."""
        return list(self.lines())

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import the command."""
        return self.find(cmd_name) if cmd_name in self.lines() else None

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the command, or raise an error that names the near ones."""
        if args and args[0] not in self.lines() and not args[0].startswith("-"):
            raise UnknownNameError(self.kind, args[0], self.lines())
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the table of commands."""
        with formatter.section(f"{self.kind.capitalize()}s"):
            formatter.write_dl(list(self.lines().items()))


def imported(module: str) -> click.Command:
    """Return the command of a module of `hhsim.cli`."""
    found: click.Command = importlib.import_module(f"..{module}", __package__).command
    return found


@click.pass_context
def show_help(context: click.Context) -> None:
    """Show a group's help where no command was named."""
    if context.invoked_subcommand is None:
        click.echo(context.get_help())
