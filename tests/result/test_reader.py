"""Result files: what is written is what is read, and no way of stopping a run leaves something unreadable."""

import errno
import json
import os
import signal
import subprocess
import sys
import textwrap
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from file_faults import attribute, bare_datasets, changed
from numpy.typing import NDArray

from hhsim.errors import InputError, OutputError
from hhsim.motion.trajectory import TickPhase
from hhsim.result import schema
from hhsim.result.body import Body
from hhsim.result.reader import CHUNK_TICKS, Result, load_result
from hhsim.result.schema import Column
from hhsim.result.writer import HandPart, ResultWriter
from hhsim.system import environment as info
from hhsim.system.checksummed_file import seal_holds

Arrays = dict[str, NDArray[Any]]
SCENE = {"object": "bunny", "trajectory": "grasp", "stiffness": [200.0, 2.0, 0.5], "seed": 0}
EXTRA = {
    schema.LIVE_TICK: schema.LIVE_TICK_COLUMNS,
    schema.LIVE_SAMPLE: schema.sample_columns(3),
    schema.LIVE_EVENT: schema.EVENT_COLUMNS,
}
PHASES = (TickPhase("approach", 0, 39), TickPhase("hold", 40, 99))


def block(ticks: int, seed: int = 0) -> Arrays:
    generator = np.random.default_rng(seed)
    arrays = {}
    for column in schema.TICK_COLUMNS:
        values = generator.normal(size=(ticks, *column.shape)) * 1000.0
        arrays[column.name] = values.astype(column.dtype)
    return arrays


def static(columns: Sequence[Column]) -> Arrays:
    generator = np.random.default_rng(1)
    shapes = {column.name: tuple(7 if size == -1 else size for size in column.shape) for column in columns}
    return {column.name: (generator.normal(size=shapes[column.name]) * 10.0).astype(column.dtype) for column in columns}


def opened(path: Path, *, live: bool = False, of_body: Arrays | None = None, **more: Any) -> ResultWriter:
    """The writer of a result of one hand and one body."""
    hands = {"right": HandPart(SCENE, static(schema.HAND_STATIC), EXTRA if live else {})}
    bodies = {"bunny": Body("fixed", static(schema.BODY_STATIC) | (of_body or {}))}
    return ResultWriter(path, hands=hands, bodies=bodies, **more)


def write(path: Path, blocks: list[Arrays], *, phases: tuple[TickPhase, ...] = PHASES) -> Path:
    with opened(path, phases=phases) as writer:
        for arrays in blocks:
            writer.append(schema.hand_tables("right", arrays))
        return writer.finish({"right": {"tick p50": 41.5, "method": "coupled"}}, {"ticks": 100})


def test_what_is_written_is_read_back_exactly(tmp_path: Path) -> None:
    blocks = [block(CHUNK_TICKS, 2), block(300, 3), block(1, 4)]
    path = write(tmp_path / "run.h5", blocks)
    loaded = load_result(path)
    assert loaded.complete
    assert loaded.ticks == CHUNK_TICKS + 301
    assert loaded.scene == SCENE
    assert loaded.phases == PHASES
    assert loaded.summary == {"tick p50": 41.5, "ticks": 100, "method": "coupled"}
    for column in schema.TICK_COLUMNS:
        expected = np.concatenate([arrays[column.name] for arrays in blocks])
        assert np.array_equal(loaded[column.name], expected, equal_nan=True), column.name
        assert loaded[column.name].dtype == np.dtype(column.dtype)
    for name, array in static(schema.HAND_STATIC).items():
        assert np.array_equal(loaded.static[f"hand/{name}"], array), name
    for name, array in static(schema.BODY_STATIC).items():
        assert np.array_equal(loaded.bodies["bunny"].static[name], array), name
    assert (loaded.name, list(loaded.hands), loaded.body.kind, loaded.other) == ("right", ["right"], "fixed", None)


def test_arrays_of_a_loaded_result_cannot_be_changed_and_it_is_no_session(tmp_path: Path) -> None:
    loaded = load_result(write(tmp_path / "run.h5", [block(3)]))
    with pytest.raises(ValueError, match="read-only"):
        loaded["time"][0] = 1.0
    assert loaded.live is None
    with pytest.raises(InputError, match="unknown dataset 'live/sample/time'"):
        loaded["live/sample/time"]


def test_a_tick_takes_as_much_as_the_page_says(tmp_path: Path, repository: Path) -> None:
    # Random numbers: what cannot be made smaller.
    one, two = (write(tmp_path / f"{n}.h5", [block(CHUNK_TICKS, k) for k in range(n)]).stat().st_size for n in (1, 2))
    page = (repository / "docs" / "faq.md").read_text(encoding="utf-8")
    assert f"{(two - one) / CHUNK_TICKS / 1e3:.1f} kB a tick" in page


def test_every_dataset_states_its_units_and_meaning(tmp_path: Path) -> None:
    path = write(tmp_path / "run.h5", [block(3)])
    with h5py.File(path, "r") as file:
        datasets = sum(
            isinstance(file[f"hands/right/tick/{column.name}"], h5py.Dataset) for column in schema.hand_columns()
        )
        attributes = set(file.attrs)
    assert bare_datasets(path) == []
    assert datasets == len(schema.hand_columns())
    assert attributes == {
        *("format", "schema_version", "hhsim_version", "git_revision", "git_dirty", "created_utc", "machine"),
        *("packages", "scene", "command", "complete"),
    }


def extra(rows: dict[str, int], seed: int = 0) -> dict[str, Arrays]:
    """Rows of the tables of a live session."""
    generator = np.random.default_rng(seed)
    tables: dict[str, Arrays] = {}
    for group, columns in EXTRA.items():
        tables[f"hands/right/{group}"] = {
            column.name: (generator.uniform(0.0, 99.0, (rows[group], *column.shape))).astype(column.dtype)
            for column in columns
        }
    return tables


def test_tables_of_unequal_length_are_damage_or_of_a_killed_run_and_trimmed_to_what_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "run.h5"
    with opened(path, live=True) as writer:
        rows = extra({schema.LIVE_TICK: 50, schema.LIVE_SAMPLE: 30, schema.LIVE_EVENT: 2})
        writer.append({**schema.hand_tables("right", block(50)), **rows})
    with changed(path) as file:
        file["tick/time"].resize(44, axis=0)
        file["hands/right/live/tick/missed"].resize(41, axis=0)
        file["hands/right/live/sample/flexion"].resize(20, axis=0)
        file["hands/right/live/event/text"].resize(1, axis=0)
        file.attrs["complete"] = 1
    with pytest.raises(InputError, match=r"hands/right/live/tick/missed has 41 rows, hands/right/[a-z_/]* 50"):
        load_result(path)
    with changed(path) as file:
        file.attrs["complete"] = 0
    loaded = load_result(path)
    assert loaded.ticks == len(loaded["live/tick/wakeup"]) == len(loaded["status"]) == 41
    assert len(loaded["live/sample/time"]) == 20
    assert len(loaded["live/event/level"]) == 1


def test_two_runs_give_the_same_bytes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Clock:
        @staticmethod
        def now(zone: object) -> Any:
            from datetime import UTC, datetime

            return datetime(2026, 1, 2, tzinfo=UTC)

    monkeypatch.setattr(info, "datetime", Clock)
    first = write(tmp_path / "a.h5", [block(300, 5), block(300, 6)])
    second = write(tmp_path / "b.h5", [block(300, 5), block(300, 6)])
    assert first.read_bytes() == second.read_bytes()


def test_phases_are_found_by_their_names(tmp_path: Path) -> None:
    loaded = load_result(write(tmp_path / "run.h5", [block(100)]))
    assert loaded.phase("hold") == slice(40, 100) and loaded.label == str(loaded.path)
    with h5py.File(loaded.path) as file:
        assert file["phase/last_tick"].attrs["long_name"] == "last tick of each phase, from 0"
    with pytest.raises(InputError, match="no phase 'slide': it has approach, hold"):
        loaded.phase("slide")


def stop(path: Path, ticks: int) -> KeyboardInterrupt:
    """Begin a result that an interrupt ends."""
    with pytest.raises(KeyboardInterrupt) as caught, opened(path, phases=PHASES) as writer:
        writer.append(schema.hand_tables("right", block(ticks)))
        raise KeyboardInterrupt
    return caught.value


def test_an_exception_keeps_the_ticks_and_says_where(tmp_path: Path) -> None:
    path = tmp_path / "run.h5"
    assert stop(path, 30).__notes__ == [f"the 30 ticks so far are in {path} (complete = 0)"]
    loaded = load_result(path)
    assert not loaded.complete
    assert loaded.ticks == 30
    assert [phase.name for phase in loaded.phases] == ["approach"]
    assert loaded.phase("approach") == slice(0, 30)


@pytest.mark.parametrize("written", [0, 5, len(schema.TICK_COLUMNS) - 1])
def test_an_interrupt_within_a_block_leaves_whole_ticks_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, written: int
) -> None:
    path = tmp_path / "run.h5"
    count = 0
    original = h5py.Dataset.__setitem__

    def interrupted(dataset: h5py.Dataset, where: Any, values: Any) -> None:
        nonlocal count
        count += 1
        if count > len(schema.TICK_COLUMNS) + written:
            raise KeyboardInterrupt
        original(dataset, where, values)

    with pytest.raises(KeyboardInterrupt), opened(path) as writer:
        monkeypatch.setattr(h5py.Dataset, "__setitem__", interrupted)
        writer.append(schema.hand_tables("right", block(30)))
        writer.append(schema.hand_tables("right", block(20)))
    monkeypatch.undo()
    assert load_result(path).ticks == 30
    with h5py.File(path, "r") as file:
        assert {len(file["hands/right/tick"][column.name]) for column in schema.hand_columns()} == {30}


def test_an_older_result_stands_until_the_new_one_is_complete(tmp_path: Path) -> None:
    path = write(tmp_path / "run.h5", [block(10)])
    older = path.read_bytes()
    stop(path, 20)
    assert path.read_bytes() == older
    assert load_result(tmp_path / "run.partial.h5").ticks == 20
    assert write(path, [block(5)]) == path
    assert load_result(path).ticks == 5
    assert sorted(file.name for file in tmp_path.iterdir()) == ["run.h5", "run.partial.h5"]


@pytest.mark.parametrize(
    ("name", "error", "says"),
    [
        ("notes.h5", OutputError, "exists and is no result file"),
        ("run.txt", OutputError, r"run\.txt is no name for a result file: it has to end in \.h5 or \.hdf5"),
        ("", OutputError, "is a folder: name a file in it"),
        ("run.h5", ValueError, "invalid literal"),
    ],
)
def test_a_result_that_cannot_be_begun_leaves_everything_as_it_is(
    tmp_path: Path, name: str, error: type[Exception], says: str
) -> None:
    notes = tmp_path / "notes.h5"
    notes.write_text("notes\n")
    wrong = {"mesh/faces": np.array(["no number"])} if error is ValueError else None
    with pytest.raises(error, match=says):
        opened(tmp_path / name, of_body=wrong)
    assert (list(tmp_path.iterdir()), notes.read_text()) == ([notes], "notes\n")


def test_an_exception_before_the_first_tick_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError), opened(tmp_path / "run.h5"):
        raise RuntimeError
    assert list(tmp_path.iterdir()) == []


def command(script: str, path: Path) -> list[str]:
    """The words that run a script of these tests' names."""
    prelude = f"""
        import resource, sys
        from pathlib import Path
        sys.path[:0] = {[str(Path(__file__).parents[i]) for i in range(2)]!r}
        from test_reader import PHASES, block, opened
        from hhsim.result.schema import hand_tables
        path = Path({str(path)!r})
    """
    return [sys.executable, "-c", textwrap.dedent(prelude) + textwrap.dedent(script)]


# Files may not grow beyond so many bytes: a full disk that needs no root.
WRITE_MANY = """
    resource.setrlimit(resource.RLIMIT_FSIZE, (6_000_000, 6_000_000))
    from hhsim.errors import OutputError
    try:
        with opened(path, phases=PHASES) as writer:
            for seed in range(20):
                writer.append(hand_tables("right", block(256, seed)))
            writer.finish({})
    except OutputError as error:
        print(error, *getattr(error, "__notes__", ()), sep="\\n")
"""
WRITE_ON = """
    with opened(path) as writer:
        arrays = hand_tables("right", block(128))
        while True:
            writer.append(arrays)
            print(writer.ticks, flush=True)
"""


def test_a_full_disk_keeps_the_ticks_before_it(tmp_path: Path) -> None:
    path = tmp_path / "run.h5"
    run = subprocess.run(command(WRITE_MANY, path), capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    assert run.stderr == ""
    message, note = run.stdout.splitlines()
    assert message == f"cannot write {path}: {os.strerror(errno.EFBIG).lower()}"
    loaded = load_result(path)
    assert not loaded.complete
    assert loaded.ticks > 0
    assert loaded.ticks % 256 == 0
    assert note == f"the {loaded.ticks:,} ticks so far are in {path} (complete = 0)"
    assert np.array_equal(loaded["graphic/joints"][:256], block(256, 0)["graphic/joints"])


def test_a_killed_run_leaves_a_readable_file(tmp_path: Path) -> None:
    path = tmp_path / "run.h5"
    process = subprocess.Popen(command(WRITE_ON, path), stdout=subprocess.PIPE, text=True)
    for line in process.stdout:
        if int(line) >= 640:
            break
    process.send_signal(signal.SIGKILL)
    process.wait()
    process.stdout.close()
    loaded = load_result(path)
    assert not loaded.complete
    assert loaded.ticks >= 640
    assert np.array_equal(loaded["time"][:128], block(128)["time"])


def test_a_file_that_is_being_written_is_told_apart_from_a_broken_one(tmp_path: Path) -> None:
    path = tmp_path / "run.h5"
    with opened(path) as writer:
        writer.append(schema.hand_tables("right", block(2)))
        reader = "import sys; from hhsim.result.reader import load_result as load; load(sys.argv[1])"
        run = subprocess.run([sys.executable, "-c", reader, str(path)], capture_output=True, text=True)
        writer.finish({})
    assert run.stderr.splitlines()[-1].endswith("is still being written by another process: wait for it to end")


def forged(change: Callable[[h5py.File], object]) -> Callable[[Path], object]:
    def spoil(path: Path) -> None:
        with changed(path) as file:
            change(file)

    return spoil


def other(name: str, values: Any) -> Callable[[Path], object]:
    """Put other values in the place of a dataset."""

    def put(file: h5py.File) -> None:
        del file[name]
        file[name] = values

    return forged(put)


def of_schema(version: object) -> Callable[[Path], object]:
    return forged(lambda file: file.attrs.update(schema_version=version))


SPOILED: dict[str, tuple[Callable[[Path], object], str]] = {
    "text": (lambda path: path.write_text("time,x,y,z\n"), "is no HDF5 file"),
    "cut": (lambda path: os.truncate(path, path.stat().st_size // 2), "a damaged HDF5 file: cut short"),
    "empty": (lambda path: os.truncate(path, 0), "is no HDF5 file"),
    "newer": (of_schema(schema.SCHEMA_VERSION + 1), rf"newer hhsim \(schema {schema.SCHEMA_VERSION + 1}"),
    **{
        f"schema {version}": (
            of_schema(version),
            rf"run\.h5 is a result of schema {version}; .* {schema.SCHEMA_VERSION} alone",
        )
        for version in (1, 6, "three")
    },
    "no schema": (forged(lambda file: file.attrs.__delitem__("schema_version")), "is a result of schema None"),
    "format": (forged(lambda file: file.attrs.update(format="hhsim-tree")), "'hhsim-tree', not 'hhsim-result'"),
    "no format": (lambda path: h5py.File(path, "w").close(), "states no format"),
    "lacking": (forged(lambda file: file.__delitem__("hands/right/tick/force/total")), "lacks the dataset force/total"),
    "no ticks": (forged(lambda file: file.__delitem__("hands/right/tick")), "lacks the dataset input_seq"),
    "shape": (other("hands/right/tick/force/total", np.zeros((50, 4))), r"shape \(50, 4\), expected \(any, 3\)"),
    "palm": (other("hands/right/palm_radius", np.ones(1)), "palm_center and palm_radius are not of the same length"),
    "tree": (other("bodies/bunny/tree/level", np.zeros(1, np.int64)), "tree/level and .* are not of the same length"),
    "palm tree": (other("hands/right/palm_tree/parent", np.zeros(1, np.int64)), "are not of the same length"),
    "texts": (other("hands/right/base", np.zeros((5, 3), "S8")), r"base holds \|S8, expected <f8"),
    "fractions": (other("bodies/bunny/mesh/faces", np.zeros((1, 3))), "mesh/faces holds float64, expected <i8"),
    "no scene": (forged(lambda file: file.attrs.__delitem__("scene")), "is damaged or no result file"),
    "endless": (forged(attribute("", "/", "scene", lambda _: '{"seed": 1' + "0" * 5000 + "}")), "JSON object"),
    "gone": (lambda path: path.unlink(), "no such file; expected a result"),
    "folder": (lambda path: (path.unlink(), path.mkdir()), "is a folder"),
    **{
        name: (forged(attribute(name, "/", name, lambda _: "null")), "JSON object")
        for name in ("machine", "packages", "scene", "repeated", "score")
    },
}


@pytest.mark.parametrize(("spoil", "says"), SPOILED.values(), ids=list(SPOILED))
def test_a_file_that_cannot_be_used_is_told_in_one_line(tmp_path: Path, spoil: Any, says: str) -> None:
    path = write(tmp_path / "run.h5", [block(50)])
    spoil(path)
    with pytest.raises(InputError, match=says) as caught:
        load_result(path)
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize("read", [lambda found: found["graphic/joints"], lambda found: found.at(1, ["graphic/joints"])])
def test_a_number_that_no_run_can_hold_is_damage(tmp_path: Path, read: Callable[[Result], Any]) -> None:
    path = tmp_path / "run.h5"
    write(path, [block(3)])
    with changed(path) as file:
        file["hands/right/tick/graphic/joints"][1, 2, 3, 0] = -1e100
    found = load_result(path)
    says = r"run.h5: damaged: /hands/right/tick/graphic/joints holds -1e\+100, beyond 1e\+30"
    with pytest.raises(InputError, match=says):
        read(found)
    assert found["graphic/position"].shape == (3, 3), "what is sound is read"


def test_the_keys_are_the_datasets_and_others_are_told_with_the_near_names(tmp_path: Path) -> None:
    result = load_result(write(tmp_path / "run.h5", [block(100)]))
    with pytest.raises(InputError, match=r"run\.h5: unknown dataset 'force/totl': did you mean force/total"):
        result["force/totl"]
    with pytest.raises(InputError, match=r"run\.h5: unknown dataset 'force'"):
        result["force"]
    assert set(result.keys()) == {column.name for column in schema.TICK_COLUMNS}
    assert "force/total" in result and "force" not in result
    assert {name: array.shape for name, array in dict(result).items()} == {
        column.name: (100, *column.shape) for column in schema.TICK_COLUMNS
    }


def test_a_result_is_sealed_when_it_is_closed_whole_or_not(tmp_path: Path) -> None:
    whole, stopped = tmp_path / "whole.h5", tmp_path / "stopped.h5"
    write(whole, [block(600)])
    stop(stopped, 30)
    for path, ticks in ((whole, 600), (stopped, 30)):
        assert seal_holds(path) is True
        assert load_result(path).ticks == ticks
        data = bytearray(path.read_bytes())
        data[len(data) // 2] ^= 1
        path.write_bytes(data)
        with pytest.raises(InputError, match="a damaged file: its bytes are not those that its checksum is of"):
            load_result(path)


def test_a_scene_without_what_every_scene_has_is_damage_where_it_is_asked_for(tmp_path: Path) -> None:
    path = tmp_path / "run.h5"
    write(path, [block(100)])
    with changed(path) as file:
        file.attrs["scene"] = json.dumps({"rate": 1000.0, "solver": {"method": "coupled"}})
    result = load_result(path)
    assert result.scene["solver"]["method"] == "coupled" and result.scene.get("seed") is None
    with pytest.raises(InputError, match=r"run\.h5 is damaged: it does not say its 'touch'"):
        result.scene["solver"]["touch"]
    with pytest.raises(InputError, match="'trajectory'"):
        result.scene["trajectory"]
