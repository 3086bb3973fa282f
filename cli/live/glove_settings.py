"""Options of `hhsim live glove` for the gloves and their settings."""

import re
from collections.abc import Container, Iterator, Mapping
from dataclasses import MISSING, Field, fields
from types import MappingProxyType, NoneType
from typing import Annotated, Any, get_args

import click

from hhsim.live.gloves import GLOVES, Setting

from ..arguments.command import FILE, Number, OptionGroup, is_typed, option
from ..arguments.options import HANDS

Worn = dict[str, tuple[str, str]]
"""Name of the glove on each hand, and its own options as text."""


class Gloves(click.Choice[str]):
    """A glove's name, or `Worn` from left=NAME,right=NAME."""

    _one = r"(\w+)=(\w+)(?:\[([^\]]*)\])?"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the name, or both hands' gloves; fails for text that is neither."""
        if not isinstance(value, str) or "=" not in value:
            return super().convert(value, param, ctx)
        found = re.findall(self._one, value)
        if not re.fullmatch(f"{self._one}(?:,{self._one})*", value):
            self.fail(
                f"{value!r} is not left=NAME,right=NAME, with a glove's own options as NAME[port=5010].", param, ctx
            )
        sides = [side for side, _, _ in found]
        if sorted(sides) != sorted(HANDS):
            self.fail(f"{value!r} has a glove for {' and '.join(sides)}: expected one left, one right.", param, ctx)
        return {side: (super(Gloves, self).convert(name, param, ctx), own) for side, name, own in found}


class GloveChoice(OptionGroup, heading="Glove"):
    """Glove, or `Worn`, and the settings of all gloves by name."""

    device: Any
    named: Mapping[str, Any]

    @classmethod
    def parameters(cls) -> Iterator[click.Parameter]:
        """Yield --device, the settings that several gloves have, then each glove's own."""
        about = "; ".join(f"{name}: {GLOVES[name].about}" for name in GLOVES)
        two = "Two gloves: left=NAME,right=NAME, each with options of its own if need be, as left=udp[port=24171]"
        device = option(f"{about}. {two}.", default="sim")
        yield device.parameter("device", Annotated[Any, Gloves(list(GLOVES))], cls.heading)
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
            made = option(text, setting.metavar, default=default, show_default=default not in ("", None))
            yield made.parameter(name, Annotated[Any, _type(item, setting)], cls.heading)

    @classmethod
    def of_values(cls, values: dict[str, Any]) -> "GloveChoice":
        """Return the record of the glove and all settings."""
        return cls(device=values.pop("device"), named=values)

    @property
    def two(self) -> bool:
        """True for a glove on each hand: `device` is `Worn`."""
        return isinstance(self.device, dict)

    def settings(self, device: str, own: Mapping[str, Any] = MappingProxyType({})) -> dict[str, Any]:
        """Return a glove's settings, its `own` and those typed; click.UsageError for one that others alone have."""
        context = click.get_current_context()
        chosen = dict.fromkeys(name for name, _ in self.device.values()) if self.two else {device: None}
        found = dict(own)
        for name, gloves in _by_name().items():
            if not is_typed(context, name):
                continue
            if device in gloves:
                found.setdefault(name, self.named[name])
            elif not any(other in gloves for other in chosen):
                flag = _option(context, name).opts[0]
                raise click.UsageError(f"{flag} is for --device {' or '.join(gloves)}, not {' or '.join(chosen)}")
        return found


def own_options(device: str, text: str, others: Container[str]) -> dict[str, Any]:
    """Return the options of one of two gloves, NAME=VALUE with commas between: its settings and `others`, by field.

    Raises click.UsageError for an option that it has not, or a value out of range.
    """
    context = click.get_current_context()
    found: dict[str, Any] = {}
    for part in re.split(r",(?=[a-z-]+=)", text) if text else ():
        flag, _, value = part.partition("=")
        name = next((each.name for each in context.command.params if f"--{flag}" in each.opts), None)
        if name is None or (device not in _by_name().get(name, ()) and name not in others):
            raise click.UsageError(f"{device}[{text}]: {device} has no option of its own '{flag}'")
        found[name] = _option(context, name).process_value(context, value)
    return found


def _option(context: click.Context, name: str) -> click.Parameter:
    (found,) = (parameter for parameter in context.command.params if parameter.name == name)
    return found


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
    return FILE if setting.metavar == "FILE" else kind
