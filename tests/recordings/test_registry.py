"""The formats of recordings: what each says of itself, which one a file is of, and what it takes to add one."""

import io
import json
import sys
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from conftest import Run

from hhsim.errors import InputError, TrajectoryError
from hhsim.motion.file import load_trajectory
from hhsim.recordings import formats
from hhsim.recordings.column_map import ColumnMap
from hhsim.recordings.dexmo_regression import CHANNELS
from hhsim.recordings.registry import Content, ReadOptions, format_of, read_content, read_recording, recording_suffixes
from hhsim.scene.motion_catalogue import resolve_trajectory
from hhsim.system.settings_file import parse_settings

JOINTS_PER_LINE = '''
"""One JSON object a line: a stamp [s] and the angles of the joints [rad]."""

import json

import numpy as np

from hhsim.recordings.recording import Recording
from hhsim.recordings.registry import Content, ReadOptions, RecordingFormat


def _sniff(content: Content, options: ReadOptions) -> bool:
    return content.beginning.startswith('{"t":')


def _read(content: Content, options: ReadOptions) -> Recording:
    samples = [json.loads(line) for line in content.text.splitlines()]
    count = len(samples)
    return Recording(
        time=[sample["t"] for sample in samples],
        position=np.zeros((count, 3)),
        orientation=np.tile([1.0, 0.0, 0.0, 0.0], (count, 1)),
        flexion=[sample["flexion"] for sample in samples],
        abduction=np.zeros((count, 5)),
        form="jointlines",
        name=content.name,
    )


FORMAT = RecordingFormat("jointlines", "joint angles, one JSON object a line", (".jointlines",), _sniff, _read)
'''


@pytest.fixture(params=["module", "entry point"])
def added(
    request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, installed: Callable[..., None]
) -> Iterator[Path]:
    """A recording of a format that one more module makes known, or a package that is installed."""
    if request.param == "module":
        folder = tmp_path / "formats"
        folder.mkdir()
        (folder / "jointlines.py").write_text(JOINTS_PER_LINE)
        monkeypatch.setattr(formats, "__path__", [*formats.__path__, str(folder)])
    else:
        installed("hhsim.formats", "jointlines = their_format:FORMAT", their_format=JOINTS_PER_LINE)
    path = tmp_path / "take.jointlines"
    bend = np.linspace(0.1, 0.4, 50)
    path.write_text("\n".join(json.dumps({"t": 0.01 * k, "flexion": [[b] * 3] * 5}) for k, b in enumerate(bend)))
    yield path
    sys.modules.pop(f"{formats.__name__}.jointlines", None)


def test_a_new_format_is_one_new_file(added: Path, run: Run, tmp_path: Path) -> None:
    recording = read_recording(added)
    assert (recording.form, recording.name, recording.sample_count) == ("jointlines", "take", 50)
    assert ".jointlines" in recording_suffixes()
    assert run("import", str(added), "--out", "take.h5", "--quiet") == (0, "", "")
    imported = load_trajectory(tmp_path / "take.h5")
    assert np.allclose(imported.flexion[:, 1, 2], np.linspace(0.1, 0.4, 50))
    replayed = resolve_trajectory(added)
    assert np.array_equal(replayed.flexion, imported.flexion)
    # What tells a user which formats there are tells of it.
    code, _, err = run("import", str(added), "--format", "jointline")
    assert code == 2 and "unknown format 'jointline': did you mean jointlines?" in err
    with pytest.raises(TrajectoryError, match=r"neither text nor a known format; expected one of .*jointlines"):
        read_content(Content(data=b"\x00" * 100), ReadOptions())


def test_a_format_whose_package_is_broken_is_named(installed: Callable[..., None], run: Run, tmp_path: Path) -> None:
    installed("hhsim.formats", "theirs = gone:FORMAT")
    (tmp_path / "take.csv").write_text("time,px\n0,1\n")
    code, _, err = run("import", "take.csv")
    assert code == 2 and err.count("\n") == 1
    assert "format 'theirs' cannot be imported from gone:FORMAT: ModuleNotFoundError: No module named 'gone'" in err


def test_our_own_formats_keep_their_names(installed: Callable[..., None]) -> None:
    installed("hhsim.formats", "csv = their_format:FORMAT", their_format=JOINTS_PER_LINE)
    assert formats.FORMATS.names().count("csv") == 1 and formats.FORMATS["csv"].name == "csv"


def test_the_page_tells_of_every_format(repository: Path) -> None:
    page = (repository / "docs" / "recordings.md").read_text(encoding="utf-8")
    table = page[page.index("| format |") :].split("\n\n")[0]
    assert sorted(line.split("`")[1] for line in table.splitlines()[2:]) == formats.FORMATS.names()


def zip_of(*names: str) -> bytes:
    """An archive of empty files."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        for name in names:
            archive.writestr(name, b"")
    return stream.getvalue()


@pytest.mark.parametrize(
    ("data", "name"),
    [
        (b"\x89HDF\r\n", "hhsim"),
        (b"PK\x03\x04", "npz"),
        (b"\xef\xbb\xbf  hierarchy\nROOT", "bvh"),
        (b' {"frames": []}', "leap"),
        (b"N4IgZgTghgtgpgZxALgNqoIwBoBMBdLTXPPAXyAA", "leap"),
        (b"time,px\n0,1\n", "csv"),
        ("\ufefftime;px\n0;1\n".encode("utf-16"), "csv"),
    ],
)
def test_the_content_decides(data: bytes, name: str) -> None:
    assert format_of(Content(data=data), ReadOptions()).name == name


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (b"Kaydara FBX Binary  \0\x1a\0" + bytes(40), "an animation .* export its skeleton as BVH"),
        (b"; FBX 7.4.0 project file\n", "an animation"),
        (b"glTF\2\0\0\0", "an animation"),
        (b' {"nodes": [], "asset": {"generator": "me", "version": "2.0"}}', "an animation"),
        (b"\xef\xbb\xbf<?xml version='1.0'?>\n<COLLADA>", "an animation"),
        (b'{"asset": "mug", "frame": []}', "JSON without frames"),
        (b"Format Version,1.23,Take Name,take1\n\n,Type,Bone", "an export of markers"),
        (b"Trajectories\r\n100\r\n", "an export of markers"),
        (b"#ROSBAG V2.0\n", "such as a bag of ROS, is not read"),
        (b"<?xml version='1.0'?>\n<robot name='arm'>", "XML; expected a recording of one of"),
        (b"\x1f\x8b\x08\0" * 30, "neither text nor a known format"),
        (zip_of("[Content_Types].xml", "xl/workbook.xml"), "an Excel workbook is not read; save it as CSV"),
    ],
)
def test_a_file_that_is_not_read_is_refused(data: bytes, said: str) -> None:
    with pytest.raises(TrajectoryError, match=said):
        read_content(Content(data=data), ReadOptions())


def test_a_mapping_of_columns_wins_over_a_gloves_channels_and_fits_no_other_format() -> None:
    table = Content(data=f"# by: me\ntime,{','.join(CHANNELS)}\n0{',0' * 11}\n".encode())
    columns = parse_settings("rate = 100\n[joint]\nindex_flex1 = 'index_bend'", ColumnMap, "glove.toml")
    assert format_of(table, ReadOptions()).name == "dexmo"
    assert format_of(table, ReadOptions(columns=columns)).name == "csv"
    with pytest.raises(InputError, match="--columns explains a table, and this is BVH motion capture"):
        read_content(Content(data=b"HIERARCHY"), ReadOptions(columns=columns))


def test_a_large_file_is_refused(tmp_path: Path) -> None:
    large = tmp_path / "large.csv"
    with large.open("wb") as file:
        file.write(b"time,px\n" * 1000)
        file.truncate((1 << 30) + 1)
    with pytest.raises(TrajectoryError, match=r"large\.csv: more than 1 GB; expected a recording of a hand"):
        read_recording(large)
