"""The help texts, and the page that is made of them."""

import importlib
import inspect
import re
from collections.abc import Callable, Iterator
from typing import Any

import click
import pytest
from command_lines import parse

from hhsim.hand.fingers import FINGERS

reference: Callable[[], str] = importlib.import_module("tools.cli_reference").reference
COMMANDS: dict[str, Any] = {found.path: found for found in importlib.import_module("tools.cli_reference").commands()}
help_sections: Callable[..., Any] = importlib.import_module("hhsim.cli.arguments.command").help_sections


def test_the_page_has_a_section_for_every_command_and_links_that_lead_there() -> None:
    headings = re.findall(r"(?m)^## (hhsim.*)$", reference())
    assert headings == list(COMMANDS)
    anchors = {heading.replace(" ", "-") for heading in headings}
    links = re.findall(r"\]\(#([\w-]+)\)", reference())
    assert len(links) > 20 and set(links) <= anchors


def test_the_examples_come_last_and_can_be_run() -> None:
    for path in COMMANDS:
        text = inspect.cleandoc(COMMANDS[path].command.help or "")
        # That of hhsim itself begins with what to start with, and ends with the exit codes.
        block, heading = (1, "Start with:") if path == "hhsim" else (-1, "Examples:")
        mark, title, *lines = text.split("\n\n")[block].splitlines()
        assert (mark, title) == ("\b", heading)
        assert lines[0].strip().startswith(path)
        for line in lines:
            parse(line.strip().split("  ")[0])


def library_defaults() -> Iterator[tuple[str, str, str]]:
    """Command, option and what the library takes where the option is not given, as the help should spell it."""
    from hhsim.gate.suite import default_suite
    from hhsim.live.gloves import configure
    from hhsim.live.session import setup as live_setup
    from hhsim.solver import options as solver_options

    usual, paper = (solver_options.SolverOptions(method=method) for method in ("coupled", "paper"))
    coupling = solver_options.Stiffness()
    for name in ("margin", "linearisations"):
        scale = 1e3 if name == "margin" else 1
        numbers = [f"{scale * getattr(options, name):g}" for options in (usual, paper)]
        yield "hhsim replay", f"--{name}", f"{numbers[0]}; {numbers[1]} with --method paper"
    yield "hhsim replay", "--force", f"{usual.force}; {paper.force} with --method paper"
    yield "hhsim replay", "--stiffness", f"{coupling.translation:g},{coupling.rotation:g},{coupling.flexion:g}"
    yield "hhsim replay", "--penalty-stiffness", f"{coupling.penalty:.0f}"
    yield "hhsim replay", "--tolerance", f"{usual.tolerance:g}".replace("e-0", "e-")
    yield "hhsim replay", "--frustum-ends", usual.frustum_ends
    yield "hhsim replay", "--budget", f"{1e-6 * usual.budget / usual.period:g} units a microsecond of the period"
    assert usual.fingers == FINGERS
    yield "hhsim gate", "--processes", f"as the suite says, else {default_suite().time.processes}"
    served: list[Any] = [(kind, configure(kind).options) for kind in ("dexmo", "openxr", "udp")]
    ports = ", ".join(f"{options.port} for {kind}" for kind, options in served)
    yield "hhsim live glove", "--port", ports
    yield "hhsim live glove", "--stiffness", f"{live_setup.OutputLimits().stiffness[0]:g}"


def test_the_defaults_that_are_told_are_those_of_the_library() -> None:
    for path, name, value in library_defaults():
        (option,) = (option for option in COMMANDS[path].command.params if name in option.opts)
        assert option.help.endswith(f"Default: {value}."), (path, name, option.help)


def test_lists_take_commas_or_the_option_again() -> None:
    suite = "hhsim bench speed-error"
    assert parse(suite)["methods"] is None and parse(suite)["levels"] is None
    for words in ("--method paper,coupled", "--method paper --method coupled", "--method 'paper, coupled,paper'"):
        assert parse(f"{suite} {words}")["methods"] == ("paper", "coupled")
    assert parse(f"{suite} --level 4,3 --level 4 --level 5")["levels"] == (4, 3, 5)
    for words, message in (
        ("--method paper,", "'paper,', expected names with commas"),
        ("--level 3,x", "expected whole"),
    ):
        with pytest.raises(click.BadParameter, match=message):
            parse(f"{suite} {words}")
