"""Kinds of values, and options that several commands share."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import click

from hhsim.ranges import RANGES
from hhsim.table.table import Table

from ..console import announce_compilation, print_json, print_line, print_table
from .command import MOST_COUNT, Number, OptionGroup, WrittenPath, option

Count = Annotated[int, click.IntRange(1, MOST_COUNT)]
Jobs = Annotated[int, click.IntRange(1, 4096)]
OneLevel = Annotated[int, click.IntRange(1, 5)]
AnySeed = Annotated[int, click.IntRange(0, 2**63 - 1)]
OutPath = Annotated[Path, WrittenPath(path_type=Path)]
"""Path of a file or a folder that the command writes."""
Unit = Literal["m", "cm", "mm", "inch"]
Side = Literal["right", "left"]
Sides = Literal["right", "left", "both"]
HANDS: tuple[Side, Side] = ("right", "left")
"""Both, in the order of a file of two hands."""


class RerunWord(WrittenPath):
    """spawn, FILE.rrd, connect or connect=URL; it is checked at once that it can work, and parsed again by the view."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the word, or raise an HhsimError."""
        from hhsim.view import sink

        sink.check_target(sink.parse_target(value))
        return value


Rerun = Annotated[str, RerunWord()]
RERUN = "spawn|FILE.rrd|connect[=URL]"


DIGITS = 20
"""Digits from which on a whole number is refused unread."""


def refuse(value: str, expected: str) -> click.BadParameter:
    """Return the error for the text of an option."""
    return click.BadParameter(f"'{value}', expected {expected}")


def _numbers(value: str) -> tuple[float, ...]:
    """Return numbers with commas between; none where one of them is no number."""
    try:
        return tuple(float(part) for part in value.split(","))
    except ValueError:
        return ()


def number_list(*meanings: str, ranges: Sequence[tuple[float, float]]) -> Callable[[str], tuple[float, ...]]:
    """Return the reader of an option such as --stiffness 1000,5,0.5: numbers by meanings with unit, and ranges."""

    def read(value: str) -> tuple[float, ...]:
        numbers = _numbers(value)
        in_range = all(least <= number <= most for number, (least, most) in zip(numbers, ranges))
        if len(numbers) != len(meanings) or not in_range:
            each = [f"{meaning} {least:g} to {most:g}" for meaning, (least, most) in zip(meanings, ranges)]
            raise refuse(value, f"{len(meanings)} numbers with commas between: {', '.join(each)}")
        return numbers

    return read


def one_or_five(value: str) -> tuple[float, ...]:
    """Read one number from 0 to 1 for all fingers, or five."""
    numbers = _numbers(value)
    numbers = numbers * 5 if len(numbers) == 1 else numbers
    if len(numbers) != 5 or not all(0.0 <= number <= 1.0 for number in numbers):
        raise refuse(value, "0 (free) to 1, or five of that")
    return numbers


def read_names(context: click.Context, parameter: click.Parameter, value: Sequence[str]) -> tuple[str, ...] | None:
    """Read names with commas between: the callback of an option that may be given again."""
    parts = [part.strip() for given in value for part in given.split(",")]
    if not all(parts):
        raise refuse(",".join(value), "names with commas between")
    return tuple(dict.fromkeys(parts)) or None


def counts_reader(least: int, most: int) -> Callable[..., tuple[int, ...] | None]:
    """Return the callback of whole numbers with commas between, as `read_names`."""

    def read(context: click.Context, parameter: click.Parameter, value: Sequence[str]) -> tuple[int, ...] | None:
        parts = [part.strip() for given in value for part in given.split(",")]
        if not all(part.isdecimal() and len(part) < DIGITS and least <= int(part) <= most for part in parts):
            raise refuse(",".join(value), f"whole numbers from {least} to {most} with commas between")
        return tuple(dict.fromkeys(map(int, parts))) or None

    return read


def ranged(name: str, scale: float = 1.0) -> click.ParamType[Any]:
    """Return the kind of a number of `hhsim.ranges`; `scale` is the option's unit in SI."""
    least, greatest, *_ = RANGES[name]
    if isinstance(greatest, int):
        return click.IntRange(int(least), greatest)
    # To 15 digits, so that bounds in mm are as round as those in metres.
    return Number(float(f"{least / scale:.15g}"), float(f"{greatest / scale:.15g}"))


def metres(millimetres: float | None) -> float | None:
    """Return [m] for the value of an option in [mm]; None if it is not given."""
    return None if millimetres is None else 1e-3 * millimetres


def _announce(context: click.Context, parameter: click.Parameter, quiet: bool) -> bool:
    """Tell of kernels that the command has to compile, unless it is quiet."""
    announce_compilation(quiet=quiet or context.resilient_parsing)
    return quiet


SCHEDULER = option(
    "Dask cluster that shares the work: tcp://host:8786, or local for --jobs processes.", "ADDRESS", default=""
)
WHICH_HANDS = option(
    "Which hand grasps, or both. Default: the recording's, else the right one.", None, "--hand", "--hands"
)
SEED = option("Seed of everything random.", "N", default=0)
JSON = option("Print one JSON document, SI units, and nothing else.", None, "--json")
QUIET = option("Show no progress and no table; errors still show.", None, "--quiet", "-q", callback=_announce)
TREE_LEVEL = option("Level of the sphere trees. Default: as the catalogue says.", "N")
HAND_FILE = option(
    "Sizes and joint limits of the hand that differ from the default (docs/faq.md has an example).", "TOML"
)


Part = Table | str
"""What is printed: a table, or a sentence, "" for an empty line."""


def show(document: Mapping[str, Any], *parts: Part, as_json: bool) -> None:
    """Print the document with --json, else the parts."""
    if as_json:
        print_json(document)
        return
    for part in parts:
        if isinstance(part, str):
            print_line(part)
        else:
            print_table(part)


class Printing(OptionGroup):
    """Form and amount of what is printed."""

    as_json: bool = JSON
    quiet: bool = QUIET

    @classmethod
    def parameters(cls) -> Iterator[click.Parameter]:
        """Yield these options after those of a class that is made of it."""
        yield from sorted(super().parameters(), key=lambda each: each.name in ("as_json", "quiet"))

    @property
    def for_people(self) -> bool:
        """True where tables and sentences are printed."""
        return not self.as_json and not self.quiet

    def show(self, document: Mapping[str, Any], *parts: Part) -> None:
        """Print what the function `show` prints; without --json nothing where it is quiet."""
        if self.as_json or not self.quiet:
            show(document, *parts, as_json=self.as_json)


class Output(Printing, heading="Output"):
    """Output file, and what is printed."""

    out: OutPath | None = option("Output file. Default: a dated name in results/ under the current folder.", "FILE")

    def path(self, stem: str, suffix: str = ".h5") -> Path:
        """Return the path: as named, or a dated name with `stem`."""
        from hhsim.system.output_path import dated_output_path

        return self.out or dated_output_path(stem, suffix)
