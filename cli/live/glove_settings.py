"""Options of `hhsim live glove` that follow from the gloves: which there are, and what each can be set to."""

from collections.abc import Callable, Iterator
from dataclasses import MISSING, Field, fields
from types import NoneType
from typing import Any, get_args

import click

from hhsim.live.devices.registry import Setting, find_glove, glove_names

Command = Callable[..., Any]


def glove_options(command: Command) -> Command:
    """Add --device, then the settings that several gloves have, each once, then each glove's own."""
    for option in reversed([_device(), *_settings()]):
        command = option(command)
    return command


def given_settings(context: click.Context, device: str) -> dict[str, Any]:
    """The settings of a glove that the command line names.

    Raises:
        click.UsageError: One that only another glove has.
    """
    found = {}
    for name, gloves in _by_name().items():
        if context.get_parameter_source(name) is not click.core.ParameterSource.COMMANDLINE:
            continue
        if device in gloves:
            found[name] = context.params[name]
        elif len(gloves) == 1:
            (option,) = (parameter.opts[0] for parameter in context.command.params if parameter.name == name)
            raise click.UsageError(f"{option} is for --device {next(iter(gloves))}, not {device}")
    return found


def _device() -> Command:
    about = "; ".join(f"{name}: {find_glove(name).about}" for name in glove_names())
    return click.option(
        "--device", type=click.Choice(glove_names()), default="sim", show_default=True, help=f"{about}."
    )


def _settings() -> Iterator[Command]:
    for name, gloves in sorted(_by_name().items(), key=lambda item: len(item[1]) == 1):
        item = next(iter(gloves.values()))
        setting: Setting = item.metadata["setting"]
        text = f"{setting.text} [{setting.unit}]." if setting.unit else f"{setting.text}."
        default = item.default
        if len(gloves) == 1:
            text = f"With --device {next(iter(gloves))}: {text[0].lower()}{text[1:]}"
        elif len({other.default for other in gloves.values()}) > 1:
            text += f" Default: {', '.join(f'{other.default} for {glove}' for glove, other in gloves.items())}."
            default = None
        yield click.option(
            *(setting.flags or (f"--{name.replace('_', '-')}",)),
            name,
            type=_type(item, setting),
            default=default,
            show_default=default not in ("", None),
            metavar=setting.metavar,
            help=text,
        )


def _by_name() -> dict[str, dict[str, Field[Any]]]:
    """Each setting that is asked for: of which gloves, and how it is declared there."""
    found: dict[str, dict[str, Field[Any]]] = {}
    for glove in glove_names():
        for item in fields(find_glove(glove).options):
            if "setting" in item.metadata:
                assert item.default is not MISSING, f"{glove}: {item.name} has no default"
                found.setdefault(item.name, {})[glove] = item
    return found


def _type(item: Field[Any], setting: Setting) -> Any:
    (kind,) = [kind for kind in get_args(item.type) or (item.type,) if kind is not NoneType]
    if (setting.least, setting.most) != (None, None):
        bounded: Any = click.IntRange if kind is int else click.FloatRange
        return bounded(setting.least, setting.most)
    return click.Path() if setting.metavar == "FILE" else kind
