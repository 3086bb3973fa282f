"""Options of `hhsim live glove` for the gloves and their settings."""

from collections.abc import Iterator
from dataclasses import MISSING, Field, fields
from types import NoneType
from typing import Any, get_args

import click
from click.core import ParameterSource

from hhsim.live.devices.registry import GLOVES, Setting

from ..arguments.option_group import OptionGroup, option
from ..arguments.options import Number


class GloveChoice(OptionGroup, heading="Glove"):
    """Glove and its settings, which are fields of the subclass that `glove_choice` makes."""

    device: str

    def settings(self) -> dict[str, Any]:
        """Return the settings on the command line; raises click.UsageError for one that only other gloves have."""
        context = click.get_current_context()
        found = {}
        for name, gloves in _by_name().items():
            if context.get_parameter_source(name) is not ParameterSource.COMMANDLINE:
                continue
            if self.device in gloves:
                found[name] = getattr(self, name)
            else:
                (flag,) = (parameter.opts[0] for parameter in context.command.params if parameter.name == name)
                raise click.UsageError(f"{flag} is for --device {' or '.join(gloves)}, not {self.device}")
        return found


def glove_choice() -> type[GloveChoice]:
    """Make the options: --device, the settings that several gloves have, then each glove's own."""
    about = "; ".join(f"{name}: {GLOVES[name].about}" for name in GLOVES)
    device = option("--device", type=click.Choice(list(GLOVES)), default="sim", help=f"{about}.")
    options = {"device": device, **dict(_settings())}
    return type("KnownGloves", (GloveChoice,), {"__annotations__": dict.fromkeys(options, Any), **options})


def _settings() -> Iterator[tuple[str, Any]]:
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
        shown = default not in ("", None)
        kind = _type(item, setting)
        yield (
            name,
            option(*setting.flags, type=kind, default=default, show_default=shown, metavar=setting.metavar, help=text),
        )


def _by_name() -> dict[str, dict[str, Field[Any]]]:
    """Return each setting: its gloves, and its declaration there."""
    found: dict[str, dict[str, Field[Any]]] = {}
    for glove in GLOVES:
        for item in fields(GLOVES[glove].options):
            if "setting" in item.metadata:
                assert item.default is not MISSING, f"{glove}: {item.name} has no default"
                found.setdefault(item.name, {})[glove] = item
    return found


def _type(item: Field[Any], setting: Setting) -> Any:
    (kind,) = [kind for kind in get_args(item.type) or (item.type,) if kind is not NoneType]
    if setting.choices:
        return click.Choice(setting.choices)
    if setting.least is not None and setting.most is not None:
        least, most = setting.least, setting.most
        return click.IntRange(int(least), int(most)) if kind is int else Number(least, most)
    return click.Path() if setting.metavar == "FILE" else kind
