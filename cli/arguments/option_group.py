"""Groups of options: a record of them is one argument of a command, and has a heading in its help."""

from collections.abc import Callable, Container
from dataclasses import dataclass, fields
from functools import wraps
from typing import Any, ClassVar, dataclass_transform

import click
from click.core import ParameterSource

from .written import Command

Decorator = Callable[[Callable[..., Any]], Callable[..., Any]]
OTHERS = "Other options"


def option(*flags: str, **settings: Any) -> Any:
    """Declare an option as a field of a group; arguments as of click.option, spelled like the field by default."""
    return lambda name: click.option(*(flags or (f"--{name.replace('_', '-')}",)), name, **settings)


def shared(decorator: Decorator) -> Any:
    """Declare an option that other commands take alone as a field of a group."""
    return lambda name: decorator


@dataclass_transform(frozen_default=True, kw_only_default=True, field_specifiers=(option, shared))
class OptionGroup:
    """Options under one heading: a frozen dataclass, each of whose fields has an `option` for a default."""

    heading: ClassVar[str] = OTHERS

    def __init_subclass__(cls, heading: str = "") -> None:
        cls.heading = heading or cls.heading
        dataclass(frozen=True, kw_only=True)(cls)

    @classmethod
    def argument(cls, name: str) -> Decorator:
        """Decorate a command with these options, which it takes as one argument of this name."""
        record: Any = cls

        def decorate(command: Callable[..., Any]) -> Callable[..., Any]:
            @wraps(command)
            def with_record(*arguments: Any, **values: Any) -> Any:
                values[name] = record(**{field.name: values.pop(field.name) for field in fields(record)})
                return command(*arguments, **values)

            for field in reversed(fields(record)):
                field.default(field.name)(with_record)
                with_record.__dict__["__click_params__"][-1].heading = cls.heading
            return with_record

        return decorate

    def given(self) -> dict[str, Any]:
        """Return the fields that are not None: those of the command line, and those with a default."""
        return {name: value for name, value in vars(self).items() if value is not None}


def typed_options(context: click.Context) -> dict[str, str]:
    """Return the options and arguments that the command line gives, by their parameter's name: as they are typed."""
    return {
        parameter.name or "": parameter.opts[0]
        for parameter in context.command.params
        if context.get_parameter_source(parameter.name or "") is ParameterSource.COMMANDLINE
    }


def refuse_typed(why: str, *, names: Container[str] = (), but: Container[str] | None = None) -> None:
    """Raise UsageError, "OPTION WHY", for a typed option of these `names`, or of all `but` some."""
    for name, typed_as in typed_options(click.get_current_context()).items():
        if name in names or (but is not None and name not in but):
            raise click.UsageError(f"{typed_as} {why}")


class GroupedCommand(Command):
    """A command of many options, whose help has a heading for each group of them."""

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options under their headings."""
        for heading, records in help_sections(self, ctx).items():
            with formatter.section(heading):
                formatter.write_dl(records)


def help_sections(command: click.Command, context: click.Context) -> dict[str, list[tuple[str, str]]]:
    """Return each option's help by heading; one heading for all where the command is not grouped."""
    grouped = isinstance(command, GroupedCommand)
    sections: dict[str, list[tuple[str, str]]] = {}
    for parameter in command.get_params(context):
        record = parameter.get_help_record(context) if isinstance(parameter, click.Option) else None
        if record is not None:
            heading = getattr(parameter, "heading", OTHERS) if grouped else "Options"
            sections.setdefault(heading, []).append(record)
    return sections
