"""What a program may rely on: arguments and members of the stable names, options of commands, names of datasets.

`stable_names.txt` has them as they are: `python tests/test_stable_names.py > tests/stable_names.txt` adds what is new.
What is to go warns first (docs/python-api.md), and leaves it with the next major version.
"""

import importlib
import importlib.metadata
import inspect
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import click

import hhsim
from hhsim.result import schema

KEPT = Path(__file__).with_name("stable_names.txt")
MARKS = {inspect.Parameter.VAR_POSITIONAL: "*", inspect.Parameter.VAR_KEYWORD: "**"}


def arguments(call: Callable[..., Any]) -> str:
    """The arguments of a call: `=` after those that have a default, those by name alone after `*`."""
    words: list[str] = []
    for each in inspect.signature(call).parameters.values():
        if each.kind is inspect.Parameter.KEYWORD_ONLY and not any(word.startswith("*") for word in words):
            words.append("*")
        words.append(MARKS.get(each.kind, "") + each.name + ("" if each.default is inspect.Parameter.empty else "="))
    return f"({', '.join(word for word in words if word != 'self' and not word.startswith('_'))})"


def members(kind: type) -> Iterator[str]:
    """What a class has that hhsim gave it."""
    if not issubclass(kind, BaseException):
        yield arguments(kind)
    own = [base for base in kind.__mro__ if base.__module__.startswith("hhsim")]
    names = {name for base in own for name in (*vars(base), *inspect.get_annotations(base))}
    for name in sorted(name for name in names if not name.startswith("_")):
        found = getattr(kind, name, None)
        yield name + (arguments(found) if inspect.isfunction(found) or inspect.ismethod(found) else "")


def options(command: click.Command, words: str) -> Iterator[tuple[str, str]]:
    """Options and arguments of a command and of those below it."""
    if isinstance(command, click.Group):
        context = click.Context(command)
        for name in command.list_commands(context):
            below = command.get_command(context, name)
            assert below is not None
            yield from options(below, f"{words} {name}")
    yield words, " ".join(sorted(word for each in command.params for word in (*each.opts, *each.secondary_opts)))


def stable() -> dict[str, str]:
    found: dict[str, str] = {}
    for name in hhsim.__all__:
        thing = getattr(hhsim, name)
        found[name] = " ".join(members(thing)) if inspect.isclass(thing) else arguments(thing)
    (point,) = importlib.metadata.entry_points(group="console_scripts", name="hhsim")
    found |= dict(options(importlib.import_module(point.module).hhsim, "hhsim"))
    tables = [schema.sample_columns(-1), *(each for each in vars(schema).values() if isinstance(each, tuple))]
    found["datasets"] = " ".join(
        sorted({one.name for each in tables for one in each if isinstance(one, schema.Column)})
    )
    return {name: text for name, text in found.items() if text}


def test_what_a_program_relies_on_is_there_and_what_is_new_is_noted() -> None:
    # In a process of its own: other tests add gloves and formats to this one, whose options commands then have.
    told = subprocess.run([sys.executable, __file__], check=True, capture_output=True, text=True)
    assert told.stdout.splitlines() == KEPT.read_text(encoding="utf-8").splitlines()


if __name__ == "__main__":
    print(*(f"{name}: {text}" for name, text in stable().items()), sep="\n")
