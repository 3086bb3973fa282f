"""Every option that takes a number refuses an absurd one while the command line is read, in one line with its range."""

import importlib
from itertools import product
from typing import Any

import click
import numpy as np
import pytest
from free_scenes import body_of, box

from hhsim.errors import InputError
from hhsim.ranges import RANGES, check_range
from hhsim.scene.body import Free, HalfSpace
from hhsim.solver.options import NUMBERS, SolverOptions, Stiffness

COMMANDS: list[Any] = list(importlib.import_module("tools.cli_reference").commands())

ABSURD = (
    *("0", "-1", "nan", "inf", "-inf", "5e-324", "1e-300", "-1e300", "1e300"),
    *("9223372036854775808", "-9223372036854775809", "99999999999999999999"),
)
WORDS = {
    *("--method", "--fingers", "--qp", "--object", "--motion", "--surface", "--columns", "--name"),
    *("--source", "--licence", "--format", "--object-track", "--array", "--profile", "--host", "--pose-host"),
    *("--scheduler", "--rerun", "--trajectory", "--palm-axes", "--link"),
}
"""Options whose texts hold no number."""
SMALL = "a number from 0 on may be as small as it likes"
OFF = "0 is none at all"
TINY = {"--friction", "--table-friction", "--torsion", "--tremor"}
SIGNED = {"--table", "--palm", "--palm-turn"}
FINE = {
    **{(name, value): why for name in TINY for value, why in (("0", OFF), ("5e-324", SMALL), ("1e-300", SMALL))},
    **{(name, value): "a place on an axis" for name in SIGNED for value in ("0", "-1", "5e-324", "1e-300")},
    **{(name, value): "a stamp [s]" for name in ("--from", "--to") for value in ("0", "-1", "5e-324", "1e-300")},
    **{("live --stiffness", value): "0 is a free finger" for value in ("0", "5e-324", "1e-300")},
    **{(name, "0"): "they count from 0" for name in ("--seed", "--episode", "--device-id", "--cpu")},
    ("--cpu", "-1"): "any processor",
}
"""Why a value is none that is absurd, by the option."""


def test_absurd_numbers_are_refused_in_one_line() -> None:
    options = [
        (found, option)
        for found in COMMANDS
        for option in found.command.params
        if isinstance(option, click.Option) and not (option.is_flag or option.is_eager or option.opts[0] in WORDS)
        if not isinstance(option.type, click.Choice | click.Path)
    ]
    assert len(options) > 100
    for (found, option), value in product(options, ABSURD):
        name = option.opts[0]
        name = "live --stiffness" if found.path == "hhsim live glove" and name == "--stiffness" else name
        # Of an option that takes several numbers, the count is not known here.
        for text in (",".join([value] * count) for count in (1, 2, 3, 4, 5)):
            try:
                option.process_value(found.context, (text,) if option.multiple else text)
            except click.UsageError as error:
                assert error.exit_code == 2
                assert "\n" not in error.format_message(), (value, error.format_message())
            else:
                assert (name, value) in FINE, f"{text} is taken by {found.path} {name}"
                break
        else:
            assert (name, value) not in FINE, f"{value} is refused by {found.path} {name}"


def test_every_option_that_is_named_here_is_one() -> None:
    there = {option for found in COMMANDS for parameter in found.command.params for option in parameter.opts}
    named = {name.removeprefix("live ") for name, _ in FINE} | WORDS
    assert named <= there, named - there


BODY: dict[str, Any] = {
    "mass": 0.1,
    "center": (0.0, 0.0, 0.0),
    "inertia": ((1e-4, 0.0, 0.0), (0.0, 1e-4, 0.0), (0.0, 0.0, 1e-4)),
}
VECTORS = ("gravity", "velocity", "angular_velocity")
TAKEN = (
    *NUMBERS,
    *("mass", "friction", "torsion", "damping", "table", "table_friction", *VECTORS),
    *(name for name in RANGES if name.startswith("stiffness ")),
)


def give(name: str, value: Any) -> object:
    """Make the record of the library that has a number of this name."""
    if name in NUMBERS:
        return SolverOptions(method="progressive", **{name: value})
    if name.startswith("stiffness "):
        return Stiffness(**{name.removeprefix("stiffness "): value})
    if name in ("table", "table_friction"):
        return HalfSpace("table", **{"height": 0.0, "height" if name == "table" else "friction": value})
    if name in ("friction", "torsion"):
        return body_of(box((0.05, 0.05, 0.05)), **{name: value})
    return Free(**{**BODY, name: (value,) * 3 if name in VECTORS else value})


@pytest.mark.parametrize("name", TAKEN)
def test_the_library_refuses_what_the_command_line_refuses(name: str) -> None:
    least, greatest, *_ = RANGES[name]
    for value in (float("nan"), float("inf"), -float("inf"), 1e300, -1e300, 10**400, "1", True):
        with pytest.raises(InputError, match=f"{name} is .*: expected {least:g} to") as caught:
            give(name, value)
        assert len(str(caught.value)) < 200
    if name not in ("margin", "offset"):
        # Of these two, one has to be ten times the other.
        give(name, greatest if isinstance(greatest, int) else float(greatest))
    assert type(check_range(name, least)) is type(greatest)


def test_numbers_of_options_have_the_type_that_kernels_are_compiled_for() -> None:
    two: Any = np.int64(2)
    given = SolverOptions(method="progressive", margin=5, threads=two, stiffness=Stiffness(translation=500))
    assert (given.margin, type(given.margin), type(given.threads)) == (5.0, float, int)
    assert type(given.stiffness.translation) is float
    assert given == SolverOptions(method="progressive", margin=5.0, threads=2, stiffness=Stiffness(translation=500.0))
