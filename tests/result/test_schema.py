"""The table of a tick's columns, from which record, ring, file, docs follow; words of sessions, objects, motions."""

import subprocess
import sys
import textwrap
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from markdown_pages import Page

from hhsim.hand.configuration import HandConfiguration
from hhsim.kernels.contact import surface
from hhsim.kernels.live.deadlines import cause_of
from hhsim.kernels.tick import state, step
from hhsim.kernels.tick.block import TickRecord
from hhsim.live.device import GLOVE_SAMPLE
from hhsim.live.session.memory import EVENT, LIVE_TICK
from hhsim.result import schema
from hhsim.result.body import contact_names, pair_codes
from hhsim.result.miss_cause import MissCause, TimeTaken
from hhsim.result.safety import Safety, free_counts
from hhsim.result.schema import Column
from hhsim.result.wording import motion_name, object_name


def test_the_solvers_record_is_that_of_the_table() -> None:
    first = schema.TICK_FIELDS.index("status")
    haptic = tuple(f"haptic_{name}" for name in HandConfiguration._fields)
    assert schema.TICK_FIELDS[first:-2] == (TickRecord._fields[0], *haptic, *TickRecord._fields[1:])


@pytest.mark.parametrize(
    ("field", "places", "prefix"),
    [("duration", step, "DURATION_"), ("work", state, "WORK_"), ("work", surface, "COUNT_")],
)
def test_parts_of_a_field_lie_where_the_kernels_put_them(field: str, places: object, prefix: str) -> None:
    parts = schema.PARTS[field]
    names = [name for name in vars(places) if name.startswith(prefix) and name != "WORK_COUNTERS"]
    assert len(names) >= 3
    assert {name.removeprefix(prefix).lower(): vars(places)[name] for name in names} == {
        name.removeprefix(prefix).lower(): parts.index(name.removeprefix(prefix).lower()) for name in names
    }
    assert len(parts) == (state.WORK_COUNTERS if field == "work" else 4)


@pytest.mark.parametrize(
    ("columns", "record"),
    [
        (schema.TICK_COLUMNS, LIVE_TICK),
        (schema.LIVE_TICK_COLUMNS, LIVE_TICK),
        (schema.sample_columns(3), GLOVE_SAMPLE),
        (schema.EVENT_COLUMNS, EVENT),
    ],
    ids=["tick", "live/tick", "live/sample", "live/event"],
)
def test_what_a_column_is_taken_from_fits_it(columns: tuple[Column, ...], record: np.dtype[np.void]) -> None:
    rows = np.zeros(5, record)
    taken = {column.name: column.taken(rows) for column in columns if column.source}
    assert len(taken) >= 3
    assert {name: values.shape for name, values in taken.items()} == {
        column.name: (5, *column.shape) for column in columns if column.source
    }


ONE_MORE = """
    import sys
    from pathlib import Path
    from hhsim.result import schema
    text = "times that pairs were looked for anew"
    schema.TICK_COLUMNS += (schema.Column("work/gathers", (), "<i8", "1", text, "work.gathers"),)

    from short_grasp import short_result
    from hhsim.replay.repeat import run_again
    result = short_result(Path(sys.argv[1]))
    assert result["work/gathers"].sum() > 0
    compared = {array.name: array for array in run_again(result).arrays}
    assert compared["work/gathers"].identical
"""


def test_one_more_line_of_the_table_is_one_more_dataset(tmp_path: Path) -> None:
    tests = Path(__file__).parents[1]
    script = f"import sys; sys.path.insert(0, {str(tests)!r})\n{textwrap.dedent(ONE_MORE)}"
    answer = subprocess.run(
        [sys.executable, "-c", script, str(tmp_path / "run.h5")], capture_output=True, text=True, check=False
    )
    assert (answer.returncode, answer.stderr) == (0, "")


def test_the_documentation_has_a_line_for_each_column_of_a_session(repository: Path) -> None:
    page = Page.read(repository / "docs" / "files.md")
    heading = page.text.index("## What a session adds")
    section = page.text[heading : page.text.index("Ticks before the first input", heading)]
    named = [name for line in section.splitlines() if line.startswith("| ") for name in line.split("|")[1].split(",")]
    documented = [name.strip().removesuffix(" [ns]") for name in named if name.strip() != "dataset"]
    assert documented == [column.name for column in schema.LIVE_TICK_COLUMNS]


def test_a_tick_of_bodies_has_rows_of_contacts_only_where_there_is_a_body() -> None:
    none, two = schema.bodies_row(0), schema.bodies_row(2)
    assert none.names == two.names
    for name in ("body", "point", "slip", "contact_body", "other_point"):
        assert none[name].shape[0] == 0 and two[name].shape[0] == 64
    assert none["turn"].shape == (0, 1, 4) and two["turn"].shape == (2, 1, 4)


def test_a_contact_of_the_first_body_is_named_by_hand_and_body() -> None:
    # The first phalanx of either hand, a palm, the table, and another body.
    touching = np.array([0, 16, 31, -1, -3])
    names = contact_names(("right", "left"), ("cup", "plate", "spoon"))
    codes = pair_codes(touching, 2)
    assert [(names[a], names[b]) for a, b in zip(codes["a"], codes["b"])] == [
        ("right/thumb/proximal", "cup"),
        ("left/thumb/proximal", "cup"),
        ("left/palm", "cup"),
        ("cup", "table"),
        ("cup", "plate"),
    ]


MS = 1_000_000


@pytest.mark.parametrize(
    ("taken", "cause"),
    [
        # Computed, kept, run delay, steal, device.
        ((5 * MS, 0, 0, 0, 0), MissCause.COMPUTED),
        ((5 * MS, MS, 0, 10 * MS, 0), MissCause.COMPUTED),
        ((MS // 2, 4 * MS, 4 * MS, 0, 0), MissCause.WOKEN_LATE),
        ((MS // 2, 4 * MS, 4 * MS, 10 * MS, 0), MissCause.WOKEN_LATE),
        ((MS // 2, 4 * MS, 0, 0, 0), MissCause.WOKEN_LATE),
        ((MS // 2, 4 * MS, 0, 10 * MS, 0), MissCause.HOST),
        ((MS // 2, 4 * MS, MS, 10 * MS, 4 * MS), MissCause.HOST),
        ((MS // 2, 40 * MS, 0, 10 * MS, 40 * MS), MissCause.DEVICE),
        ((MS // 2, 4 * MS, 0, 0, 3 * MS), MissCause.DEVICE),
        ((MS // 2, 4 * MS, 3 * MS, 0, 4 * MS), MissCause.WOKEN_LATE),
        # A device call that computes is the loop's own time.
        ((5 * MS, 0, 0, 0, 5 * MS), MissCause.COMPUTED),
    ],
)
def test_the_cause_is_what_took_most(taken: tuple[int, ...], cause: MissCause) -> None:
    assert cause_of(*TimeTaken(*taken)) == cause


def test_every_reason_is_counted_and_the_other_hand_s_only_where_there_was_one() -> None:
    counts = free_counts(lambda why: 7 if why is Safety.STOPPING else 0)
    assert counts.pop("STOPPING") == 7
    assert counts == {why.name: 0 for why in Safety if why not in (Safety.STOPPING, Safety.OTHER_HAND)}
    assert free_counts(lambda why: int(why is Safety.OTHER_HAND))["OTHER_HAND"] == 1


@pytest.mark.parametrize(
    ("scene", "names"),
    [
        ({"object": "meshes/mug.stl", "trajectory": "own/grasp.toml"}, ("mug.stl", "grasp.toml")),
        ({"object_name": "mug", "object": "mug.stl", "motion": "grasp", "trajectory": "x"}, ("mug", "grasp")),
        ({}, ("object", "motion")),
    ],
)
def test_a_file_is_called_by_its_name_without_its_folder(scene: dict[str, Any], names: tuple[str, str]) -> None:
    result: Any = SimpleNamespace(scene=scene | {"hand": {"side": "left"}}, other=None)
    assert (object_name(result), motion_name(result)) == names
    result.other = result
    assert motion_name(result) == f"{names[1]} (left of two hands)"
