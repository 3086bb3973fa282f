"""Manifests of repairs: what they become, and one line for what is wrong in them."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hhsim.errors import InputError
from hhsim.recordings.registry import ReadOptions
from hhsim.sweep.repair_manifest import PlannedRepair, load_manifest

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
