"""Repairs of a folder: each row its files, what is done stays done, and what fails is a row of the table."""

import csv
import io
import json
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

import fake_repairs
import pytest
from fake_repairs import run, tree, write_manifest
from hypothesis import given
from hypothesis import strategies as st

from hhsim.errors import InputError, OutputError
from hhsim.recordings.registry import ReadOptions
from hhsim.repair.request import PICTURE, RepairOutcome, RepairRequest
from hhsim.sweep import engines, repair_batch
from hhsim.sweep.engines import TaskFolder
from hhsim.sweep.input_files import CHANGED
from hhsim.sweep.repair_batch import RepairedRow, RowOutcome, brief_table, repair_table, run_manifest
from hhsim.sweep.repair_manifest import PlannedRepair, load_manifest

LIMIT = "time_limit = 1.0\n"


@pytest.fixture
def in_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Run the rows here, one after the other."""
    monkeypatch.setattr(engines, "run_in_processes", lambda tasks, *_: (task.run() for task in tasks))


def ran(out: Path) -> list[str]:
    """Names of the rows that were run since this was asked."""
    log = out / "log.txt"
    names = sorted(log.read_text().split()) if log.is_file() else []
    log.unlink(missing_ok=True)
    return names


def states(out: Path) -> dict[str, tuple[str, str]]:
    rows = csv.DictReader(io.StringIO((out / "table.csv").read_text()))
    return {row["name"]: (row["state"], row["reason"]) for row in rows}


@pytest.mark.soak
def test_every_row_ends_whatever_others_do_and_any_number_of_processes_writes_the_same(tmp_path: Path) -> None:
    contents = ("copy 9", "crash 1", "refuse 1", "hang 1", "miss 4", "raise 1", "nothing 1", "mesh 1", "copy 3")
    path = write_manifest(tmp_path, *contents, more=LIMIT)
    one, two = tmp_path / "one", tmp_path / "two"
    found = run(path, one)
    assert run(path, two, workers=2).failed == found.failed
    assert states(one) == {
        "r0": ("repaired", ""),
        "r1": ("failed", f"{engines.CRASHED}; its time_limit is 1 s"),
        "r2": ("refused", f"{tmp_path}/r2.txt: no recording"),
        "r3": ("failed", f"{engines.CRASHED}; its time_limit is 1 s"),
        "r4": ("missed", "MISSED: 2 frames are deep"),
        "r5": ("failed", "KeyError: 'hand'"),
        "r6": ("failed", "it wrote no r6.txt"),
        "r7": ("failed", "no inside"),
        "r8": ("repaired", ""),
    }
    assert dict(found.failed) == {name: reason for name, (_, reason) in states(one).items() if reason}
    assert found.path == one / "table.csv"
    files = tree(one)
    assert files == tree(two)
    assert files["r0/r0.txt"] == b"copy 9"
    assert [name for name in files if name.startswith("r3/")] == ["r3/outcome.json"]
    assert len(ran(one)) == len(contents)


@pytest.mark.usefixtures("in_this_process")
def test_a_second_run_repeats_what_ended_by_accident_and_nothing_else(tmp_path: Path) -> None:
    path, out = write_manifest(tmp_path, "raise 1", "refuse 1", "miss 1", "copy 1", "mesh 1"), tmp_path / "out"
    told: list[tuple[str, int, int]] = []
    again = partial(run_manifest, path, out, fake_repairs.repaired)
    first = again(progress=lambda *step: told.append(step))
    assert told == [("recordings", done, 5) for done in range(6)]
    assert len(ran(out)) == 5
    files = tree(out)
    told.clear()
    assert again(progress=lambda *step: told.append(step)).failed == first.failed
    assert (ran(out), told) == (["r0"], [("recordings", 4, 5), ("recordings", 5, 5)])
    assert tree(out) == files


@pytest.mark.usefixtures("in_this_process")
def test_a_file_that_cannot_be_read_fails_its_row_alone(tmp_path: Path) -> None:
    path = write_manifest(tmp_path, "version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 1\n", "copy 1")
    assert [name for name, _ in run(path, tmp_path / "out").failed] == ["r0"]


@pytest.mark.usefixtures("in_this_process")
@pytest.mark.parametrize("replaced", ["r0.txt", "r1.txt", "thing.obj"])
def test_a_row_whose_file_is_replaced_keeps_nothing_and_is_run_anew(tmp_path: Path, replaced: str) -> None:
    """The file is another one after the first row was begun, and is put back for the second run."""
    path = write_manifest(tmp_path, "copy 9", "copy 8")
    path.write_text(path.read_text().replace('"cube"', '"thing.obj"'))
    (tmp_path / "thing.obj").write_text("v 0 0 0")
    before = (tmp_path / replaced).read_text()

    def repaired(request: RepairRequest) -> RepairOutcome:
        outcome = fake_repairs.repaired(request)
        (tmp_path / replaced).write_text("copy 4")
        return outcome

    out = tmp_path / "out"
    lost = {"r0.txt": ["r0"], "r1.txt": ["r1"], "thing.obj": ["r0", "r1"]}[replaced]
    assert run_manifest(path, out, repaired).failed == tuple((name, CHANGED) for name in lost)
    assert not any((out / name / f"{name}.txt").exists() for name in lost)
    (tmp_path / replaced).write_text(before)
    ran(out)
    assert run(path, out).failed == () and set(lost) <= set(ran(out))


def test_an_interrupted_run_says_what_is_done(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(tasks: Sequence[repair_batch.RowTask], *_: object) -> Iterator[engines.TaskEnd]:
        yield tasks[0].run()
        raise KeyboardInterrupt

    monkeypatch.setattr(engines, "run_in_processes", interrupted)
    path = write_manifest(tmp_path, "copy 1", "copy 2", "copy 3")
    with pytest.raises(KeyboardInterrupt) as caught:
        run(path, tmp_path / "out")
    assert caught.value.__notes__ == ["1 of 3 recordings are done, and the same command goes on"]


@pytest.mark.usefixtures("in_this_process")
def test_the_table_has_units_and_its_json_the_same_values(tmp_path: Path) -> None:
    path = write_manifest(tmp_path, "copy 9", "refuse 0")
    run(path, tmp_path / "out")
    first, second = csv.DictReader(io.StringIO((tmp_path / "out" / "table.csv").read_text()))
    assert float(first["depth_cones_max_before [m]"]) == 1e-3 * 9.0
    assert float(first["depth_cones_max_after [m]"]) == pytest.approx(9e-6)
    assert (first["frames"], first["marked"], first["own_figure"]) == ("30", "2", "")
    assert second["depth_cones_max_after [m]"] == ""
    document = json.loads((tmp_path / "out" / "table.json").read_text())
    row, other = document["rows"]
    assert document["columns"]["volume_exact_mean_before"] == "m³" and row["depth_cones_max_before"] == 1e-3 * 9.0
    assert row["own_figure"] is None and other["state"] == "refused"
    outcome = json.loads((tmp_path / "out" / "r0" / "outcome.json").read_text())
    assert (outcome["paths"], outcome["marked"]) == ({"recording": "r0.txt"}, [4, 7])
    assert outcome["findings"] == ["a finding"]


@pytest.mark.usefixtures("in_this_process")
@pytest.mark.soak
def test_what_a_row_depends_on_runs_it_anew(tmp_path: Path) -> None:
    path, out = write_manifest(tmp_path, "copy 9", "copy 8", "copy 7"), tmp_path / "out"
    run(path, out)
    assert ran(out) == ["r0", "r1", "r2"]
    (tmp_path / "r1.txt").write_text("copy 5")
    (out / "r2" / "r2.txt").unlink()
    (out / "r1" / "left.txt").write_text("of an earlier run")
    run(path, out)
    assert ran(out) == ["r1", "r2"] and not (out / "r1" / "left.txt").exists()
    for damage in ("", "{}", '{"format": "hhsim-repair"}'):
        (out / "r0" / "outcome.json").write_text(damage)
        run(path, out)
        assert ran(out) == ["r0"]
    path.write_text(path.read_text() + "max_correction_mm = 9.0\n")
    run(path, out)
    assert ran(out) == ["r0", "r1", "r2"]
    path.write_text(path.read_text() + "time_limit = 60.0\n")
    run(path, out)
    assert ran(out) == []


@pytest.mark.usefixtures("in_this_process")
def test_a_folder_of_others_and_one_that_is_worked_in_are_left_alone(tmp_path: Path) -> None:
    path = write_manifest(tmp_path, "copy 1")
    with pytest.raises(OutputError, match="holds other files, and no repair:"):
        run(path, tmp_path)
    run(path, tmp_path / "out")
    with (
        TaskFolder(tmp_path / "out", "repair", repair_batch.MARK, repair_batch.FORMAT).locked(),
        pytest.raises(OutputError, match="another repair works in"),
    ):
        run(path, tmp_path / "out")


@pytest.mark.usefixtures("in_this_process")
def test_each_row_has_pictures_unless_none_are_asked_for(tmp_path: Path) -> None:
    path, out = write_manifest(tmp_path, "copy 1", "copy 2", "refuse 1"), tmp_path / "out"
    for pictures, rows in ((False, []), (True, ["r0", "r1"])):
        run_manifest(path, out, fake_repairs.repaired, pictures=pictures)
        assert sorted(path.parent.name for path in out.glob(f"*/*{PICTURE}")) == rows
        assert ran(out) == ["r0", "r1", "r2"]


def row(folder: Path, name: str, depth: float | None, state: str = "repaired", **more: float) -> RepairedRow:
    """A row with a depth [m], in a folder of its own."""
    request = RepairRequest(folder / f"{name}.npz", "cube", folder / name / f"{name}.npz")
    figures: dict[str, float | None] = (
        {} if depth is None else {"depth_cones_max_before": 10 * depth, "depth_cones_max_after": depth, **more}
    )
    outcome = RowOutcome(digest=name, state=state, reason="" if state == "repaired" else "why", figures=figures)
    return RepairedRow(PlannedRepair(name, request, 1.0), outcome)


def test_a_terminal_has_a_few_figures_of_the_skin_where_there_is_one(tmp_path: Path) -> None:
    rows = [row(tmp_path, "r3", 3e-4, contacts_kept_5mm_after=0.97), row(tmp_path, "failed", None, "failed")]
    skinned = row(tmp_path, "skin", 1e-3, depth_skin_max_after=2e-3, jerk_after=3.0)
    cells = {record["name"]: record for record in brief_table(repair_table([*rows, skinned])).records}
    assert list(cells["skin"]) == ["name", "state", "frames", "marked", "PD before", "PD after", "kept, 5 mm", "reason"]
    assert cells["skin"]["PD after"] == 2e-3 and cells["skin"]["PD before"] == 1e-2
    assert cells["r3"]["PD after"] == pytest.approx(3e-4)
    assert cells["r3"]["kept, 5 mm"] == pytest.approx(0.97) and cells["failed"]["reason"] == "why"


MESH = "solid empty\nendsolid\n"
TOML = """
version = 1
[defaults]
hand = "right"
mano_model = "models/MANO.pkl"
[[recording]]
recording = "seqs/*/{object}_*.npz"
object = "meshes/{object}.stl"
poses = "poses/{stem}.npy"
name = "{folder}-{stem}"
size_mm = 120
rate = 30.0
[[recording]]
recording = "one.csv"
object = "cube"
hand = "left"
columns = "columns.toml"
"""
COLUMNS = '[columns]\ntime = "t"\n'


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Recordings, meshes and poses, each of a few bytes."""
    for name in (
        *("seqs/s1/cup_pour_1.npz", "seqs/s1/mug_2.npz", "seqs/s2/cup_pour_1.npz", "seqs/s2/notes.npz"),
        *("one.csv", "models/MANO.pkl", "meshes/cup.stl", "meshes/mug.stl", "poses/cup_pour_1.npy", "poses/mug_2.npy"),
    ):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(MESH)
    return tmp_path


def load(folder: Path, text: str) -> list[PlannedRepair]:
    (folder / "m.toml").write_text(text, encoding="utf-8")
    return load_manifest(folder / "m.toml", folder / "out")[1]


def test_a_pattern_names_its_parts_and_defaults_hold(folder: Path) -> None:
    found = load(folder, TOML.replace('columns = "columns.toml"\n', ""))
    assert [row.name for row in found] == ["s1-cup_pour_1", "s1-mug_2", "s2-cup_pour_1", "one"]
    first, last = found[0].request, found[-1].request
    assert first.recording == folder / "seqs/s1/cup_pour_1.npz"
    assert first.object == str(folder / "meshes/cup.stl")
    assert first.object_poses == folder / "poses/cup_pour_1.npy"
    assert first.out == folder / "out/s1-cup_pour_1/cup_pour_1.npz"
    assert (first.read.hand, first.size, first.max_correction, first.palm) == ("right", 0.12, 0.015, "fitted")
    model = folder / "models/MANO.pkl"
    assert first.read == ReadOptions(hand="right", mano_model=model, rate=30.0)
    assert (last.object, last.read) == ("cube", ReadOptions(hand="left", mano_model=model))


@pytest.mark.parametrize(
    ("pattern", "names"),
    [
        ("seqs/**/{kind}_1.npz", {"s1-cup_pour", "s2-cup_pour"}),
        ("**/s?/{kind}_?.npz", {"s1-cup_pour", "s1-mug", "s2-cup_pour"}),
        ("seqs/s[!2]/*_{kind}_1.npz", {"s1-pour"}),
        ("seqs/{place}/{kind}_{rest}.npz", {"s1-cup", "s1-mug", "s2-cup"}),
        ("poses/{kind}_{kind}_1.npy", set()),
    ],
)
def test_a_part_is_what_the_rest_of_its_pattern_leaves(folder: Path, pattern: str, names: set[str]) -> None:
    text = f'version = 1\n[[recording]]\nrecording = "{pattern}"\nobject = "cube"\nname = "{{folder}}-{{kind}}"\n'
    if names:
        assert {row.name for row in load(folder, text)} == names
    else:
        with pytest.raises(InputError, match="there is no file"):
            load(folder, text)


def test_an_object_may_be_a_thing_of_parts(folder: Path) -> None:
    (folder / "hinge.toml").write_text('[[body]]\nname = "a"\nbox = [0.1, 0.1, 0.1]\nfixed = true\n')
    for word, object_ in (("laptop", "laptop"), ("hinge.toml", str(folder / "hinge.toml"))):
        (found,) = load(folder, f'version = 1\n[[recording]]\nrecording = "one.csv"\nobject = "{word}"\n')
        assert found.request.object == object_


def test_what_was_written_is_no_recording_of_the_next_run(folder: Path) -> None:
    text = 'version = 1\n[[recording]]\nrecording = "**/mug*.npz"\nobject = "cube"\n'
    assert len(load(folder, text)) == 1
    (folder / "out/mug_2").mkdir(parents=True)
    (folder / "out/mug_2/mug_2.npz").write_text("repaired")
    assert len(load(folder, text)) == 1
    with pytest.raises(InputError, match="is in the output folder"):
        load(folder, text.replace("**/mug*", "out/mug_2/mug_2"))


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("hand = \"right\"", "hand = \"both\"", "m.toml: defaults: hand: unknown hand 'both'"),
        ("size_mm", "size", "m.toml: recording[1]: unknown key 'size': did you mean size_mm?"),
        ("size_mm = 120", "size_mm = -1", "recording[1]: size_mm = -1; expected a number from 0.001 to 100000 mm"),
        ("size_mm = 120", "size_mm = nan", "m.toml: recording[1]: size_mm = nan; expected a number from 0.001"),
        ("size_mm = 120", "size_mm = 1\nunit = \"mm\"", "unit and size_mm exclude each other"),
        ("{folder}-{stem}", "{stem}", "two recordings are called 'cup_pour_1'"),
        ("{folder}-{stem}", "../{stem}", "name: '../cup_pour_1' is none for a folder"),
        ("{folder}-{stem}", "Table.csv", "name: 'Table.csv' is none for a folder"),
        ("{folder}-{stem}", "x" * 101, "is none for a folder"),
        ("{folder}-{stem}", "{stam}", "m.toml: recording[1]: name: unknown place '{stam}': did you mean {stem}?"),
        ("poses/{stem}", "poses/{object}", "recording[1]: poses: there is no file poses/cup.npy in"),
        ("meshes/{object}", "mesh/{object}", "recording[1]: object: there is no file mesh/cup.stl in"),
        ("seqs/*/", "seqs/no/", "recording[1]: recording: there is no file seqs/no/{object}_*.npz in"),
        ("seqs/*/", "seqs/[z-a]/", "recording[1]: recording: there is no file seqs/[z-a]/{object}_*.npz in"),
        ("one.csv", "two.csv", "recording[2]: recording: there is no file two.csv"),
        ("one.csv", "o\\u0000e.csv", "recording[2]: recording = 'o\\x00e.csv'; expected text of one line"),
        ('"one.csv"', "3", "recording[2]: recording = 3; expected text of one line"),
        ('"cube"', '"cub"', "recording[2]: object: unknown object 'cub': did you mean cube"),
        ('"cube"', '"cube"\nunit = "mm"', "'cube' has its size"),
        ("columns.toml", "no.toml", "recording[2]: columns: there is no file no.toml"),
        ("[[recording]]", "[[recordings]]", "unknown key 'recordings': did you mean recording?"),
    ],
)  # fmt: skip
def test_a_fault_is_one_line(folder: Path, old: str, new: str, said: str) -> None:
    with pytest.raises(InputError) as caught:
        load(folder, TOML.replace(old, new))
    assert said in str(caught.value) and "\n" not in str(caught.value)


def test_a_file_that_is_no_manifest_is_told(folder: Path) -> None:
    (folder / "outcome.json").write_text("")
    with pytest.raises(InputError, match="no such file"):
        load_manifest(folder / "no.toml", folder / "out")
    with pytest.raises(InputError, match="is the name of a file beside it"):
        load(folder, 'version = 1\n[[recording]]\nrecording = "outcome.json"\nobject = "cube"\n')


@given(st.data())
def test_damage_is_one_line_or_no_damage(tmp_path_factory: pytest.TempPathFactory, data: st.DataObject) -> None:
    """Bytes of a manifest are replaced or inserted; what is read has names for folders of their own."""
    folder = tmp_path_factory.mktemp("damage")
    (folder / "r1.npz").write_text("")
    toml = 'version = 1\n[[recording]]\nrecording = "{kind}*.npz"\nobject = "cube"\nname = "{stem}"\nrate = 30\n'
    text = bytearray(toml.encode())
    for _ in range(data.draw(st.integers(1, 3))):
        at = data.draw(st.integers(0, len(text)))
        text[at : at + data.draw(st.integers(0, 4))] = data.draw(st.binary(max_size=4))
    path = folder / "m.toml"
    path.write_bytes(bytes(text))
    try:
        rows = load_manifest(path, folder / "out")[1]
    except InputError as error:
        assert "\n" not in str(error) and str(error).startswith(str(path))
    else:
        assert rows
        assert {row.request.out.parent.parent for row in rows} == {(folder / "out").resolve()}
