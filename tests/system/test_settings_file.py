"""Settings files: what a declared structure allows is read, and a fault is told with file, key path and remedy."""

from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module
from typing import Annotated, Any, Literal

import pytest
from msgspec import Meta, inspect

from hhsim.errors import InputError, TrajectoryError
from hhsim.system.settings_file import (
    Settings,
    Version,
    a_list,
    between,
    check_fields,
    one_of,
    parse_settings,
    parse_toml,
)

FINGERS = ("thumb", "index")
READERS = (
    *("bench.plan", "bench.paper.table", "gate.suite", "gate.gate", "hand.model"),
    *("recordings.column_map", "recordings.dexmo_regression"),
    *("scene.contact_goals", "scene.described_scene", "scene.body", "scene.script"),
    *("sweep.plan", "sweep.repair_batch", "sweep.repair_manifest"),
)
"""Modules that declare settings."""
Share = Annotated[float, between(0.0, 1.0)]


class Entry(Settings, frozen=True):
    name: str
    share: Share = 0.5
    low: Annotated[float, between(0.0)] | Literal[False] = 0.0
    side: Literal["right", "left"] | None = None
    place: tuple[float, float] = (0.0, 0.0)

    def check(self) -> None:
        if self.name == "none":
            raise InputError("name is none ` - at `$.entry[7]`")


class File(Settings, frozen=True, rename={"entries": "entry"}):
    version: Version
    entries: Annotated[tuple[Entry, ...], Meta(description="[[entry]] tables")] = ()
    shares: dict[str, dict[str, Share]] | None = None
    fingers: Annotated[tuple[Annotated[str, one_of(FINGERS)], ...], a_list('["thumb"]')] = FINGERS
    joint: dict[Annotated[str, one_of(FINGERS)], str | Entry] | None = None
    count: Annotated[int, between(1, 5)] = 1
    flag: bool = False


def test_what_is_declared_is_read() -> None:
    text = "entry = [{name = 'a', low = false}]\nshares = {x = {y = 1}}\njoint = {thumb = 't', index = {name = 'b'}}"
    read = parse_settings(f"version = 1\n{text}", File, "f.toml")
    assert read.entries == (Entry("a", low=False),) and read.shares == {"x": {"y": 1.0}}
    assert read.joint == {"thumb": "t", "index": Entry("b")} and read.fingers == FINGERS


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("version = ", "not TOML"),
        ("version = 2", "version = 2; expected 1"),
        ("count = 1", "version is missing; expected 1"),
        ("cuont = 1", "unknown key 'cuont': did you mean count?"),
        ("count = 2.0", "count = 2.0; expected a whole number from 1 to 5"),
        ("flag = 1", "flag = 1; expected true or false"),
        ("fingers = []", 'fingers = []; expected a list such as ["thumb"]'),
        ("fingers = ['thumb', 'indx']", "fingers[2]: unknown finger 'indx': did you mean index?"),
        ('fingers = ["thumb\\n"]', "fingers[1]: unknown finger 'thumb"),
        ("entry = [{name = 'a'}, 1979-05-27]", "entry[2] = datetime.date(1979, 5, 27); expected a table"),
        ("entry = [{name = 'a'}, {share = 2}]", "entry[2].share = 2; expected a number from 0 to 1"),
        ("entry = [{name = 'a', low = -1}]", "entry[1].low = -1; expected a number from 0 on, or false"),
        ("entry = [{name = 'a', side = 'rigth'}]", "entry[1].side: unknown side 'rigth': did you mean right?"),
        ("entry = [{name = 'a', place = [1]}]", "entry[1].place = [1]; expected a list of 2, each a number"),
        ("entry = [{share = 1}]", "entry[1]: name is missing; expected text in quotes"),
        ("entry = [{name = 'none'}]", "entry[1]: name is none ` - at `$.entry[7]`"),
        ("shares = {x = {y = 0}, z = {y = 1, w = 2}}", "shares.z.w = 2; expected a number from 0 to 1"),
        ("joint = {thumb = 't', index = {name = 'a', share = 5}}", "joint.index.share = 5; expected"),
    ],
)
def test_a_fault_is_told_in_a_line_with_file_key_and_remedy(text: str, told: str) -> None:
    if "version" not in text and text != "count = 1":
        text = f"version = 1\n{text}"
    with pytest.raises(TrajectoryError) as caught:
        parse_settings(text, File, "f.toml", TrajectoryError)
    line = str(caught.value)
    assert line.startswith("f.toml: ") and told in line and "\n" not in line and len(line) < 250


def declared(kind: type[Settings]) -> Iterator[type[Settings]]:
    for inner in kind.__subclasses__():
        yield from (inner, *declared(inner))


def nested(kind: Any) -> Iterator[Any]:
    """The types that a type is made of."""
    if isinstance(kind, inspect.Type | inspect.Field):
        yield kind
    for part in kind if isinstance(kind, tuple) else vars_of(kind):
        yield from nested(part)


def vars_of(kind: Any) -> list[Any]:
    return [getattr(kind, name) for name in getattr(kind, "__struct_fields__", ())]


@pytest.mark.parametrize("key", ["a" + ".a" * 20_000 + " = 1", "[" + "a . " * 99 + "b]", "'a'.\"b\"." * 99 + "c = 1"])
def test_a_key_of_many_parts_is_refused_before_it_is_parsed(key: str) -> None:
    with pytest.raises(InputError, match="line 2: a key of more than 64 parts"):
        parse_toml(f"# a key\n{key}", "plan.toml")
    assert parse_toml("a" + ".a" * 63 + " = 1", "plan.toml").keys() == {"a"}


def test_no_field_is_of_a_kind_that_the_library_reads_beyond_its_memory_for() -> None:
    for module in READERS:
        import_module(f"hhsim.{module}")
    kinds = {kind for kind in declared(Settings) if kind.__module__.startswith("hhsim.")}
    assert {kind.__module__.removeprefix("hhsim.") for kind in kinds} == set(READERS)
    for kind in kinds:
        for union in (one for one in nested(inspect.type_info(kind)) if isinstance(one, inspect.UnionType)):
            tuples = [one for one in nested(union.types) if isinstance(one, inspect.TupleType)]
            bounds = [part for one in union.types for part in bounds_of(one)]
            assert not (tuples and bounds), f"{kind}: {union}"


def bounds_of(kind: Any) -> list[Any]:
    kind = kind.type if isinstance(kind, inspect.Metadata) else kind
    if not isinstance(kind, inspect.IntType | inspect.FloatType | inspect.StrType):
        return []
    return [bound for bound in vars_of(kind) if bound is not None]


@dataclass
class Limits:
    share: Share = 0.5
    places: tuple[float, ...] = ()


def test_the_fields_of_a_dataclass_are_checked_by_their_types() -> None:
    check_fields(Limits(1, (1.0, 2.0)))
    with pytest.raises(TrajectoryError, match=r"^share = 2.0; expected a number from 0 to 1"):
        check_fields(Limits(2.0), TrajectoryError)
    with pytest.raises(InputError, match=r"^places\[2\] = 'x'; expected a number"):
        check_fields(Limits(places=(1.0, "x")))


def test_a_check_that_fails_without_a_file_is_bad_input_too() -> None:
    with pytest.raises(InputError, match="name is none"):
        Entry("none")
